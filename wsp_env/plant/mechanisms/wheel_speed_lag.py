"""The wheel-speed sensors lag by a first-order filter, lag dm/dt + m = w (smoothing in the tachometer's electronics).

In the plant it filters the reading, exactly for a wheel speed that changes linearly between two readings. Along a recording,
the same equation gives the wheel speed from the reading and its derivative. Form and size: assumption.
"""

import math
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature


class Parameters(NamedTuple):
    """Parameters of the lag, see `CARD`."""

    lag_s: float


@inlined
def reading(p: Parameters, now: float, before: float, last: float, duration_s: float) -> float:
    """Return the filtered wheel speed [rad/s] from its last value, and the unfiltered speeds `duration_s` [s] apart."""
    if p.lag_s == 0.0:
        return now
    steady = p.lag_s * (now - last) / duration_s
    return now - steady + (before - last + steady) * math.exp(-duration_s / p.lag_s)


@inlined
def wheel_speed(p: Parameters, read: float, read_rate: float) -> float:
    """Return the wheel speed [rad/s] from the reading and its rate of change [rad/s2]."""
    return read + p.lag_s * read_rate


CARD = Card(
    name="wheel_speed_lag",
    summary="a filter delays the wheel-speed sensors",
    parameters=(Parameter("lag_s", "s", 0.0, 0.05, 0.0, 1.0, "assumption: time constant of the filter"),),
    record=Parameters,
    acts={"reading": reading, "wheel_speed": wheel_speed},
    signature=Signature(
        balances=frozenset({"adhesion", "kinematics"}),
        trace="kinematics and adhesion: in proportion to dw/dt",
        acts_on="sensor",
        next_test="a stop with hard, fast changes of slip, recorded with a reference tachometer on one axle",
        said=(Said("lag_s", "ms", lambda lag: 1e3 * lag, "the wheel speeds are recorded with a lag of {size}"),),
        over="deceleration",
    ),
    study={"lag_s": 0.1},
)
