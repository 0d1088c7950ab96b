"""The gradient of the track differs from the believed one: a constant force M g i, by the definition of the gradient."""

from typing import NamedTuple

from wsp_env.plant.card import Card, Parameter, Said, Signature


class Parameters(NamedTuple):
    """Parameters of the gradient, see `CARD`."""

    rise: float


def gradient(p: Parameters, believed: float) -> float:
    """Rise over distance [-], positive uphill."""
    return believed + p.rise


CARD = Card(
    name="track_gradient",
    summary="the track rises more, or falls more, than believed",
    parameters=(Parameter("rise", "-", 0.0, -0.005, -0.05, 0.05, "assumption: main lines stay within 40 per mille"),),
    record=Parameters,
    acts={"gradient": gradient},
    signature=Signature(
        balances=frozenset({"vehicle"}),
        trace="vehicle: constant, also while coasting",
        acts_on="vehicle",
        next_test="coasting over the same track in both directions",
        said=(
            Said(
                "rise",
                "per mille",
                lambda i: 1e3 * i,
                "the track rises by {size} more than believed",
                "the track falls by {size} more than believed",
            ),
        ),
        over="time",
        exact=True,
    ),
    study={"rise": -0.01},
)
