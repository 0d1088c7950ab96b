"""The film follows the friction work over a rolling distance instead of at once.

The share of the film that a wheel has removed, lambda, relaxes towards the law's 1 - exp(-tau W_sp) over `distance_m` of
rolling: third-body layers on wheel and rail build up and wear off over metres (form: first order in distance, as in
T. Meierhofer, K. Six et al., third-body models of wheel-rail creep forces; size: assumption). Over a distance dx the old share
keeps the weight exp(-dx / distance), the law's own f is solved with the rest: at distance 0 it is the paper's law.
"""

import math
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter


class Parameters(NamedTuple):
    """Parameters of the memory, see `MECHANISM`."""

    distance_m: float


MECHANISM = Mechanism(
    name="contaminant_memory",
    summary="the film follows the friction work over a rolling distance",
    parameters=(Parameter("distance_m", "m", 0.0, 5.0, 0.0, 500.0, "form: first order in distance; size: assumption"),),
    record=Parameters,
    trace="adhesion: loop in (W_sp, lambda), wider the faster the slip changes",
)


@inlined
def weight_of_past(p: Parameters, rolled_m: float) -> float:
    """Weight [-] of the film's former state after rolling `rolled_m` [m] further; 0 without memory."""
    if p.distance_m == 0.0:
        return 0.0
    return math.exp(-rolled_m / p.distance_m)
