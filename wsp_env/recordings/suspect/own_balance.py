"""Each wheel's own balance while it slides under a WSP: C = r T - J dw/dt, with a T that changes slowly beside C.

What changes slowly (straight lines between nodes a second apart, and slip) is taken away from both; the rest of C must be
that of -J dw/dt: in size, at the same time, and of the same axle.
"""

import dataclasses

import numpy as np

from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.suspect.traces import Traces, sliding

LONGEST_S = 1.2  # delay that is looked for
_COARSE = 2  # samples between the delays that are tried first: a valve acts within a tenth of a second
_THIN = 2  # every second sample
_NODE_S = 1.0  # of what changes slowly
_LEAST_S = 1.5  # of sliding
_FAR_LESS = 2.0  # times what another peak must leave for the best one to be preferred: assumption
_LIVELY = 0.005  # of the wheelset's load times radius: what J dw/dt must move by, some ten times its noise: assumption


@dataclasses.dataclass(frozen=True)
class OwnBalance:
    """One wheel in one run."""

    lag_s: float  # by which the torque is late
    slope: float  # recorded over expected changes of torque, at that lag
    correlation: float  # at that lag
    at_rest: float  # the same at no lag
    course: tuple[np.ndarray, np.ndarray]  # lags [s], correlations
    others: np.ndarray  # (A,) correlation of this wheel with every axle's torque, at no lag
    samples: int
    moved: float  # deviation of J dw/dt [N m]

    def left(self, lag_s: float | None = None) -> float:
        """Return the share of the torque's changes that the balance leaves at a lag, its own where none is given."""
        fit = self.correlation if lag_s is None else float(np.interp(lag_s, *self.course))
        return 1.0 - max(fit, 0.0) ** 2


def own_balances(campaign: Campaign, one: Traces) -> list[OwnBalance | None]:
    """Return what the balance of each wheel says; None where it did not slide lively."""
    return [_own(campaign, one, axle) for axle in range(one.axles)]


def _own(campaign: Campaign, one: Traces, axle: int) -> OwnBalance | None:
    vehicle = campaign.vehicle
    furthest = round(LONGEST_S / one.step)
    index = np.flatnonzero(sliding(campaign, one, axle))[::_THIN]
    index = index[(index >= furthest) & (index < len(one.time) - furthest)]
    if len(index) * _THIN * one.step < _LEAST_S:
        return None
    moved = -vehicle.wheelset_inertia_kgm2 * one.rate[index, axle]
    slip = one.speed[index] - vehicle.wheel_radius_m * one.smooth_wheel[index, axle]
    slow = np.column_stack([_hats(one.time[index]), slip])
    basis, size, _ = np.linalg.svd(slow, full_matrices=False)
    basis = basis[:, size > 1e-6 * size[0]]

    def quick(values: np.ndarray) -> np.ndarray:
        rest: np.ndarray = values - basis @ (basis.T @ values)
        return rest

    x = quick(moved)
    spread = float(np.sqrt(x @ x / len(x)))
    if spread < _LIVELY * one.mass * vehicle.gravity_mps2 * vehicle.wheel_radius_m / one.axles:
        return None
    lags = np.arange(-furthest, furthest + 1, _COARSE)
    course = (lags * one.step, _correlation(x, quick(one.torque[index[:, None] + lags, axle])))
    coarse = int(lags[_peak(lags, course[1])])
    lags = np.clip(np.arange(coarse - _COARSE, coarse + _COARSE + 1), -furthest, furthest)
    shifted = quick(one.torque[index[:, None] + lags, axle])
    correlation = _correlation(x, shifted)
    best = int(np.argmax(correlation))
    others = _correlation(x, quick(one.torque[index]))
    return OwnBalance(
        lag_s=float(lags[best] * one.step),
        slope=float(x @ shifted[:, best] / (x @ x)),
        correlation=float(correlation[best]),
        at_rest=float(others[axle]),
        course=course,
        others=others,
        samples=len(index),
        moved=spread,
    )


def _peak(lags: np.ndarray, correlation: np.ndarray) -> int:
    """Return the index of the lag: of the best correlation, or of the peak nearest to no lag if the best hardly leaves less.

    A WSP that vents and fills in turn repeats itself, and so does the correlation: a period later it is nearly as good.
    """
    best = int(np.argmax(correlation))
    inside = correlation[1:-1]
    peaks = 1 + np.flatnonzero((inside >= correlation[:-2]) & (inside > correlation[2:]) & (inside > 0.0))
    if not peaks.size:
        return best
    nearest = int(peaks[np.argmin(np.abs(lags[peaks]))])
    left_by_best, left_by_nearest = (1.0 - correlation[i] ** 2 for i in (best, nearest))
    return nearest if left_by_nearest < _FAR_LESS * left_by_best else best


def _correlation(x: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the correlation (k,) of x (n,) with columns (n, k), all of mean 0."""
    result: np.ndarray = x @ columns / np.sqrt((x @ x) * np.maximum((columns**2).sum(axis=0), 1e-12))
    return result


def _hats(time: np.ndarray) -> np.ndarray:
    """Straight lines between nodes in time (n, nodes), only those that have samples."""
    place = (time - time[0]) / _NODE_S
    weights: np.ndarray = np.clip(1.0 - np.abs(place[:, None] - np.arange(int(place[-1]) + 2)), 0.0, None)
    return weights[:, weights.any(axis=0)]
