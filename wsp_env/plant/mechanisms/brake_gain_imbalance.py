"""The brake of one axle is stronger or weaker than believed, in proportion to its torque (rigging, cylinder, glazed pads)."""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature, each_axle, percent


class Parameters(NamedTuple):
    """Parameters of the imbalance, see `CARD`."""

    gain: float
    axle: float


@inlined
def torque_factor(p: Parameters, i: int, k: int, wheel_mps: float, pressure_bar: float) -> float:
    """Brake torque over the believed one [-]; k is the index of the axle, from 0."""
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
        next_test="a gentle stop on each axle's brake alone",
        said=(
            Said(
                "gain",
                "%",
                percent,
                "axle {axle:.0f}'s brake is {size} stronger than believed",
                "axle {axle:.0f}'s brake is {size} weaker than believed",
            ),
        ),
        over="axle",
        exact=True,
        variants=each_axle,
    ),
    study={"gain": -0.15},
)
