"""What the search for suspect channels looks at: one run's channels at some 100 samples a second, smoothed alike.

Two kinds of stretches tell a wheel's sensor from its brake's. Where a wheel slides under a WSP, its own balance
C + J dw/dt = r T holds with a T that changes slowly beside what a valve does to C: C and J dw/dt mirror each other. Where all
wheels roll, they turn alike but for a creepage of some per mille in proportion to their torques.
"""

import dataclasses

import numpy as np
from scipy.ndimage import binary_erosion, maximum_filter1d

from wsp_env.contact.degraded import adhesion_without_recovery
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.recording import Recording

STEP_S = 0.01  # of the samples that are looked at
LEAST_SPEED_MPS = 5.0  # creepage is mostly noise below
_WHEEL_S = 0.15  # windows of the filters: of what a valve does,
_RATE_S = 0.5  # of all wheels together,
_SPEED_S = 1.0  # and of the vehicle
_SLIDING = 0.03  # creepage from which a wheel slides: well beyond the creep curve's rise
_SLIDING_MPS = 0.5
_ROLLING = 0.01  # creepage below which it rolls
_ORDER = 2


@dataclasses.dataclass(frozen=True)
class Traces:
    """One run; T samples, A axles."""

    name: str
    step: float  # [s]
    time: np.ndarray  # (T,) [s]
    speed: np.ndarray  # (T,) smoothed [m/s]
    wheel: np.ndarray  # (T, A) as recorded [rad/s]
    smooth_wheel: np.ndarray  # (T, A)
    rate: np.ndarray  # (T, A) [rad/s2]
    slow_rate: np.ndarray  # (T, A) over a longer window
    torque: np.ndarray  # (T, A) smoothed [N m]
    torque_rate: np.ndarray  # (T, A) [N m/s]
    good: np.ndarray  # (T,) bool: fast enough, as recorded, away from the filters' ends
    mass: float  # [kg]
    gradient: float  # [-]
    creep_per_nm: float  # creepage that a wheelset's torque of 1 N m takes on a rail as believed, at small creepage

    @property
    def axles(self) -> int:
        """Number of axles."""
        return self.wheel.shape[1]


def thinned(run: Recording) -> Recording:
    """Return one sample in every hundredth of a second."""
    stride = max(round(STEP_S / float(np.median(np.diff(run.time_s[:10_000])))), 1)
    if stride == 1:
        return run
    return dataclasses.replace(
        run,
        time_s=run.time_s[::stride],
        vehicle_speed_mps=run.vehicle_speed_mps[::stride],
        wheel_speed_radps=run.wheel_speed_radps[::stride],
        brake_torque_nm=run.brake_torque_nm[::stride],
        suspect=None if run.suspect is None else run.suspect[::stride],
    )


def traces(campaign: Campaign, run: Recording) -> Traces | None:
    """Prepare a run; None where too little of it is fast enough."""
    step = float(np.median(np.diff(run.time_s)))
    wide = window(_SPEED_S, step)
    if len(run.time_s) < 2 * wide:
        return None
    speed = smoothed(run.vehicle_speed_mps, _SPEED_S, step)
    good = speed > LEAST_SPEED_MPS
    edge = wide // 2
    good[:edge] = good[-edge:] = False
    if run.suspect is not None and run.suspect.any():
        good &= ~maximum_filter1d(run.suspect.any(axis=1), 2 * edge + 1)
    if good.sum() < wide:
        return None
    return Traces(
        run.name, step, run.time_s, speed, run.wheel_speed_radps,
        smoothed(run.wheel_speed_radps, _WHEEL_S, step), smoothed(run.wheel_speed_radps, _WHEEL_S, step, 1),
        smoothed(run.wheel_speed_radps, _RATE_S, step, 1), smoothed(run.brake_torque_nm, _WHEEL_S, step),
        smoothed(run.brake_torque_nm, 2.0 * _WHEEL_S, step, 1), good, run.mass_kg, run.gradient, _creep_per_nm(campaign, run),
    )  # fmt: skip


def sliding(campaign: Campaign, one: Traces, axle: int) -> np.ndarray:
    """Return the samples (T,) bool at which an axle (from 0) slides and turns, none at the edge of a slide."""
    circumference = campaign.vehicle.wheel_radius_m * one.smooth_wheel[:, axle]
    slip = one.speed - circumference
    mask = one.good & (slip > _SLIDING * one.speed) & (slip > _SLIDING_MPS) & (circumference > _SLIDING_MPS)
    result: np.ndarray = binary_erosion(mask, iterations=max(round(0.5 * _WHEEL_S / one.step), 1))
    return result


def rolling(one: Traces, axles: list[int]) -> np.ndarray:
    """Return the samples (T,) bool at which some axles all roll, as they do at the recording's start."""
    turning = np.median(one.smooth_wheel[:, axles], axis=1)
    ratio = turning / np.maximum(one.speed, LEAST_SPEED_MPS)
    usual = float(np.quantile(ratio[one.good], 0.9))
    alike = np.ptp(one.smooth_wheel[:, axles], axis=1) < _ROLLING * turning
    result: np.ndarray = one.good & alike & (ratio > (1.0 - _ROLLING) * usual)
    return result


def smoothed(values: np.ndarray, window_s: float, step: float, derivative: int = 0) -> np.ndarray:
    """Return values (T, ...) filtered by parabolas."""
    from scipy.signal import savgol_filter  # here, as it takes longer to import than all the rest

    result: np.ndarray = savgol_filter(values, window(window_s, step), _ORDER, deriv=derivative, delta=step, axis=0)
    return result


def window(window_s: float, step: float) -> int:
    """Return the odd number of samples of a window."""
    return max(2 * round(window_s / (2.0 * step)) + 1, _ORDER + 3)


def _creep_per_nm(campaign: Campaign, run: Recording) -> float:
    vehicle, creepage, speed = campaign.vehicle, 1e-4, 20.0  # on the straight beginning of the curve, at any speed
    load = run.mass_kg * vehicle.gravity_mps2 / (2 * vehicle.axles)
    slip = np.array([creepage * speed])
    adhesion = adhesion_without_recovery(slip, speed, load, run.kinetic_friction_d, 0.0, campaign.contact.law)
    return float(creepage / (2.0 * vehicle.wheel_radius_m * load * adhesion[0]))
