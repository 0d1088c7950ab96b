"""Braking shifts load to the leading bogie, and within each bogie to its leading axle.

Quasi-static moments about the rail: the carbody's inertia force acts at a height above the bogie pivots and loads the leading
bogie; each bogie's brake forces act at the rail, its share of the vehicle's inertia at the pivot height above it, and loads its
leading axle. Textbook statics, e.g. K. Knothe, S. Stichel, Rail Vehicle Dynamics (2017), chapter on traction and braking.
"""

from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.card import Card, Parameter, Said, Signature, itself


class Parameters(NamedTuple):
    """Heights of the load transfer, see `CARD`."""

    body_height_m: float
    pivot_height_m: float


class Arms(NamedTuple):
    """Wheel load change = M a (h_body * body + h_pivot * pivot) of every axle."""

    body: np.ndarray  # (A,) [1/m]
    pivot: np.ndarray  # (A,) [1/m]


def arms(axle_positions_m: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return per axle the factors [1/m] of body and pivot height: wheel load change = M a (h_body * body + h_pivot * pivot).

    A single wheelset transfers nothing; two axles are one bogie; four are two bogies. The factors of a vehicle sum to zero.
    """
    axles = len(axle_positions_m)
    if axles == 1:
        return (0.0,), (0.0,)
    if axles == 2:
        lever = 1.0 / (axle_positions_m[1] - axle_positions_m[0])
        return (0.0, 0.0), (lever / 2, -lever / 2)  # two wheels an axle
    a, b, c, d = axle_positions_m
    distance = (c + d - a - b) / 2
    body = 1.0 / distance / 4  # four wheels a bogie
    pivot = 1.0 / 4  # half the mass a bogie, two wheels an axle
    return (body, body, -body, -body), (pivot / (b - a), -pivot / (b - a), pivot / (d - c), -pivot / (d - c))


def derive(vehicle: Vehicle) -> Arms:
    """Return the arms of a vehicle."""
    body, pivot = arms(vehicle.axle_positions_m)
    return Arms(np.array(body), np.array(pivot))


@inlined
def wheel_load(p: Parameters, arm: Arms, static_n: float, k: int, mass_kg: float, deceleration_mps2: float) -> float:
    """Load of one wheel [N] of axle k under a deceleration [m/s2]; never below zero."""
    lever = p.body_height_m * arm.body[k] + p.pivot_height_m * arm.pivot[k]
    return max(static_n + mass_kg * deceleration_mps2 * lever, 0.0)


CARD = Card(
    name="load_transfer",
    summary="deceleration loads the leading bogie and the leading axle of each bogie",
    parameters=(
        Parameter("body_height_m", "m", 0.0, 1.0, 0.0, 3.0, "assumption: centre of mass 1.6 m, pivots 0.6 m above the rail"),
        Parameter("pivot_height_m", "m", 0.0, 0.6, 0.0, 2.0, "assumption: height of the traction rod above the rail"),
    ),
    record=Parameters,
    acts={"wheel_load": wheel_load},
    derive=derive,
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: sign alternates from axle to axle and grows with the deceleration",
        acts_on="contact",
        next_test="a stop at half the brake demand: load transfer falls with the deceleration",
        said=(
            Said("body_height_m", "m", itself, "braking loads the leading bogie: the body's mass acts {size} above the pivots"),
            Said(
                "pivot_height_m",
                "m",
                itself,
                "braking loads each bogie's leading axle: the pivots are {size} above the rail",
            ),
        ),
        over="axle",
        least_axles=2,
    ),
    study={"body_height_m": 1.6, "pivot_height_m": 0.6},
)
