"""A stretch of track with another friction of the contaminated rail.

mu_cd is multiplied by 1 + change between `start_m` and `start_m + length_m`, with edges of `EDGE_M` (leaves, a crossing, a
sprayed section: the standard's sudden change of adhesion). Form and sizes: assumption.
"""

import math
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Signature

#: Width of an edge [m] (assumption: about an axle distance; keeps the friction differentiable by place).
EDGE_M = 2.0


class Parameters(NamedTuple):
    """Parameters of the patch, see `CARD`."""

    change: float
    start_m: float
    length_m: float


@inlined
def friction_factor(p: Parameters, place_m: float) -> float:
    """Factor of mu_cd [-] at a place on the track [m]."""
    if p.change == 0.0:
        return 1.0
    entered = math.tanh((place_m - p.start_m) / EDGE_M)
    left = math.tanh((place_m - p.start_m - p.length_m) / EDGE_M)
    return 1.0 + 0.5 * p.change * (entered - left)


CARD = Card(
    name="adhesion_patch",
    summary="a stretch of track has another mu_cd",
    parameters=(
        Parameter("change", "-", 0.0, -0.3, -0.95, 5.0, "assumption: relative change of mu_cd on the patch"),
        Parameter("start_m", "m", 0.0, 200.0, -1e5, 1e6, "assumption: place along the track", "shape"),
        Parameter("length_m", "m", 100.0, 100.0, 1.0, 1e5, "assumption: length of the patch", "shape"),
    ),
    record=Parameters,
    acts={"contaminated_friction": friction_factor},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: aligns by place across axles and runs",
        acts_on="contact",
    ),
)
