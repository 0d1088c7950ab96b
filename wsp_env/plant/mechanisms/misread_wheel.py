"""A wheel-speed sensor whose scale errs: the share of the speed that is misread is a coefficient times a feature.

A sensor that is not linear errs with the speed; a converter whose reference warms up errs with time; one that is too slow loses
pulses above a speed. A scale that is wrong by the same share throughout is another radius. The plant's sensor errs from its
first reading after the start on. Along a recording the error is undone to second order, and the wheel's rate is left as it was
read (with an error of 1 %, the torque that turns the wheelset errs by 1 %).
"""

from collections.abc import Mapping
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature, percent
from wsp_env.plant.mechanisms.discovered import no_variants
from wsp_env.plant.mechanisms.terms import UNBOUNDED, Feature, Slot, Term, concerns, of_the_vehicle

#: Range of speeds about `above_mps` within which the error rises from 0 to all of it [m/s] (assumption).
RISE_MPS = 1.0

_WHEEL_READING = int(Slot.WHEEL_READING)  # code as an integer for compiled code


class Parameters(NamedTuple):
    """Parameters of the error, see `CARD`."""

    coefficient: float
    axles: float
    feature: float
    above_mps: float


@inlined
def reading_factor(p: Parameters, k: int, wheel_mps: float, time: float) -> float:
    """Return the reading of axle k's sensor over the true speed, from the circumferential speed [m/s] and the time [s]."""
    if p.coefficient == 0.0 or not concerns(p.axles, k):
        return 1.0
    term = Term(p.coefficient, _WHEEL_READING, p.axles, p.feature, 1.0, 1.0, -UNBOUNDED, UNBOUNDED)
    share = 1.0 if p.above_mps == 0.0 else min(max((wheel_mps - p.above_mps) / RISE_MPS + 0.5, 0.0), 1.0)
    return 1.0 + share * p.coefficient * of_the_vehicle(term, time, 0.0, wheel_mps, 0.0)


def term_of(parameters: Mapping[str, float]) -> Term:
    """Return the error as a term; its scale is the speed from which it acts."""
    coefficient, axles, feature = (parameters[name] for name in ("coefficient", "axles", "feature"))
    return Term(coefficient, Slot.WHEEL_READING, axles, feature, parameters.get("above_mps", 0.0))


CARD = Card(
    name="misread_wheel",
    summary="wheel-speed sensors misread a share of the speed: a coefficient times a feature of the wheel's motion",
    parameters=(
        Parameter(
            "coefficient",
            "1 / of feature",
            0.0,
            0.01,
            -0.5,
            0.5,
            "assumption: one tooth in a hundred is missed at 30 m/s",
            fitted=False,
        ),
        Parameter("axles", "bit mask", 0.0, 0.0, 0.0, 2.0**32, "1 for axle 1, 2 for axle 2, 4 for axle 3 ...; 0: all", "shape"),
        Parameter(
            "feature",
            "code",
            float(Feature.SPEED),
            float(Feature.SPEED),
            0.0,
            float(max(Feature)),
            "terms.Feature: SPEED, the wheel's own circumferential speed over 30 m/s; TIME; or ALWAYS, above a speed",
            "shape",
        ),
        Parameter("above_mps", "m/s", 0.0, 0.0, 0.0, 100.0, "its own speed from which it errs", "shape"),
    ),
    record=Parameters,
    acts={"reading_factor": reading_factor},
    signature=Signature(
        balances=frozenset({"kinematics", "adhesion"}),
        trace="kinematics and adhesion of its axles: as its feature goes",
        acts_on="sensor",
        next_test="the same stops with a second sensor on that axle",
        said=(
            Said(
                "coefficient",
                "%",
                percent,
                "wheel speeds are read too high by {size} times a feature",
                "wheel speeds are read too low by {size} times a feature",
            ),
        ),
        over="speed",
        variants=no_variants,
    ),
    named=False,
)
