"""What the wheels so far tell of the rail: friction of the contaminant and how readily sliding cleans it.

For every rate of recovery tau that is tried, each slip and adhesion of a sliding wheel says which mu_cd the rail then has: with
lambda = 1 - exp(-tau f N e) known, f = (1 - lambda) f_d + lambda f_r gives f_d, and f_d gives mu_cd (eqs. 1 to 7 of the seed
paper). Only at the true tau is that the same at all slips. Mean and scatter of log mu_cd, over all wheelsets and fading slowly,
are what is kept for each tau.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.contact import degraded
from wsp_env.contact.degraded import DegradedLaw
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


class RailEstimate(NamedTuple):
    """Beliefs on the rails of N vehicles for K rates of recovery, changed in place: to be read, never to be kept."""

    seen: np.ndarray  # (N,) how long wheels have slid, fading [s]
    friction: np.ndarray  # (N, K) mu_cd, exp of the mean of its logarithm [-]
    deviation: np.ndarray  # (N, K) of that logarithm [-]
    mean: np.ndarray  # (N, K) of the logarithm [-]
    square: np.ndarray  # (N, K) mean of its square [-]
    sums: np.ndarray  # (2, K) scratch: of the logarithm and of its square over the axles of a vehicle


class RailEstimateConstants(NamedTuple):
    """What is the same for all vehicles."""

    interval: float  # between measurements [s]
    load: float  # of a wheel with half the payload on board [N]
    law: DegradedLaw


def constants(vehicle: Vehicle, interval: float) -> RailEstimateConstants:
    """Return the constants for measurements every `interval` [s]."""
    mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
    return RailEstimateConstants(
        interval, mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles), degraded.LAW.make(vehicle.contact)
    )


def allocate(n: int) -> RailEstimate:
    """Return the beliefs on n rails; `begin` gives them values."""
    rates = len(RECOVERY_M_PER_J)
    shapes = {"seen": (n,), "sums": (2, rates)}
    return RailEstimate(*(np.zeros(shapes.get(name, (n, rates))) for name in RailEstimate._fields))


@inlined
def begin(i: int, r: RailEstimate) -> None:
    """Begin a new stop of vehicle i, of whose rail nothing was seen yet."""
    r.seen[i] = START_S
    for j in range(len(RECOVERY_M_PER_J)):
        r.mean[i, j] = math.log(START_FRICTION)
        r.square[i, j] = math.log(START_FRICTION) ** 2 + START_DEVIATION**2
        _conclude(i, j, r)


@inlined
def update(i: int, slip: np.ndarray, adhesion: np.ndarray, speed: float, r: RailEstimate, c: RailEstimateConstants) -> bool:
    """Take slips (N, A) [m/s] and adhesions (N, A) of vehicle i, both smoothed alike, at its running speed [m/s].

    Returns whether they say anything.
    """
    share = 0.0
    if speed > 3.0:
        for k in range(slip.shape[1]):
            creepage = slip[i, k] / speed
            if creepage > SLIDING_CREEPAGE and adhesion[i, k] > 0.0:
                if share == 0.0:
                    for j in range(len(RECOVERY_M_PER_J)):
                        r.sums[0, j] = r.sums[1, j] = 0.0
                share += c.interval
                _add(i, slip[i, k], adhesion[i, k], creepage, r, c)
    if share == 0.0:
        return False
    before = math.exp(-share / MEMORY_S) * r.seen[i]
    after = before + share
    for j in range(len(RECOVERY_M_PER_J)):
        r.mean[i, j] = (before * r.mean[i, j] + r.sums[0, j]) / after
        r.square[i, j] = (before * r.square[i, j] + r.sums[1, j]) / after
        _conclude(i, j, r)
    r.seen[i] = after
    return True


@inlined
def _conclude(i: int, j: int, r: RailEstimate) -> None:
    r.friction[i, j] = math.exp(r.mean[i, j])
    r.deviation[i, j] = math.sqrt(max(r.square[i, j] - r.mean[i, j] * r.mean[i, j], 0.0))


@inlined
def _add(i: int, slip: float, adhesion: float, creepage: float, r: RailEstimate, c: RailEstimateConstants) -> None:
    """Add the logarithm of mu_cd that every tau needs for the adhesion seen, weighted with the interval, and its square."""
    law, load = c.law, c.load
    recovered = falling_friction(slip, law.mu_cr, law.ratio_r, law.gamma_r)
    recovered *= saturation(law.stiffness * creepage / (recovered * load), law.k_ar, law.k_sr)
    falling = falling_friction(slip, 1.0, law.ratio_d, law.gamma_d)
    work = adhesion * load * creepage
    gradient = law.stiffness * creepage / (falling * load)
    for j in range(len(RECOVERY_M_PER_J)):
        kept = math.exp(-RECOVERY_M_PER_J[j] * work)  # 1 - lambda
        degraded = (adhesion - (1.0 - kept) * recovered) / kept
        share = saturation(gradient / r.friction[i, j], law.k_ad, law.k_sd)
        implied = degraded / max(falling * share, 0.1)
        logarithm = math.log(min(max(implied, _RANGE[0]), _RANGE[1]))
        r.sums[0, j] += c.interval * logarithm
        r.sums[1, j] += c.interval * logarithm * logarithm
