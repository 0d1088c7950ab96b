"""What the wheels so far tell of the rail: friction of the contaminant and how readily sliding cleans it.

For every rate of recovery tau that is tried, each slip and adhesion of a sliding wheel says which mu_cd the rail then has: with
lambda = 1 - exp(-tau f N e) known, f = (1 - lambda) f_d + lambda f_r gives f_d, and f_d gives mu_cd (eqs. 1 to 7 of the seed
paper). Only at the true tau is that the same at all slips. Mean and scatter of log mu_cd, over all wheelsets and fading slowly,
are what is kept for each tau.
"""

import numpy as np

from wsp_env.compiled import elementwise
from wsp_env.contact.polach import falling_friction, saturation
from wsp_env.parameters.vehicle import Vehicle

#: Rates of recovery that are tried [m/J]; 0 is the classic law.
RECOVERY_M_PER_J = (0.0, 1e-4, 2e-4, 3.5e-4)

#: A wheel from this creepage on says something [-]; below most of the adhesion is that of the contact's stiffness (assumption).
SLIDING_CREEPAGE = 0.015

#: Time constant by which what was seen fades, in seconds of sliding [s].
MEMORY_S = 8.0

#: Before anything was seen: mu_cd [-] and deviation of its logarithm, as if seen for so long [s] (assumptions).
START_FRICTION = 0.035
START_DEVIATION = 0.4
START_S = 0.1

#: Bounds of mu_cd [-].
_RANGE = (0.004, 0.3)


def _falling_scalar(slip: float, kinetic: float, ratio: float, gamma: float) -> float:
    return falling_friction(slip, kinetic, ratio, gamma)


def _saturation_scalar(gradient: float, k_adhesion: float, k_slip: float) -> float:
    return saturation(gradient, k_adhesion, k_slip)


_falling, _saturation = elementwise(_falling_scalar), elementwise(_saturation_scalar)


class Rail:
    """Beliefs on the rails of N vehicles with A axles; attributes to read, never to keep.

    `friction` (N, K) mu_cd and `deviation` (N, K) of its logarithm, for each rate of `RECOVERY_M_PER_J`; `seen` (N,) s.
    """

    def __init__(self, vehicle: Vehicle, interval: float) -> None:
        self.interval = interval
        self._law = vehicle.contact.law
        mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
        self._load = mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles)  # of a wheel [N]
        self._tau = np.array(RECOVERY_M_PER_J)

    def reset(self, n: int, rows: np.ndarray | slice = slice(None)) -> None:
        """Begin new stops, of all N vehicles or of `rows`."""
        if isinstance(rows, slice):
            k = len(self._tau)
            self.seen, self._mean, self._square = np.zeros(n), np.zeros((n, k)), np.zeros((n, k))
        self.seen[rows] = START_S
        self._mean[rows] = np.log(START_FRICTION)
        self._square[rows] = np.log(START_FRICTION) ** 2 + START_DEVIATION**2

    @property
    def friction(self) -> np.ndarray:
        """Mean mu_cd (N, K) [-]."""
        return np.exp(self._mean)

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (N, K) of log mu_cd."""
        return np.sqrt(np.maximum(self._square - self._mean**2, 0.0))

    def update(self, slip: np.ndarray, adhesion: np.ndarray, speed: np.ndarray) -> None:
        """Take slips (N, A) [m/s] and adhesions (N, A), both smoothed alike, at the running speeds (N,) [m/s]."""
        running = np.maximum(speed, 1.0)[:, None]
        creepage = slip / running
        says = (creepage > SLIDING_CREEPAGE) & (adhesion > 0.0) & (speed > 3.0)[:, None]
        rows = np.flatnonzero(says.any(axis=1))
        if not len(rows):
            return
        log_friction = np.log(self._implied(slip[rows], adhesion[rows], creepage[rows], rows))
        weight = says[rows] * self.interval
        share = weight.sum(axis=1)
        kept = np.exp(-share / MEMORY_S)
        before = kept * self.seen[rows]
        after = before + share
        for kept_sum, values in ((self._mean, log_friction), (self._square, log_friction**2)):
            kept_sum[rows] = (before[:, None] * kept_sum[rows] + (weight[:, :, None] * values).sum(axis=1)) / after[:, None]
        self.seen[rows] = after

    def _implied(self, slip: np.ndarray, adhesion: np.ndarray, creepage: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return mu_cd (n, A, K) that every tau needs for the adhesion seen."""
        law, load = self._law, self._load
        slip, creepage, adhesion = np.maximum(slip, 0.0), np.maximum(creepage, 0.0), np.maximum(adhesion, 0.0)
        recovered = _falling(slip, law.mu_cr, law.ratio_r, law.gamma_r)
        recovered = recovered * _saturation(law.stiffness * creepage / (recovered * load), law.k_ar, law.k_sr)
        kept = np.exp(-self._tau * (adhesion * load * creepage)[:, :, None])  # 1 - lambda
        degraded = (adhesion[:, :, None] - (1.0 - kept) * recovered[:, :, None]) / kept
        falling = _falling(slip, 1.0, law.ratio_d, law.gamma_d)[:, :, None]
        limit = np.exp(self._mean[rows])[:, None, :] * falling
        share = _saturation(law.stiffness * creepage[:, :, None] / (limit * load), law.k_ad, law.k_sd)
        result: np.ndarray = np.clip(degraded / np.maximum(falling * share, 0.1), *_RANGE)
        return result
