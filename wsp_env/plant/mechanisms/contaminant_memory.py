"""The contaminant layer follows the friction work over a rolled distance instead of immediately.

The removed share of the layer, lambda, relaxes towards the law's 1 - exp(-tau W_sp) over `distance_m` of rolling: third-body
layers on wheel and rail build up and wear off over metres (form: first order in distance, as in T. Meierhofer, K. Six et al.,
third-body models of wheel-rail creep forces; size: assumption). Over a distance dx, the old share keeps the weight exp(-dx /
distance), and f is solved with the remaining weight. At distance 0 this is the paper's law.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature, itself


class Parameters(NamedTuple):
    """Parameters of the memory, see `CARD`."""

    distance_m: float


class Removed(NamedTuple):
    """Removed shares of the contaminant layer, for the wheels of N vehicles with A axles."""

    share: np.ndarray  # (N, A) lambda [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Removed:
    """Return the state of wheels that have removed nothing."""
    return Removed(np.zeros((n, len(axle_positions_m))))


@inlined
def split(
    p: Parameters, removed: Removed, i: int, k: int, place_m: float, rolled_m: float, layer: float, held: float
) -> tuple[float, float]:  # fmt: skip
    """Shares of the layer [-] after rolling `rolled_m` [m]: the part subject to this wheel's work, and the lagging part."""
    if p.distance_m == 0.0:
        return layer, held
    past = math.exp(-rolled_m / p.distance_m)
    return layer * (1.0 - past), held + layer * past * (1.0 - removed.share[i, k])


@inlined
def follow(p: Parameters, removed: Removed, i: int, k: int, rolled_m: float, kept: float) -> None:
    """Relax the removed share towards that by the wheel's work, 1 - `kept` [-], over `rolled_m` [m]."""
    if p.distance_m != 0.0:
        past = math.exp(-rolled_m / p.distance_m)
        removed.share[i, k] = past * removed.share[i, k] + (1.0 - past) * (1.0 - kept)


CARD = Card(
    name="contaminant_memory",
    summary="the contaminant layer follows the friction work over a rolling distance",
    parameters=(
        Parameter("distance_m", "m", 0.0, 5.0, 0.0, 500.0, "form: first order in distance; size: assumption", rolled=True),
    ),
    record=Parameters,
    acts={"layer": split, "after_contact": follow},
    memory=memory,
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: loop in (W_sp, lambda), wider the faster the slip changes",
        acts_on="contact",
        next_test="a stop in which the demand is stepped, so that the slip changes fast and slowly",
        said=(Said("distance_m", "m", itself, "the contaminant layer follows the friction work only after rolling {size}"),),
        over="work",
    ),
)
