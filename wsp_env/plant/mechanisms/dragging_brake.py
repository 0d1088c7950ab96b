"""The brake of one axle drags: a torque remains after its first application, whatever the cylinder pressure.

A caliper or rigging that sticks after an application does not release the disc. If it has stuck since the previous stop, it
drags from the start. Otherwise its torque may take a time to build up. It does not follow the cylinder pressure: while the WSP
vents the cylinder it remains. Form and size: assumption.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Doing, Parameter, Passage, Recorded, Said, Signature, brakes, concerns, itself, never

#: Time constant of the drag with which the search begins (assumption).
_RISE_S = 0.3


class Parameters(NamedTuple):
    """Parameters of the drag, see `CARD`."""

    torque_nm: float
    axle: float
    from_start: float
    rise_s: float


class Applied(NamedTuple):
    """State of the brakes of N vehicles with A axles: for how long they have been able to stick."""

    since_s: np.ndarray  # (N, A) time since the first application; 0 before [s]


def memory(n: int, axle_positions_m: Sequence[float]) -> Applied:
    """Return the state of brakes that have not been applied."""
    return Applied(np.zeros((n, len(axle_positions_m))))


@inlined
def apply(p: Parameters, applied: Applied, i: int, k: int, passage: Passage) -> None:
    """Count the time from the first application of the brake on."""
    if p.torque_nm != 0.0 and (applied.since_s[i, k] > 0.0 or brakes(passage)):
        applied.since_s[i, k] += passage.duration_s


@inlined
def torque(p: Parameters, applied: Applied, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]."""
    if p.torque_nm == 0.0 or not concerns(p.axle, k):
        return torque_nm
    if p.from_start != 0.0:
        return torque_nm + p.torque_nm
    since_s = applied.since_s[i, k]
    if since_s == 0.0:
        return torque_nm
    built_up = 1.0 if p.rise_s == 0.0 else 1.0 - math.exp(-(since_s + doing.duration_s) / p.rise_s)
    return torque_nm + built_up * p.torque_nm


def when(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the start of the drag in words."""
    if values["from_start"]:
        return {"when": "from the start"}
    rise = values.get("rise_s", 0.0)
    return {"when": f"once it was applied, with a time constant of {rise:.1f} s" if rise >= 0.05 else "once it was applied"}


def axles_and_beginnings(recorded: Recorded) -> list[dict[str, float]]:
    """Return the variants: every axle, with a drag after the first application and with a drag from the start."""
    starts: tuple[dict[str, float], ...] = ({"from_start": 0.0, "rise_s": _RISE_S}, {"from_start": 1.0})
    return [{"axle": k + 1.0} | start for k in range(recorded.axles) for start in starts]


CARD = Card(
    name="dragging_brake",
    summary="one axle's brake drags, from its first application or from the start on",
    parameters=(
        Parameter("torque_nm", "N m", 0.0, 500.0, 0.0, 2e4, "assumption: a tenth of a coach's full torque per axle"),
        Parameter("axle", "-", 1.0, 1.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
        Parameter("from_start", "-", 0.0, 0.0, 0.0, 1.0, "0: once it was applied; 1: from the start", "shape"),
        Parameter(
            "rise_s", "s", 0.0, 0.0, 0.0, 10.0, "assumption: time constant, once it was applied", "shape", refit_step=0.1
        ),
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
