"""Terms: physics without a name, as a coefficient times a feature of what an axle is doing, in one slot of the plant.

A feature is a causal state of the plant. It is computed by one compiled function, in the plant's step, in the evaluation along
a recording and, by `features_along`, for a search that is linear in the coefficients.
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
    VEHICLE_FORCE = 3  # added to the force against the motion [N], with the mean of the feature over the axles
    RECORDED_SPEED = 4  # added to the recorded speed of the vehicle [m/s]: see `misread_speed`


class Feature(IntEnum):
    """What a term depends on. In brackets what its scale, and its second scale, are."""

    BRAKING = 0  # 1 while the believed torque is above `BRAKING_SHARE` of the full one [-]
    ALWAYS = 1  # 1 [-]
    SPEED = 2  # running speed over 30 m/s [-]
    SPEED_SQUARED = 3  # its square [-]
    SLIP = 4  # slip speed [m/s]
    SLIP_SIGN = 5  # tanh(slip speed / scale) [-] (m/s)
    TORQUE = 6  # believed torque over full torque [-]
    WHEEL_RATE = 7  # r dw/dt [m/s2]
    TORQUE_MEMORY = 8  # torque share that follows the believed one with a time constant, less the latter [-] (s)
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
    BUILT_UP = 19  # builds up towards 1 while the wheel slides, else decays [-] (s, time constant; m/s, of slip from which on)
    SPEED_TENT = 20  # 1 at a speed, linearly down to 0 around it: several make a spline [-] (m/s, middle; m/s, half width)
    SLIP_TENT = 21  # the same over slip speed [-] (m/s; m/s)
    TIME_TENT = 22  # the same over time [-] (s; s)
    SPEED_DECELERATION = 23  # running speed over 30 m/s, times deceleration [m/s2]
    SPEED_TIME = 24  # running speed over 30 m/s, times the time since the start of the stop [s]
    TORQUE_SINE = 25  # believed torque over full torque, times sin(scale x wheel angle) [-] (per turn of the wheel)
    TORQUE_COSINE = 26  # the same with the cosine [-] (per turn of the wheel)
    TORQUE_PLAY = 27  # believed torque over full torque, - while it rises, + while it falls [-] (share of it, play)
    SETTLING = 28  # exp(-time since braking began / scale) [-] (s)
    TORQUE_SETTLING = 29  # believed torque over full torque, times the same [-] (s)


#: Share of the full torque from which on an axle brakes (assumption: above the noise of a recorded pressure).
BRAKING_SHARE = 0.02

#: Time constant by which feature SLIP_RATE follows the rate of the slip speed [s] (assumption: two substeps, or a friction that
#: depends on the rate that it makes itself would swing from substep to substep; recordings resolve less).
RATE_LAG_S = 0.02

#: Running speed that feature SPEED is 1 at [m/s].
REFERENCE_MPS = 30.0

#: Where a feature is not held at an edge.
UNBOUNDED = 1e9

#: Least scale that is divided by.
_LEAST = 1e-9

# The codes as compiled code takes them.
(
    _BRAKING, _ALWAYS, _SPEED, _SPEED_SQUARED, _SLIP, _SLIP_SIGN, _TORQUE, _WHEEL_RATE, _TORQUE_MEMORY, _SLIP_RATE, _TIME,
    _BRAKING_TIME, _SINE, _COSINE, _WHEEL_SINE, _WHEEL_COSINE, _PLACE_BUMP, _WHEEL_DIFFERENCE, _WORK, _BUILT_UP, _SPEED_TENT,
    _SLIP_TENT, _TIME_TENT, _SPEED_DECELERATION, _SPEED_TIME, _TORQUE_SINE, _TORQUE_COSINE,
    _TORQUE_PLAY, _SETTLING, _TORQUE_SETTLING,
) = map(int, Feature)  # fmt: skip


class Term(NamedTuple):
    """One term; all floats, as a record of parameters holds them."""

    coefficient: float = 0.0  # in the unit of its slot over that of its feature
    slot: float = Slot.BRAKE_TORQUE
    axles: float = 0.0  # bit mask, 1 for axle 1, 2 for axle 2, 4 for axle 3 ...; 0: all
    feature: float = Feature.BRAKING
    scale: float = 1.0  # see `Feature`
    second_scale: float = 1.0
    low: float = -UNBOUNDED  # the feature is held at the edges of what recordings showed
    high: float = UNBOUNDED


class Past(NamedTuple):
    """What a term remembers of an axle."""

    lagged: float = 0.0  # believed torque over full torque, low-passed, or with play [-]
    built: float = 0.0  # latent state [-]
    braked_s: float = 0.0  # since braking began
    slip_rate: float = 0.0  # low-passed [m/s2]


@kernel
def concerns(axles: float, k: int) -> bool:
    """Whether a mask means the axle with index k, from 0."""
    mask = int(axles)
    return mask == 0 or (mask >> k) & 1 == 1


@kernel
def brought_up_to_date(term: Term, past: Past, doing: Doing) -> Past:
    """Return what is remembered `doing.duration_s` later, under what the axle does now, of that which the feature asks for."""
    share = doing.believed_torque / doing.full_torque
    if doing.time_s == 0.0:  # steady at the start
        return Past(share, 0.0, 0.0, doing.slip_rate)
    code, lagged, built, rate = int(term.feature), past.lagged, past.built, past.slip_rate
    braked = past.braked_s + doing.duration_s if share > BRAKING_SHARE or past.braked_s > 0.0 else 0.0
    if code in (_TORQUE_MEMORY, _BUILT_UP):
        follows = 1.0 - math.exp(-doing.duration_s / max(term.scale, _LEAST))
        lagged += follows * (share - lagged)
        built += follows * ((1.0 if abs(doing.slip) > term.second_scale else 0.0) - built)
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
        return math.sin(scale * doing.angle_rad)
    if code == _WHEEL_COSINE:
        return math.cos(scale * doing.angle_rad)
    if code == _TORQUE_SINE:
        return share * math.sin(scale * doing.angle_rad)
    if code == _TORQUE_COSINE:
        return share * math.cos(scale * doing.angle_rad)
    if code in (_SETTLING, _TORQUE_SETTLING):
        return (share if code == _TORQUE_SETTLING else 1.0) * math.exp(-past.braked_s / max(scale, _LEAST))
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
    """Return the feature of a term, held at the edges of its range; `past` is brought up to date."""
    value = _feature(int(term.feature), term.scale, term.second_scale, past, doing)
    return min(max(value, term.low), term.high)


@kernel
def is_of_the_vehicle(feature: float) -> bool:
    """Whether a feature depends on the vehicle's motion and on time only, the same for every axle."""
    code = int(feature)
    return code in (
        _SPEED, _SPEED_SQUARED, _TIME, _SINE, _COSINE, _SPEED_TENT, _TIME_TENT, _SPEED_DECELERATION, _SPEED_TIME,
    )  # fmt: skip


@kernel
def of_the_vehicle(term: Term, time: float, place: float, speed: float, deceleration: float) -> float:
    """Return a feature that depends on the vehicle's motion and on time only, at this very moment."""
    none = 0.0
    doing = Doing(
        time, none, speed, deceleration, none, none, none, none, place, none, 1.0, 1.0, none, none, 1.0, none,
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
    """Return the feature of a term (T, A) along a recorded stop, by the functions that the plant's step takes.

    Parameters
    ----------
    doings : (fields of `Doing`, T, A), as `wsp_env.plant.longitudinal.along.along` fills it
    term : its coefficient, slot and axles do not matter

    """
    values: np.ndarray = np.empty(doings.shape[1:])
    _along(np.ascontiguousarray(doings), Term(*map(float, term)), values)
    return values
