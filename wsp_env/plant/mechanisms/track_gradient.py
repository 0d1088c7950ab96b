"""The track rises or falls where it is believed to do otherwise: a constant force M g i, as the definition of the gradient."""

from typing import NamedTuple

from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter


class Parameters(NamedTuple):
    """Parameters of the gradient, see `MECHANISM`."""

    rise: float


MECHANISM = Mechanism(
    name="track_gradient",
    summary="the track rises more, or falls more, than believed",
    parameters=(Parameter("rise", "-", 0.0, -0.005, -0.05, 0.05, "assumption: main lines stay within 40 per mille"),),
    record=Parameters,
    trace="vehicle: constant, also while coasting",
)


def gradient(p: Parameters, believed: float) -> float:
    """Rise over distance [-], positive uphill."""
    return believed + p.rise
