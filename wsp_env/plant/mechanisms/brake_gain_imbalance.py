"""One axle's brake is stronger or weaker than believed (rigging, cylinder, glazed pads); in proportion to its torque."""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter


class Parameters(NamedTuple):
    """Parameters of the imbalance, see `MECHANISM`."""

    gain: float
    axle: float


MECHANISM = Mechanism(
    name="brake_gain_imbalance",
    summary="one axle's brake is stronger or weaker than believed",
    parameters=(
        Parameter("gain", "-", 0.0, -0.1, -1.0, 1.0, "assumption: relative change of one axle's torque"),
        Parameter("axle", "-", 1.0, 2.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
    ),
    record=Parameters,
    trace="actuator and adhesion: one axle, in proportion to its torque",
)


@inlined
def torque_factor(p: Parameters, k: int) -> float:
    """Brake torque over the believed one [-] of the axle with index k, from 0."""
    return 1.0 + p.gain if k + 1.0 == p.axle else 1.0
