"""The vehicle is heavier or lighter than believed, due to payload or a missing weighing."""

from typing import NamedTuple

from wsp_env.plant.card import Card, Parameter, Said, Signature, percent


class Parameters(NamedTuple):
    """Parameters of the mass, see `CARD`."""

    extra: float


def mass(p: Parameters, believed_kg: float) -> float:
    """Mass of the vehicle [kg]."""
    return believed_kg * (1.0 + p.extra)


CARD = Card(
    name="vehicle_mass",
    summary="the vehicle is heavier or lighter than believed",
    parameters=(Parameter("extra", "-", 0.0, 0.1, -0.5, 1.0, "assumption: share of the believed mass; payload is some 15 %"),),
    record=Parameters,
    acts={"mass": mass},
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion"}),
        trace="vehicle: in proportion to the deceleration; through the wheel load also uniformly in adhesion",
        acts_on="vehicle",
        next_test="weighing the vehicle, or a gentle stop beside one with known ballast",
        said=(
            Said(
                "extra",
                "%",
                percent,
                "the vehicle is {size} heavier than believed",
                "the vehicle is {size} lighter than believed",
            ),
        ),
        over="time",
        exact=True,
    ),
    study={"extra": 0.15},
)
