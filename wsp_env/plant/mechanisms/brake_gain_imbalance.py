"""One axle's brake is stronger or weaker than believed (rigging, cylinder, glazed pads); in proportion to its torque."""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Signature


class Parameters(NamedTuple):
    """Parameters of the imbalance, see `CARD`."""

    gain: float
    axle: float


@inlined
def torque_factor(p: Parameters, i: int, k: int, wheel_mps: float, pressure_bar: float) -> float:
    """Brake torque over the believed one [-] of the axle with index k, from 0."""
    return 1.0 + p.gain if k + 1.0 == p.axle else 1.0


CARD = Card(
    name="brake_gain_imbalance",
    summary="one axle's brake is stronger or weaker than believed",
    parameters=(
        Parameter("gain", "-", 0.0, -0.1, -1.0, 1.0, "assumption: relative change of one axle's torque"),
        Parameter("axle", "-", 1.0, 2.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
    ),
    record=Parameters,
    acts={"torque_factor": torque_factor},
    signature=Signature(
        balances=frozenset({"adhesion", "actuator"}),
        trace="actuator and adhesion: one axle, in proportion to its torque",
        acts_on="brake",
    ),
)
