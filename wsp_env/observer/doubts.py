"""Monitoring of the wheel sensors: detects faults, learns wheel radii, measures and filters noise.

The state of the monitoring is a `Doubts`. `wsp_env.observer.guard` holds it and acts on it.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined, rebuilder
from wsp_env.observer import running_speed
from wsp_env.observer.estimate import EstimatorConstants, VehicleEstimate
from wsp_env.observer.estimator import ROLLING_ADHESION

#: Largest rate of a wheel's circumferential speed [m/s2]; faster changes are faults (assumption: a full brake causes 16 m/s2).
JUMP_MPS2 = 100.0

#: Before braking, a wheel slower than this share of the fastest one has no working sensor (assumption).
ABSENT_SHARE = 0.5

#: A sensor is frozen if its readings are exactly constant for `FROZEN_S`, at more than `FROZEN_ABOVE_MPS`, while the estimated
#: running speed or the mean of the other wheels changes by `FROZEN_CHANGE_MPS` (assumptions: a pulse wheel with 60 pulses a
#: turn passes six edges in this time; measured speeds have noise; without noise a vehicle may coast at constant speed).
FROZEN_S, FROZEN_ABOVE_MPS, FROZEN_CHANGE_MPS = 0.3, 1.0, 0.05

#: A wheel stands if it is below `STANDING_MPS` while the vehicle runs above `RUNNING_MPS`. If its brake has been empty for
#: `DEAD_S`, it would turn on any rail: its sensor is dead (assumption: adhesion of 0.015 accelerates it by 2 m/s in that time).
STANDING_MPS, RUNNING_MPS, DEAD_S = 0.3, 2.8, 1.0

#: The rail never slows a braked wheel. If the balance of a wheel requires a negative adhesion beyond `DISOBEYS_ADHESION` [-]
#: for `DISOBEYS_S` [s], its valve does not obey, and the axle is left out. It may have corrected the running speed while it
#: seemed to roll: the standard deviation is raised to `MISLED_MPS`, and the mass estimate is reset (assumptions: usual noise
#: causes 0.003, a vent time 1.5 times as long 0.02).
DISOBEYS_ADHESION, DISOBEYS_S, MISLED_MPS = 0.03, 0.3, 1.0

#: Standard deviations of a sensor's noise [rad/s]: above the first the reading is filtered, above the second the sensor is left
#: out (assumptions: noise in training; 0.45 m/s at the tread, more than slips of interest).
USUAL_NOISE, MOST_NOISE = 0.1, 1.0

#: Time constant of the noise measurement [s], and change of a wheel's acceleration between measurements [m/s2] for the filter
#: of noisy speeds (assumptions: a moving valve changes it by 1 to 2).
NOISE_FILTER_S, CHANGE_MPS2 = 1.0, 1.0

#: Radii are learned within this share of the nominal radius (assumption: wheels of one vehicle are worn by up to 8 %).
RADIUS_TOLERANCE = 0.08


class Doubts(NamedTuple):
    """State of the sensor monitoring of N vehicles with A axles, changed in place."""

    failed: np.ndarray  # (N, A) bool, sensor or valve failed; excluded for the rest of the stop
    standing: np.ndarray  # (N, A) bool, wheel stands while the vehicle runs
    raw: np.ndarray  # (N, A) last reading [rad/s]
    same: np.ndarray  # (N, A) time for which the reading has been constant [s]
    held_at: np.ndarray  # (N, A) running speed at the start of that time [m/s]
    others_at: np.ndarray  # (N, A) mean speed of the other wheels at the start of that time [m/s]
    empty: np.ndarray  # (N, A) time for which the brake of a standing wheel has been empty [s]
    disobeys: np.ndarray  # (N, A) time for which a wheel slowed by more than its brake can cause [s]
    difference: np.ndarray  # (N, A) difference of the last two readings [rad/s]
    second: np.ndarray  # (N, A) difference of the last two differences [rad/s]
    variance: np.ndarray  # (N, A) variance of the noise [rad2/s2]
    speed: np.ndarray  # (N, A) filtered speed [rad/s]
    rate: np.ndarray  # (N, A) change of the filtered speed in an interval [rad/s]
    ratio: np.ndarray  # (N, A) radius over the nominal one [-]
    learned: np.ndarray  # (N,) number of readings used for the radii; -1: finished
    blind: np.ndarray  # (N, A) time for which the axle has been braked as unmonitored, see `overrule` [s]
    unbraked: np.ndarray  # (N, A) time for which the brake has been nearly empty [s]
    rest: np.ndarray  # (N, A) remaining time for which the safety timer applies the brake [s]
    used: np.ndarray  # (N,) least adhesion used by a monitored axle, while no axle is released to show the speed [-]
    full: np.ndarray  # (N,) time for which all monitored axles have had the demanded brake [s]
    slowing: np.ndarray  # (N, A) deceleration of the wheel, smoothed [m/s2]
    supply: np.ndarray  # (N,) lowest possible distributor pressure, share of full pressure [-]
    filled: np.ndarray  # (N,) lowest pressure to which it has filled a cylinder, share of full pressure [-]
    asked: np.ndarray  # (N,) least mean adhesion that the brakes require, smoothed like the deceleration [-]
    slid: np.ndarray  # (N,) bool, a monitored wheel has slowed faster than any vehicle since the demanded brake was last held
    clean: np.ndarray  # (N, A) wheel speed passed to the observer [rad/s]


class GuardConstants(NamedTuple):
    """Constants of the sensor monitoring."""

    radius: float  # nominal wheel radius [m]
    interval: float  # between measurements [s]
    slow: float  # gain of a low-pass of `NOISE_FILTER_S` in an interval [-]
    timer: float  # safety timer: longest time without brake [s]
    timer_rest: float  # safety timer: duration of the application [s]


def allocate(n: int, axles: int) -> Doubts:
    """Return the state at the start of n stops: no sensor in doubt."""
    per_vehicle = {"learned", "used", "full", "supply", "filled", "asked"}
    arrays = {name: np.zeros(n if name in per_vehicle else (n, axles)) for name in Doubts._fields}
    arrays["ratio"][:], arrays["full"][:] = 1.0, np.inf
    for name in ("failed", "standing"):
        arrays[name] = np.zeros((n, axles), dtype=bool)
    arrays["slid"] = np.zeros(n, dtype=bool)
    return Doubts(**arrays)


#: Kernels that build `Doubts` and `GuardConstants` from plain tuples.
doubts_of = rebuilder(allocate(1, 1))
guard_of = rebuilder(GuardConstants(1.0, 1.0, 1.0, 1.0, 1.0))


@inlined
def judge(
    i: int, k: int, reading: float, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants
) -> None:  # fmt: skip
    """Check the sensor of axle k for faults, and filter its noise."""
    if not math.isfinite(reading):
        d.failed[i, k] = True
        return
    change = reading - d.raw[i, k]
    d.failed[i, k] = abs(change) * c.radius > JUMP_MPS2 * c.interval
    d.same[i, k] = d.same[i, k] + c.interval if change == 0.0 and reading * c.radius > FROZEN_ABOVE_MPS else 0.0
    around = c.radius * others(i, k, d)
    if d.same[i, k] == 0.0:
        d.held_at[i, k], d.others_at[i, k] = e.speed[i], around
    moved = max(abs(e.speed[i] - d.held_at[i, k]), abs(around - d.others_at[i, k]))
    d.failed[i, k] |= d.same[i, k] >= FROZEN_S - 1e-9 and moved > FROZEN_CHANGE_MPS
    second = change - d.difference[i, k]
    third = second - d.second[i, k]
    d.variance[i, k] += c.slow * (third * third / 20.0 - d.variance[i, k])  # white noise gives 20 times its variance
    d.failed[i, k] |= d.variance[i, k] > MOST_NOISE * MOST_NOISE
    d.raw[i, k], d.difference[i, k], d.second[i, k] = reading, change, second
    stands(i, k, reading, d, c, e)
    _obeys(i, k, d, c, e)
    empty = d.standing[i, k] and brake.full_brake * e.pressure[i, k] < ROLLING_ADHESION
    d.empty[i, k] = d.empty[i, k] + c.interval if empty else 0.0
    d.failed[i, k] |= d.empty[i, k] >= DEAD_S
    noise = d.variance[i, k] - USUAL_NOISE * USUAL_NOISE
    if noise <= 0.0:
        d.speed[i, k], d.rate[i, k] = reading, change
        return
    _filter(i, k, reading, noise, d, c)


@inlined
def stands(i: int, k: int, reading: float, d: Doubts, c: GuardConstants, e: VehicleEstimate) -> None:
    """Report a wheel that stands while the vehicle runs, by its reading; also for excluded sensors."""
    d.standing[i, k] = reading * c.radius < STANDING_MPS and e.speed[i] > RUNNING_MPS


@inlined
def _obeys(i: int, k: int, d: Doubts, c: GuardConstants, e: VehicleEstimate) -> None:
    """Check whether the valve of axle k obeys."""
    d.disobeys[i, k] = d.disobeys[i, k] + c.interval if e.adhesion[i, k] < -DISOBEYS_ADHESION else 0.0
    if d.disobeys[i, k] >= DISOBEYS_S - 1e-9:
        d.failed[i, k] = True
        running_speed.distrust(i, MISLED_MPS, e)


@inlined
def others(i: int, k: int, d: Doubts) -> float:
    """Mean reading of the other working sensors [rad/s]; 0 if there are none."""
    total, sound = 0.0, 0
    for j in range(d.raw.shape[1]):
        if j != k and not d.failed[i, j]:
            total += d.raw[i, j]
            sound += 1
    return total / max(sound, 1)


@inlined
def _filter(i: int, k: int, reading: float, noise: float, d: Doubts, c: GuardConstants) -> None:
    """Filter a noisy speed with the steady-state filter of speed and acceleration for this noise [rad2/s2] (Kalata 1984)."""
    index = CHANGE_MPS2 / c.radius * c.interval / math.sqrt(noise)
    r = 0.25 * (4.0 + index - math.sqrt(8.0 * index + index * index))
    gain = 1.0 - r * r
    gain_rate = 2.0 * (2.0 - gain) - 4.0 * math.sqrt(1.0 - gain)
    expected = d.speed[i, k] + d.rate[i, k]
    missing = reading - expected
    d.speed[i, k] = max(expected + gain * missing, 0.0)
    d.rate[i, k] += gain_rate * missing


@inlined
def learn(i: int, d: Doubts, e: VehicleEstimate, brake: EstimatorConstants) -> None:
    """Learn the ratios of the radii before braking, while all wheels roll freely with equal circumferential speeds."""
    most = 0.0
    for k in range(d.raw.shape[1]):
        most = max(most, brake.full_brake * e.pressure[i, k])
    if most > ROLLING_ADHESION:
        d.learned[i] = -1.0  # finished: the brake acts
    elif d.learned[i] >= 0.0:
        compare(i, d)


@inlined
def compare(i: int, d: Doubts) -> None:
    """Update the ratios of the radii with one reading of freely rolling wheels."""
    mean, sound = 0.0, 0
    for k in range(d.raw.shape[1]):
        if not d.failed[i, k]:
            mean += d.raw[i, k]
            sound += 1
    mean /= max(sound, 1)
    alike = sound > 1
    for k in range(d.raw.shape[1]):
        alike = alike and (d.failed[i, k] or abs(mean - d.raw[i, k]) <= RADIUS_TOLERANCE * d.raw[i, k])
    if not alike or mean <= 0.0:
        return
    d.learned[i] += 1.0
    for k in range(d.raw.shape[1]):
        if not d.failed[i, k]:
            d.ratio[i, k] += (mean / d.raw[i, k] - d.ratio[i, k]) / d.learned[i]
