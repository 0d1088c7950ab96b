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


def arms(
    axle_positions_m: tuple[float, ...], bodies: tuple[tuple[int, ...], ...]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return per axle the factors [1/m] of body and pivot height: wheel load change = M a (h_body * body + h_pivot * pivot).

    Every body and bogie has the share of the mass that its axles carry, and brakes itself: couplings carry no moment. On two
    supports the change is what balances the moment; on more it grows linearly with the distance from their centre (assumption:
    a rigid body on springs as stiff as the axles below them are many); a single support takes no moment (assumption: a bogie or
    wheelset by itself leaves it to the rest of the vehicle). The factors of a vehicle sum to zero.

    Parameters
    ----------
    axle_positions_m : behind the leading axle [m], rising
    bodies : axles of each bogie, body by body from the front, see `Vehicle.running_gear`

    """
    axles = len(axle_positions_m)
    body_arms: list[float] = []
    pivot_arms: list[float] = []
    for body in bodies:
        centres = []
        for count in body:
            own = axle_positions_m[len(pivot_arms) : len(pivot_arms) + count]
            centres.append(sum(own) / count)
            pivot_arms += [count / axles * lever / 2 for lever in _levers(own, (1,) * count)]  # two wheels an axle
        for count, lever in zip(body, _levers(tuple(centres), body), strict=True):
            body_arms += [sum(body) / axles * lever / (2 * count)] * count
    return tuple(body_arms), tuple(pivot_arms)


def _levers(places_m: tuple[float, ...], stiffness: tuple[int, ...]) -> tuple[float, ...]:
    """Return what each support's load changes by [1/m] per moment forward about them; `stiffness` in any unit."""
    if len(places_m) == 1:
        return (0.0,)
    if len(places_m) == 2:
        lever = 1.0 / (places_m[1] - places_m[0])
        return lever, -lever
    centre = sum(k * x for k, x in zip(stiffness, places_m, strict=True)) / sum(stiffness)
    turning = sum(k * (x - centre) ** 2 for k, x in zip(stiffness, places_m, strict=True))
    return tuple(k * (centre - x) / turning for k, x in zip(stiffness, places_m, strict=True))


def derive(vehicle: Vehicle) -> Arms:
    """Return the arms of a vehicle."""
    body, pivot = arms(vehicle.axle_positions_m, vehicle.running_gear)
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
