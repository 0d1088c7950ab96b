"""A stretch of track on which the contaminated rail has a different friction.

mu_cd is multiplied by 1 + change between `start_m` and `start_m + length_m`; the edges have the width `edge_m`. However wide
they are, `change` is reached in the middle: else a recording could not tell it from length and edges. Crossings and
sprayed sections (the standard's sudden change of adhesion) have sharp edges, fallen leaves have wide ones. Form and sizes:
assumption.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Recorded, Said, Signature, percent

#: Width of a sharp edge [m] (assumption: about an axle distance; keeps the friction differentiable along the track).
_SHARP_M = 2.0
#: Width of the sharpest edge that is tried in recordings [m]. The friction of sound rails varies over as little
#: (`wsp_env.diagnosis.variation`), alike for all wheels of all runs; a sharper edge would be fitted to that.
_RESOLVED_M = 3.0

#: Lengths of a patch that are tried in recordings [m]; positions are half a length apart (assumption).
_LENGTHS_M = (30.0, 60.0, 120.0)
#: Ratio of length to edges from which on half of the change is reached where the patch begins; cosh of more overflows.
_SHARP_RATIO = 100.0
#: Longer than a stop [m]: of such a patch, one end lies beyond what was recorded (assumption).
_LONGER_M = 3000.0


class Parameters(NamedTuple):
    """Parameters of the patch, see `CARD`."""

    change: float
    start_m: float
    length_m: float
    edge_m: float


@inlined
def friction_factor(p: Parameters, place_m: float) -> float:
    """Factor on mu_cd [-] at a place on the track [m]."""
    if p.change == 0.0:
        return 1.0
    entered = math.tanh((place_m - p.start_m) / p.edge_m)
    left = math.tanh((place_m - p.start_m - p.length_m) / p.edge_m)
    return 1.0 + 0.5 * p.change * (entered - left) / math.tanh(0.5 * p.length_m / p.edge_m)


def stretches(recorded: Recorded) -> list[dict[str, float]]:
    """Return the patches that are tried at the places where wheels slid."""
    if not len(recorded.places_m):
        return []
    first, last = np.quantile(recorded.places_m, [0.01, 0.99])
    return [
        {"start_m": float(start), "length_m": length, "edge_m": _RESOLVED_M}
        for length in _LENGTHS_M
        for start in np.arange(first - length / 2, last - length / 4, length / 2)
    ]


def inside(shape: Mapping[str, float], place_m: np.ndarray) -> np.ndarray:
    """Return the derivative (n,) of log mu_cd by a small change, at places (n,) [m]; see `friction_factor`."""
    entered, left = place_m - shape["start_m"], place_m - shape["start_m"] - shape["length_m"]
    edge, middle = shape["edge_m"], np.tanh(0.5 * shape["length_m"] / shape["edge_m"])
    result: np.ndarray = 0.5 * (np.tanh(entered / edge) - np.tanh(left / edge)) / middle
    return result


def half_reach_m(length_m: float, edge_m: float) -> float:
    """Return the distance from the middle [m] within which the change is at least half of that in the middle."""
    ratio = length_m / edge_m
    return 0.5 * edge_m * math.acosh(math.cosh(ratio) + 2.0) if ratio < _SHARP_RATIO else 0.5 * length_m


def where(values: Mapping[str, float]) -> dict[str, str]:
    """Return where at least half of the change is, for the sentence; of a patch longer than a stop, only its recorded end."""
    middle_m, reach_m = values["start_m"] + 0.5 * values["length_m"], half_reach_m(values["length_m"], values["edge_m"])
    start_m, end_m = middle_m - reach_m, middle_m + reach_m
    if values["length_m"] <= _LONGER_M:
        return {"where": f"from {start_m:.0f} m to {end_m:.0f} m"}
    return {"where": f"up to {end_m:.0f} m" if start_m < 0.0 else f"from {start_m:.0f} m on"}


CARD = Card(
    name="adhesion_patch",
    summary="a stretch of track has another mu_cd",
    parameters=(
        Parameter("change", "-", 0.0, -0.3, -0.95, 5.0, "assumption: relative change of mu_cd on the patch"),
        Parameter("start_m", "m", 0.0, 200.0, -1e5, 1e6, "assumption: place along the track", "shape", refit_step=2.0),
        Parameter("length_m", "m", 100.0, 100.0, 1.0, 1e5, "assumption: length of the patch", "shape", refit_step=2.0),
        Parameter(
            "edge_m",
            "m",
            _SHARP_M,
            _SHARP_M,
            0.5,
            100.0,
            "assumption: 0.76 of its change within",
            "shape",
            refit_step=0.5,
            refit_low=_RESOLVED_M,
        ),
    ),
    record=Parameters,
    acts={"contaminated_friction": friction_factor},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: aligns by place across axles and runs",
        acts_on="contact",
        next_test="a stop that begins some 100 m earlier: the patch must stay at its place",
        said=(
            Said(
                "change",
                "%",
                percent,
                "the adhesion is {size} higher {where}",
                "the adhesion is {size} lower {where}",
            ),
        ),
        over="place",
        variants=stretches,
        words=where,
        friction_pattern=inside,
    ),
    study={"change": -0.4, "start_m": 200.0, "length_m": 150.0},
)
