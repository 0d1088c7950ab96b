"""The brake of one axle drags: a torque remains after its first application, whatever the cylinder pressure.

A caliper or rigging that sticks after an application does not release the disc. If it has stuck since the previous stop, it
drags from the start. The torque is constant while the wheel turns, also while the WSP vents the cylinder. Form and size:
assumption.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Doing, Parameter, Passage, Recorded, Said, Signature, brakes, concerns, itself, never


class Parameters(NamedTuple):
    """Parameters of the drag, see `CARD`."""

    torque_nm: float
    axle: float
    from_start: float


class Applied(NamedTuple):
    """State of the brakes of N vehicles with A axles: applied or not yet."""

    once: np.ndarray  # (N, A) 1 after the first application [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Applied:
    """Return the state of brakes that have not been applied."""
    return Applied(np.zeros((n, len(axle_positions_m))))


@inlined
def apply(p: Parameters, applied: Applied, i: int, k: int, passage: Passage) -> None:
    """Store the first application of the brake."""
    if p.torque_nm != 0.0 and brakes(passage):
        applied.once[i, k] = 1.0


@inlined
def torque(p: Parameters, applied: Applied, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]."""
    if p.torque_nm == 0.0 or not concerns(p.axle, k):
        return torque_nm
    drags = applied.once[i, k] if p.from_start == 0.0 else 1.0
    return torque_nm + drags * p.torque_nm


def when(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the start of the drag in words."""
    return {"when": "from the start" if values["from_start"] else "once it was applied"}


def axles_and_beginnings(recorded: Recorded) -> list[dict[str, float]]:
    """Return the variants: every axle, with a drag after the first application and with a drag from the start."""
    return [{"axle": k + 1.0, "from_start": start} for k in range(recorded.axles) for start in (0.0, 1.0)]


CARD = Card(
    name="dragging_brake",
    summary="one axle's brake drags, from its first application or from the start on",
    parameters=(
        Parameter("torque_nm", "N m", 0.0, 500.0, 0.0, 2e4, "assumption: a tenth of a coach's full torque per axle"),
        Parameter("axle", "-", 1.0, 1.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
        Parameter("from_start", "-", 0.0, 0.0, 0.0, 1.0, "0: once it was applied; 1: from the start", "shape"),
    ),
    record=Parameters,
    acts={"torque": torque, "after_passage": apply},
    memory=memory,
    recalls=never,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion", "actuator"}),
        trace="actuator and adhesion: constant on one axle, also while its cylinder is vented",
        acts_on="brake",
        next_test="rolling with the brakes released after one application: the axle is felt, or its disc stays hot",
        said=(Said("torque_nm", "N m", itself, "axle {axle:.0f}'s brake drags with {size} {when}"),),
        over="axle",
        exact=True,
        variants=axles_and_beginnings,
        words=when,
    ),
    study={"torque_nm": 1000.0},
)
