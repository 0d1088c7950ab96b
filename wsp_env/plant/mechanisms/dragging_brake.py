"""One axle's brake drags: a torque stays on it from its first application on, whatever the pressure in the cylinder.

A caliper or rigging that sticks once it was applied does not let go of the disc. The torque is constant while the wheel turns,
also while the WSP vents the cylinder; form and size: assumption.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Doing, Parameter, Passage, Said, Signature, brakes, concerns, each_axle, itself


class Parameters(NamedTuple):
    """Parameters of the drag, see `CARD`."""

    torque_nm: float
    axle: float


class Applied(NamedTuple):
    """Whether the brakes of N vehicles with A axles have been applied."""

    once: np.ndarray  # (N, A) 1 from the first application on [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Applied:
    """Return brakes that have not been applied."""
    return Applied(np.zeros((n, len(axle_positions_m))))


@inlined
def apply(p: Parameters, applied: Applied, i: int, k: int, passage: Passage) -> None:
    """Note the first application of the brake."""
    if p.torque_nm != 0.0 and brakes(passage):
        applied.once[i, k] = 1.0


@inlined
def torque(p: Parameters, applied: Applied, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]."""
    if p.torque_nm == 0.0 or not concerns(p.axle, k):
        return torque_nm
    return torque_nm + applied.once[i, k] * p.torque_nm


CARD = Card(
    name="dragging_brake",
    summary="one axle's brake drags from its first application on",
    parameters=(
        Parameter("torque_nm", "N m", 0.0, 500.0, 0.0, 2e4, "assumption: a tenth of a coach's full torque per axle"),
        Parameter("axle", "-", 1.0, 1.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
    ),
    record=Parameters,
    acts={"torque": torque, "after_passage": apply},
    memory=memory,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion", "actuator"}),
        trace="actuator and adhesion: constant on one axle, also while its cylinder is vented",
        acts_on="brake",
        next_test="rolling with the brakes released after one application: the axle is felt, or its disc stays hot",
        said=(Said("torque_nm", "N m", itself, "axle {axle:.0f}'s brake drags with {size} once it was applied"),),
        over="axle",
        exact=True,
        variants=each_axle,
    ),
    study={"torque_nm": 1000.0},
)
