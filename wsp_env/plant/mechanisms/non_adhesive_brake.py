"""A brake independent of the wheels: magnetic or eddy-current track brake, within a band of speed.

The force is constant between two speeds, with edges of width `EDGE_MPS`, after the first application of the brake (magnetic
track brakes of coaches are lowered in emergency stops and lifted at low speed; size: assumption).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Moment, Parameter, Passage, Recorded, Said, Signature, brakes, never

#: Width of the band's edges [m/s] (assumption).
EDGE_MPS = 0.5

#: Speeds below which the brake is lifted, as tried in recordings [m/s]; the first means never. A speed signal accurate to some
#: cm/s determines them to well below 2 m/s.
_LIFTED_MPS = (-10.0, *range(6, 25, 2))


class Parameters(NamedTuple):
    """Parameters of the track brake, see `CARD`."""

    force_n: float
    lowest_mps: float
    highest_mps: float


class Applied(NamedTuple):
    """State of the brakes of N vehicles: applied or not yet."""

    once: np.ndarray  # (N,) 1 after the first application [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Applied:
    """Return the state of brakes that have not been applied."""
    return Applied(np.zeros(n))


@inlined
def apply(p: Parameters, applied: Applied, i: int, k: int, passage: Passage) -> None:
    """Store the first application of the brake."""
    if p.force_n != 0.0 and brakes(passage):
        applied.once[i] = 1.0


@inlined
def force(p: Parameters, applied: Applied, i: int, speed_mps: float, believed_n: float, moment: Moment) -> float:
    """Force against the motion [N]."""
    if p.force_n == 0.0:
        return 0.0
    above = math.tanh((speed_mps - p.lowest_mps) / EDGE_MPS)
    beyond = math.tanh((speed_mps - p.highest_mps) / EDGE_MPS)
    return 0.5 * applied.once[i] * p.force_n * (above - beyond)


def bands(recorded: Recorded) -> list[dict[str, float]]:
    """Return the bands of speed that are tried."""
    return [{"lowest_mps": float(low), "highest_mps": 200.0} for low in _LIFTED_MPS]


def band(values: Mapping[str, float]) -> dict[str, str]:
    """Return the band in words, for the sentence."""
    lowest = values["lowest_mps"]
    return {"band": f"above {lowest:.0f} m/s" if lowest > 0.0 else "at every speed"}


CARD = Card(
    name="non_adhesive_brake",
    summary="a track brake acts within a band of speed",
    parameters=(
        Parameter("force_n", "N", 0.0, 5000.0, 0.0, 2e5, "assumption: a tenth of a coach's braking force"),
        Parameter("lowest_mps", "m/s", 10.0, 10.0, -10.0, 100.0, "assumption: lifted at low speed", "shape", refit_step=0.5),
        Parameter("highest_mps", "m/s", 100.0, 100.0, 0.0, 200.0, "assumption: no upper limit", "shape"),
    ),
    record=Parameters,
    acts={"force": force, "after_passage": apply},
    memory=memory,
    recalls=never,
    signature=Signature(
        balances=frozenset({"vehicle"}),
        trace="vehicle: deceleration beyond the wheels' sum, within its band of speed",
        acts_on="vehicle",
        next_test="a stop with the track brake cut out",
        said=(Said("force_n", "kN", lambda force: 1e-3 * force, "a brake that needs no wheels gives {size} {band}"),),
        over="speed",
        variants=bands,
        words=band,
    ),
    study={"force_n": 2000.0},
)
