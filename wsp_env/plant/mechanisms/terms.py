"""Terms: physics without a name, as a coefficient times a feature of an axle's motion, in one slot of the plant.

A feature is a causal state of the plant. One compiled function computes it in the plant's step, in the evaluation along a
recording and, by `features_along`, for a search that is linear in the coefficients.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import kernel, loop
from wsp_env.plant.card import Doing, doing_at


class Slot(IntEnum):
    """Where a term acts: coefficient times feature is ..."""

    BRAKE_TORQUE = 0  # added to the brake torque of each axle [N m]
    FRICTION = 1  # the relative change of both friction coefficients under each axle [-]
    RECOVERY = 2  # added to the logarithm of the recovery rate tau under each axle [-]
    VEHICLE_FORCE = 3  # added to the force against the motion [N]; the feature is averaged over the axles
    RECORDED_SPEED = 4  # added to the recorded speed of the vehicle [m/s]: see `misread_speed`
    WHEEL_READING = 5  # the share by which the sensor of each axle's wheel speed reads too high [-]: see `misread_wheel`


class Feature(IntEnum):
    """Quantity on which a term depends. Square brackets: unit; parentheses: units of its scale and second scale."""

    BRAKING = 0  # 1 while the believed torque is above `BRAKING_SHARE` of the full one [-]
    ALWAYS = 1  # 1 [-]
    SPEED = 2  # running speed over 30 m/s [-]
    SPEED_SQUARED = 3  # its square [-]
    SLIP = 4  # slip speed [m/s]
    SLIP_SIGN = 5  # tanh(slip speed / scale) [-] (m/s)
    TORQUE = 6  # believed torque over full torque [-]
    WHEEL_RATE = 7  # r dw/dt [m/s2]
    TORQUE_MEMORY = 8  # (believed torque, low-passed with a time constant, minus believed torque) over full torque [-] (s)
    SLIP_RATE = 9  # tanh(rate of the slip speed / scale) [-] (m/s2)
    TIME = 10  # since the start of the stop [s]
    BRAKING_TIME = 11  # since braking began [s]
    SINE = 12  # sin(2 pi scale t) [-] (Hz)
    COSINE = 13  # cos(2 pi scale t) [-] (Hz)
    WHEEL_SINE = 14  # sin(scale x wheel angle) [-] (per turn of the wheel)
    WHEEL_COSINE = 15  # cos(scale x wheel angle) [-] (per turn of the wheel)
    PLACE_BUMP = 16  # raised cosine along the track [-] (m, its middle; m, its whole width)
    WHEEL_DIFFERENCE = 17  # r (w - mean w of the other axles) [m/s]
    WORK = 18  # friction work that the axle has done so far [MJ]
    BUILT_UP = 19  # low-passed state, target 1 while the wheel slides, else 0 [-] (s, time constant; m/s, slip threshold)
    SPEED_TENT = 20  # 1 at a speed, falling linearly to 0 around it; several form a spline [-] (m/s, middle; m/s, half width)
    SLIP_TENT = 21  # the same over slip speed [-] (m/s; m/s)
    TIME_TENT = 22  # the same over time [-] (s; s)
    SPEED_DECELERATION = 23  # running speed over 30 m/s, times deceleration [m/s2]
    SPEED_TIME = 24  # running speed over 30 m/s, times the time since the start of the stop [s]
    TORQUE_SINE = 25  # believed torque over full torque, times sin(scale x wheel angle) [-] (per turn of the wheel)
    TORQUE_COSINE = 26  # the same with the cosine [-] (per turn of the wheel)
    TORQUE_PLAY = 27  # believed torque over full torque, negative while rising, positive while falling [-] (share of it, play)
    SETTLING = 28  # exp(-time since braking began / scale), 0 before [-] (s)
    TORQUE_SETTLING = 29  # believed torque over full torque, times the same [-] (s)
    TORQUE_WARMING = 30  # believed torque over full torque, times exp(-work of the axle's brake so far / scale) [-] (MJ)
    FADING_OUT = 31  # 1 until braking begins, then exp(-time since then / scale) [-] (s)


#: Share of the full torque above which an axle counts as braking (assumption: above the noise of a recorded pressure).
BRAKING_SHARE = 0.02

#: Time constant of feature SLIP_RATE [s] (assumption: two substeps; without a lag, a friction that depends on the slip rate
#: that it causes would oscillate from substep to substep; recordings do not resolve shorter times).
RATE_LAG_S = 0.02

#: Running speed at which feature SPEED is 1 [m/s].
REFERENCE_MPS = 30.0

#: Bound of a feature without limits.
UNBOUNDED = 1e9

#: Smallest scale in a division.
_LEAST = 1e-9

# The codes as integers for compiled code.
(
    _BRAKING, _ALWAYS, _SPEED, _SPEED_SQUARED, _SLIP, _SLIP_SIGN, _TORQUE, _WHEEL_RATE, _TORQUE_MEMORY, _SLIP_RATE, _TIME,
    _BRAKING_TIME, _SINE, _COSINE, _WHEEL_SINE, _WHEEL_COSINE, _PLACE_BUMP, _WHEEL_DIFFERENCE, _WORK, _BUILT_UP, _SPEED_TENT,
    _SLIP_TENT, _TIME_TENT, _SPEED_DECELERATION, _SPEED_TIME, _TORQUE_SINE, _TORQUE_COSINE,
    _TORQUE_PLAY, _SETTLING, _TORQUE_SETTLING, _TORQUE_WARMING, _FADING_OUT,
) = map(int, Feature)  # fmt: skip


class Term(NamedTuple):
    """One term; all fields are floats, as in a record of parameters."""

    coefficient: float = 0.0  # in the unit of its slot over that of its feature
    slot: float = Slot.BRAKE_TORQUE
    axles: float = 0.0  # bit mask: 1 for axle 1, 2 for axle 2, 4 for axle 3 ...; 0: all
    feature: float = Feature.BRAKING
    scale: float = 1.0  # see `Feature`
    second_scale: float = 1.0
    low: float = -UNBOUNDED  # limits of the feature: the range in the recordings
    high: float = UNBOUNDED


class Past(NamedTuple):
    """State of a term for one axle."""

    lagged: float = 0.0  # believed torque over full torque, low-passed, or with play [-]
    built: float = 0.0  # state of BUILT_UP [-], or work of the brake [MJ]
    braked_s: float = 0.0  # time since braking began [s]
    slip_rate: float = 0.0  # low-passed [m/s2]


@kernel
def concerns(axles: float, k: int) -> bool:
    """Whether a bit mask includes the axle with index k, from 0."""
    mask = int(axles)
    return mask == 0 or (mask >> k) & 1 == 1


@kernel
def brought_up_to_date(term: Term, past: Past, doing: Doing) -> Past:
    """Return the state `doing.duration_s` later, under the axle's present motion; states of other features may stay as is."""
    share = doing.believed_torque / doing.full_torque
    if doing.time_s == 0.0:  # steady state at the start
        return Past(share, 0.0, 0.0, doing.slip_rate)
    code, lagged, built, rate = int(term.feature), past.lagged, past.built, past.slip_rate
    braked = past.braked_s + doing.duration_s if share > BRAKING_SHARE or past.braked_s > 0.0 else 0.0
    if code in (_TORQUE_MEMORY, _BUILT_UP):
        follows = 1.0 - math.exp(-doing.duration_s / max(term.scale, _LEAST))
        lagged += follows * (share - lagged)
        built += follows * ((1.0 if abs(doing.slip) > term.second_scale else 0.0) - built)
    elif code == _TORQUE_WARMING:
        built += 1e-6 * doing.believed_torque * doing.wheel * doing.duration_s
    elif code == _TORQUE_PLAY:
        lagged = min(max(lagged, (1.0 - term.scale) * share), (1.0 + term.scale) * share)
    elif code == _SLIP_RATE:
        rate += (1.0 - math.exp(-doing.duration_s / RATE_LAG_S)) * (doing.slip_rate - rate)
    return Past(lagged, built, braked, rate)


@kernel
def _tent(x: float, middle: float, half_width: float) -> float:
    return max(1.0 - abs(x - middle) / max(half_width, _LEAST), 0.0)


@kernel
def _bump(x: float, middle: float, width: float) -> float:
    share = (x - middle) / max(width, _LEAST)
    return 0.5 + 0.5 * math.cos(2.0 * math.pi * share) if abs(share) < 0.5 else 0.0


@kernel
def _kept_by_mean(rate: float, duration: float) -> float:
    """Return the share of a sine's amplitude that a mean over a duration keeps; rate in rad/s."""
    half = 0.5 * rate * duration
    return math.sin(half) / half if abs(half) > _LEAST else 1.0


@kernel
def _feature(code: int, scale: float, second: float, past: Past, doing: Doing) -> float:
    share = doing.believed_torque / doing.full_torque
    if code == _BRAKING:
        return 1.0 if share > BRAKING_SHARE else 0.0
    if code == _SPEED:
        return doing.speed / REFERENCE_MPS
    if code == _SPEED_SQUARED:
        return (doing.speed / REFERENCE_MPS) ** 2
    if code == _SLIP:
        return doing.slip
    if code == _SLIP_SIGN:
        return math.tanh(doing.slip / max(scale, _LEAST))
    if code == _TORQUE:
        return share
    if code == _WHEEL_RATE:
        return doing.radius_m * doing.wheel_rate
    if code == _TORQUE_MEMORY:
        return past.lagged - share
    if code == _SLIP_RATE:
        return math.tanh(past.slip_rate / max(scale, _LEAST))
    if code == _TIME:
        return doing.time_s
    if code == _BRAKING_TIME:
        return past.braked_s
    if code == _SINE:
        return math.sin(2.0 * math.pi * scale * doing.time_s)
    if code == _COSINE:
        return math.cos(2.0 * math.pi * scale * doing.time_s)
    if code == _WHEEL_SINE:
        return math.sin(scale * doing.angle_rad) * _kept_by_mean(scale * doing.wheel, doing.mean_s)
    if code == _WHEEL_COSINE:
        return math.cos(scale * doing.angle_rad) * _kept_by_mean(scale * doing.wheel, doing.mean_s)
    if code == _TORQUE_SINE:
        return share * math.sin(scale * doing.angle_rad) * _kept_by_mean(scale * doing.wheel, doing.mean_s)
    if code == _TORQUE_COSINE:
        return share * math.cos(scale * doing.angle_rad) * _kept_by_mean(scale * doing.wheel, doing.mean_s)
    if code in (_SETTLING, _TORQUE_SETTLING):
        decays = math.exp(-past.braked_s / max(scale, _LEAST)) if past.braked_s > 0.0 else 0.0
        return share * decays if code == _TORQUE_SETTLING else decays
    if code == _FADING_OUT:
        return math.exp(-past.braked_s / max(scale, _LEAST))
    if code == _TORQUE_WARMING:
        return share * math.exp(-past.built / max(scale, _LEAST))
    if code == _TORQUE_PLAY:
        return (past.lagged - share) / max(scale, _LEAST)
    if code == _PLACE_BUMP:
        return _bump(doing.place_m, scale, second)
    if code == _WHEEL_DIFFERENCE:
        others = doing.axles / max(doing.axles - 1.0, 1.0)
        return doing.radius_m * (doing.wheel - doing.mean_wheel) * others
    if code == _WORK:
        return 1e-6 * doing.contact_work
    if code == _BUILT_UP:
        return past.built
    if code == _SPEED_TENT:
        return _tent(doing.speed, scale, second)
    if code == _SLIP_TENT:
        return _tent(doing.slip, scale, second)
    if code == _TIME_TENT:
        return _tent(doing.time_s, scale, second)
    if code == _SPEED_DECELERATION:
        return doing.speed / REFERENCE_MPS * doing.deceleration
    if code == _SPEED_TIME:
        return doing.speed / REFERENCE_MPS * doing.time_s
    return 1.0


@kernel
def feature_value(term: Term, past: Past, doing: Doing) -> float:
    """Return the feature of a term, limited to its range; `past` must be up to date."""
    value = _feature(int(term.feature), term.scale, term.second_scale, past, doing)
    return min(max(value, term.low), term.high)


@kernel
def is_of_the_vehicle(feature: float) -> bool:
    """Whether a feature depends only on the vehicle's motion and time, and thus is equal for all axles."""
    code = int(feature)
    return code in (
        _SPEED, _SPEED_SQUARED, _TIME, _SINE, _COSINE, _SPEED_TENT, _TIME_TENT, _SPEED_DECELERATION, _SPEED_TIME,
    )  # fmt: skip


@kernel
def of_the_vehicle(term: Term, time: float, place: float, speed: float, deceleration: float) -> float:
    """Return a feature that depends only on the vehicle's motion and time, at the present time."""
    none = 0.0
    doing = Doing(
        time, none, speed, deceleration, none, none, none, none, place, none, 1.0, 1.0, none, none, 1.0, none, none,
    )  # fmt: skip
    return feature_value(term, Past(none, none, none, none), doing)


@loop
def _along(doings: np.ndarray, term: Term, values: np.ndarray) -> None:
    for k in range(values.shape[1]):
        past = Past(0.0, 0.0, 0.0, 0.0)
        for j in range(values.shape[0]):
            doing = doing_at(doings, j, k, doings[_DURATION, j, k])
            past = brought_up_to_date(term, past, doing)
            values[j, k] = feature_value(term, past, doing)


_DURATION = Doing._fields.index("duration_s")


def features_along(doings: np.ndarray, term: Term) -> np.ndarray:
    """Return the feature of a term (T, A) along a recorded stop, with the functions of the plant's step.

    Parameters
    ----------
    doings : (fields of `Doing`, T, A), as filled by `wsp_env.plant.longitudinal.along.along`
    term : its coefficient, slot and axles are ignored

    """
    values: np.ndarray = np.empty(doings.shape[1:])
    _along(np.ascontiguousarray(doings), Term(*map(float, term)), values)
    return values
