"""The clock of the recorder of the vehicle's speed differs from that of the wheel speeds.

The recorded speed at t is the speed at t - offset, to first order (at 0.1 s, the jerk of a stop makes the second-order term
less than 1 cm/s). Form: definition of a clock offset; size: assumption.
"""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature


class Parameters(NamedTuple):
    """Parameters of the clock, see `CARD`."""

    offset_s: float


@inlined
def recorded(p: Parameters, speed: float, acceleration: float, time: float) -> float:
    """Return the recorded vehicle speed [m/s] from the true speed and its rate of change [m/s2]."""
    return speed - p.offset_s * acceleration


@inlined
def speed(p: Parameters, recorded: float, acceleration: float, time: float) -> float:
    """Return the vehicle speed [m/s] from the recorded one and its rate of change [m/s2]."""
    return recorded + p.offset_s * acceleration


CARD = Card(
    name="clock_offset",
    summary="vehicle speed and wheel speeds are recorded with two clocks",
    parameters=(Parameter("offset_s", "s", 0.0, 0.1, -2.0, 2.0, "assumption: the vehicle's speed is late by this"),),
    record=Parameters,
    acts={"recorded_speed": recorded, "true_speed": speed},
    signature=Signature(
        balances=frozenset({"kinematics"}),
        trace="kinematics: in proportion to dv/dt",
        acts_on="sensor",
        next_test="a sharp brake application from rolling freely, on both recorders",
        said=(
            Said(
                "offset_s",
                "ms",
                lambda late: 1e3 * late,
                "the vehicle's speed is recorded {size} late beside the wheel speeds",
                "the vehicle's speed is recorded {size} early beside the wheel speeds",
            ),
        ),
        over="deceleration",
        exact=True,
    ),
)
