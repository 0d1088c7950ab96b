"""An error of the recorded speed without a name: a coefficient times a feature of the vehicle's motion.

A radar looks at the track at an angle. If its carrier pitches under braking, its reading changes: the cosine error is
proportional to the pitch, hence to the deceleration, and to the speed. An integrated acceleration drifts with time, a scale
with temperature. The diagnosis finds such errors with those features of `wsp_env.plant.mechanisms.terms` that depend only on
the vehicle's motion and on time.
"""

from collections.abc import Mapping
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature, itself
from wsp_env.plant.mechanisms.discovered import no_variants
from wsp_env.plant.mechanisms.terms import UNBOUNDED, Feature, Slot, Term, of_the_vehicle

_RECORDED_SPEED = int(Slot.RECORDED_SPEED)  # code as an integer for compiled code


class Parameters(NamedTuple):
    """Parameters of the error, see `CARD`."""

    coefficient: float
    feature: float


@inlined
def _error(p: Parameters, speed: float, acceleration: float, time: float) -> float:
    """Error of the recorded speed [m/s]; it does not depend on the place."""
    term = Term(p.coefficient, _RECORDED_SPEED, 0.0, p.feature, 1.0, 1.0, -UNBOUNDED, UNBOUNDED)
    return p.coefficient * of_the_vehicle(term, time, 0.0, speed, -acceleration)


@inlined
def recorded(p: Parameters, speed: float, acceleration: float, time: float) -> float:
    """Return the recorded vehicle speed [m/s] from the true speed, its rate of change [m/s2] and the time [s]."""
    return speed + _error(p, speed, acceleration, time) if p.coefficient != 0.0 else speed


@inlined
def true(p: Parameters, speed: float, acceleration: float, time: float) -> float:
    """Return the vehicle speed [m/s] from the recorded one, to first order in the error."""
    return speed - _error(p, speed, acceleration, time) if p.coefficient != 0.0 else speed


def term_of(parameters: Mapping[str, float]) -> Term:
    """Return the error as a term."""
    return Term(parameters["coefficient"], Slot.RECORDED_SPEED, 0.0, parameters["feature"])


CARD = Card(
    name="misread_speed",
    summary="the recorded speed of the vehicle errs by a coefficient times a feature of its motion",
    parameters=(
        Parameter(
            "coefficient",
            "m/s / of feature",
            0.0,
            0.02,
            -1e3,
            1e3,
            "assumption: a radar at 40 degrees on a bogie that pitches by 0.05 degrees per m/s2",
            fitted=False,
        ),
        Parameter(
            "feature",
            "code",
            float(Feature.SPEED_DECELERATION),
            float(Feature.SPEED_DECELERATION),
            0.0,
            float(max(Feature)),
            "terms.Feature: one of the vehicle's motion and time",
            "shape",
        ),
    ),
    record=Parameters,
    acts={"recorded_speed": recorded, "true_speed": true},
    signature=Signature(
        balances=frozenset({"kinematics", "vehicle"}),
        trace="kinematics: all axles alike, as its feature goes; vehicle: the same in the speed itself",
        acts_on="sensor",
        next_test="the same stops with a second sensor of the vehicle's speed of another kind",
        said=(
            Said(
                "coefficient",
                "m/s",
                itself,
                "the recorded speed is too high by {size} times its feature",
                "the recorded speed is too low by {size} times its feature",
            ),
        ),
        over="deceleration",
        variants=no_variants,
    ),
    named=False,
)
