"""The rail changes from stop to stop: the remaining contaminant layer is removed faster or more slowly.

tau is multiplied by exp(per_stop n) after n earlier stops on the same rail. P. Voltr, M. Lata, Vehicle System Dynamics 53
(2015) 605-618, measured that sliding cleans contaminated surfaces and that their friction stays above the initial level. The
form (a change of the recovery rate, equal from each stop to the next) and the size are assumptions. In a campaign, n of a
recording is its place in the list of runs. An environment uses the parameter's value, or draws it for each stop.
"""

import math
from typing import NamedTuple

from wsp_env.plant.card import Card, Parameter, Said, Signature

#: Number of earlier stops if it is unknown (assumption: the middle of a usual campaign).
_USUAL = 4.0


class Parameters(NamedTuple):
    """Parameters of the drift, see `CARD`."""

    per_stop: float
    earlier_stops: float


def tau(p: Parameters, believed_m_per_j: float) -> float:
    """Recovery rate [m/J] after the earlier stops."""
    return believed_m_per_j * math.exp(p.per_stop * p.earlier_stops)


CARD = Card(
    name="rail_drift",
    summary="the recovery rate changes from stop to stop on the same rail",
    parameters=(
        Parameter("per_stop", "-", 0.0, 0.1, -1.0, 1.0, "direction: Voltr, Lata (2015); size: assumption, log tau per stop"),
        Parameter("earlier_stops", "-", _USUAL, _USUAL, 0.0, 100.0, "assumption: stops before on the same rail", "stop"),
    ),
    record=Parameters,
    acts={"tau": tau},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: grows from run to run with the friction work, and not at small slip",
        acts_on="contact",
        next_test="the first stop of the series once more, at its end and at the same place",
        said=(
            Said(
                "per_stop",
                "%",
                lambda rate: 100.0 * math.expm1(rate),
                "the contaminant layer goes sooner from stop to stop: the recovery rate rises by {size} with each",
                "the contaminant layer goes later from stop to stop: the recovery rate falls by {size} with each",
            ),
        ),
        over="work",
        least_stops=3,  # with two stops, any difference between them looks like a drift
    ),
    study={"per_stop": 0.2},
)
