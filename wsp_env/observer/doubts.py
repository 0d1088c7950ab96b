"""Which wheel sensors to believe: faults are found, radii learned, noise measured and filtered.

What is remembered of the sensors is a `Doubts`; `wsp_env.observer.guard` keeps it and says what follows.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined, rebuilder
from wsp_env.observer.estimator import MASS_DEVIATION, ROLLING_ADHESION, EstimatorConstants, VehicleEstimate

#: A circumferential speed that changes faster [m/s2] is none of a wheel (assumption: a full brake alone changes it by 16 m/s2).
JUMP_MPS2 = 100.0

#: Before the brake acts, a wheel slower than this share of the fastest has no sensor (assumption).
ABSENT_SHARE = 0.5

#: A sensor whose readings stay the same to the last digit for so long [s], above this circumferential speed [m/s], while the
#: estimated running speed or the mean of the other wheels changes by so much [m/s], is frozen (assumptions: a pulse wheel of
#: 60 pulses a turn then passes six edges; measured speeds have noise; without noise a vehicle may coast at the same speed).
FROZEN_S, FROZEN_ABOVE_MPS, FROZEN_CHANGE_MPS = 0.3, 1.0, 0.05

#: A wheel below the one speed while the vehicle runs above the other [m/s] stands. After its brake has been empty for so long
#: [s] it would turn on any rail: the sensor is dead (assumption: adhesion of 0.015 turns it by 2 m/s in that time).
STANDING_MPS, RUNNING_MPS, DEAD_S = 0.3, 2.8, 1.0

#: Rail never slows a braked wheel. One whose balance says that it does, by more than this adhesion [-] for so long [s], has a
#: valve that does not obey: the axle is left out. The running speed may have been taken from it, when it seemed to roll: its
#: standard deviation is then this [m/s], and nothing is known of the mass (assumptions: usual noise makes 0.003, a vent that
#: takes 1.5 times as long 0.02).
DISOBEYS_ADHESION, DISOBEYS_S, MISLED_MPS = 0.03, 0.3, 1.0

#: Noise of a sensor, standard deviation [rad/s]: beyond the first it is filtered, beyond the second the sensor is left out
#: (assumptions: what policies are trained with; 0.45 m/s at the tread, more than slips worth their price).
USUAL_NOISE, MOST_NOISE = 0.1, 1.0

#: Time constant of the measured noise [s], and how much a wheel's acceleration changes from one measurement to the next [m/s2],
#: by which a noisy speed is filtered (assumptions: a moving valve changes it by 1 to 2).
NOISE_FILTER_S, CHANGE_MPS2 = 1.0, 1.0

#: Radii are learned within this share of the nominal one (assumption: wheels of one vehicle are worn by up to 8 %).
RADIUS_TOLERANCE = 0.08


class Doubts(NamedTuple):
    """What is remembered of the sensors of N vehicles with A axles, changed in place."""

    failed: np.ndarray  # (N, A) bool, not believed for the rest of the stop
    standing: np.ndarray  # (N, A) bool, stands while the vehicle runs
    raw: np.ndarray  # (N, A) as last measured [rad/s]
    same: np.ndarray  # (N, A) for how long the readings stayed the same [s]
    held_at: np.ndarray  # (N, A) running speed since which they did [m/s]
    others_at: np.ndarray  # (N, A) and mean of the other wheels [m/s]
    empty: np.ndarray  # (N, A) for how long a standing wheel's brake was empty [s]
    disobeys: np.ndarray  # (N, A) for how long a wheel was slowed by more than its brake could [s]
    difference: np.ndarray  # (N, A) of the last two readings [rad/s]
    second: np.ndarray  # (N, A) difference of the last two differences [rad/s]
    variance: np.ndarray  # (N, A) of the noise [rad2/s2]
    speed: np.ndarray  # (N, A) filtered [rad/s]
    rate: np.ndarray  # (N, A) its change in an interval [rad/s]
    ratio: np.ndarray  # (N, A) radius over the nominal one [-]
    learned: np.ndarray  # (N,) readings of the radii
    blind: np.ndarray  # (N, A) for how long braked as an axle that is not watched, see `overrule` [s]
    unbraked: np.ndarray  # (N, A) for how long the brake was as good as empty [s]
    rest: np.ndarray  # (N, A) for how long the safety timer still applies it [s]
    used: np.ndarray  # (N,) least adhesion of a watched axle, while none is released to show the speed [-]
    full: np.ndarray  # (N,) for how long each watched axle has had the brake asked for [s]
    slowing: np.ndarray  # (N, A) deceleration of the wheel, smoothed [m/s2]
    supply: np.ndarray  # (N,) the least that the distributor gives, share of full pressure [-]
    filled: np.ndarray  # (N,) and the least that it has filled a cylinder to [-]
    asked: np.ndarray  # (N,) least mean adhesion that the brakes ask for, smoothed as the deceleration is [-]
    slid: np.ndarray  # (N,) bool, a watched wheel has slowed as no vehicle does since the brake asked for was last held
    clean: np.ndarray  # (N, A) what the observer is given [rad/s]


class GuardConstants(NamedTuple):
    """What stays."""

    radius: float  # nominal [m]
    interval: float  # between measurements [s]
    slow: float  # share of `NOISE_FILTER_S` in an interval [-]
    timer: float  # the safety timer's time without brake [s]
    timer_rest: float  # and that for which it applies [s]


def allocate(n: int, axles: int) -> Doubts:
    """Return the doubts at the start of n stops: none."""
    per_vehicle = {"learned", "used", "full", "supply", "filled", "asked"}
    arrays = {name: np.zeros(n if name in per_vehicle else (n, axles)) for name in Doubts._fields}
    arrays["ratio"][:], arrays["full"][:] = 1.0, np.inf
    for name in ("failed", "standing"):
        arrays[name] = np.zeros((n, axles), dtype=bool)
    arrays["slid"] = np.zeros(n, dtype=bool)
    return Doubts(**arrays)


#: Kernels that make `Doubts` and `GuardConstants` of plain tuples.
doubts_of = rebuilder(allocate(1, 1))
guard_of = rebuilder(GuardConstants(1.0, 1.0, 1.0, 1.0, 1.0))


@inlined
def judge(
    i: int, k: int, reading: float, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants
) -> None:  # fmt: skip
    """Look for faults of one sensor; filter its noise."""
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
    d.variance[i, k] += c.slow * (third * third / 20.0 - d.variance[i, k])  # white noise makes 20 times its variance
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
    """Report a wheel that stands while the vehicle runs, or a sensor that says so: also one that is not believed."""
    d.standing[i, k] = reading * c.radius < STANDING_MPS and e.speed[i] > RUNNING_MPS


@inlined
def _obeys(i: int, k: int, d: Doubts, c: GuardConstants, e: VehicleEstimate) -> None:
    """Look whether the valve obeys."""
    d.disobeys[i, k] = d.disobeys[i, k] + c.interval if e.adhesion[i, k] < -DISOBEYS_ADHESION else 0.0
    if d.disobeys[i, k] >= DISOBEYS_S - 1e-9:
        d.failed[i, k] = True
        e.speed_variance[i], e.covariance[i] = max(e.speed_variance[i], MISLED_MPS * MISLED_MPS), 0.0
        e.mass_ratio[i], e.mass_variance[i] = 1.0, MASS_DEVIATION * MASS_DEVIATION


@inlined
def others(i: int, k: int, d: Doubts) -> float:
    """Mean reading of the other believed sensors [rad/s], 0 without any."""
    total, sound = 0.0, 0
    for j in range(d.raw.shape[1]):
        if j != k and not d.failed[i, j]:
            total += d.raw[i, j]
            sound += 1
    return total / max(sound, 1)


@inlined
def _filter(i: int, k: int, reading: float, noise: float, d: Doubts, c: GuardConstants) -> None:
    """Follow a noisy speed by the steady filter of speed and acceleration for this noise [rad2/s2] (Kalata 1984)."""
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
    """While all wheels roll freely their circumferential speeds are equal: learn the ratios of the radii."""
    most = 0.0
    for k in range(d.raw.shape[1]):
        most = max(most, brake.full_brake * e.pressure[i, k])
    if most > ROLLING_ADHESION:
        d.learned[i] = -1.0  # over: the brake acts
    elif d.learned[i] >= 0.0:
        compare(i, d)


@inlined
def compare(i: int, d: Doubts) -> None:
    """Take one more reading of the ratios of the radii, from wheels that roll freely."""
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
