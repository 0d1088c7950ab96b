"""Wheels that roll turn alike, but for radius and a creepage in proportion to their torque: one axle against the others.

w_k = (1 + rho) w (1 - kappa (g C_k - C)), late by a: with w and C the medians of the others, linear in rho, g - 1, the delay a
of the wheel's channel and the delay b of the torque's.
"""

import dataclasses

import numpy as np

from wsp_env.recordings.suspect.traces import Traces, rolling

RADIUS, GAIN, WHEEL_LATE, TORQUE_LATE = 0, 1, 2, 3
#: What is thought of these before: radii within 1 %; gains and delays open.
_PRIOR = np.array([0.01, 1.0, 1.0, 1.0])
_LEAST_S = 1.0  # of rolling
_TRIMMED = 3.0  # deviations beyond which a sample is left out
_RIM_S = 0.2  # of shifted channels


@dataclasses.dataclass(frozen=True)
class Rolled:
    """One axle against the others in one run: normal equations of the four, whitened."""

    gram: np.ndarray  # (4, 4)
    moment: np.ndarray  # (4,)
    residual: float  # deviation left [rad/s]

    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the four and their deviations."""
        covariance = np.linalg.inv(self.gram + np.diag(_PRIOR**-2.0))
        return covariance @ self.moment, np.sqrt(np.diag(covariance))


def pooled(several: list[Rolled]) -> Rolled:
    """Return what several runs say together."""
    return Rolled(
        np.sum([one.gram for one in several], axis=0),
        np.sum([one.moment for one in several], axis=0),
        float(np.median([one.residual for one in several])),
    )


def rolled(one: Traces, axle: int, wheel_late_s: float = 0.0, torque_late_s: float = 0.0) -> Rolled | None:
    """Compare an axle (from 0) with the others, its channels moved ahead by these first; None where they hardly roll."""
    others = [k for k in range(one.axles) if k != axle]
    if not others:
        return None
    by_wheel, by_torque = round(wheel_late_s / one.step), round(torque_late_s / one.step)
    index = np.flatnonzero(rolling(one, others))
    rim = round(_RIM_S / one.step) + max(abs(by_wheel), abs(by_torque))
    index = index[(index >= rim) & (index < len(one.time) - rim)]
    if len(index) * one.step < _LEAST_S:
        return None
    turning, torque = (np.median(values[index][:, others], axis=1) for values in (one.smooth_wheel, one.torque))
    rate = np.median(one.slow_rate[index][:, others], axis=1)
    creep, own = one.creep_per_nm * turning, one.torque[index + by_torque, axle]
    # Smoothed over the samples' own noise, which stays white so.
    y = one.wheel[index + by_wheel, axle] - np.median(one.wheel[index][:, others], axis=1) + creep * (own - torque)
    columns = np.column_stack([turning, -creep * own, -rate, -creep * one.torque_rate[index + by_torque, axle]])
    return _robust(columns, y)


def _robust(columns: np.ndarray, y: np.ndarray) -> Rolled | None:
    size = np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-12)
    kept = np.ones(len(y), dtype=bool)
    noise = 0.0
    for _ in range(4):
        fitted = np.linalg.lstsq(columns[kept] / size, y[kept], rcond=1e-9)[0] / size
        left = y - columns @ fitted
        noise = max(1.4826 * float(np.median(np.abs(left[kept]))), 1e-6)
        kept = np.abs(left) < _TRIMMED * noise
        if kept.sum() < 4 * columns.shape[1]:
            return None
    used = columns[kept] / noise
    return Rolled(used.T @ used, used.T @ (y[kept] / noise), noise)
