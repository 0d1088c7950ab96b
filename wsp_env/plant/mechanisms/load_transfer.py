"""Braking transfers load to the leading bogie, and within each bogie to its leading axle.

Quasi-static moments, including the rotation of the wheels. The inertia force of the carbody acts at a height above the pivots,
where the bogies retard it, and loads the leading bogie. For each bogie with its wheelsets, the moments about the rail balance:

    moment = h sum T + a (m_frame h_frame + sum m_wheelset r - (m_frame + sum m_wheelset) h) - sum J dw/dt.

The wheels are retarded by T at the rail. The body pulls at height h with this force less the inertia force of the bogie's own
masses. Wheelsets that slow down release angular momentum, whichever part of it their brakes pass to the frame as torque. The
moment loads the leading axle. Textbook statics, e.g. K. Knothe, S. Stichel, Rail Vehicle Dynamics (2017), chapter on traction
and braking. Masses and heights of frame and wheelsets are those of the vehicle (`parameters.multibody`). Their part and that of
J dw/dt are exact at the vehicle's own drawing height, and proportional to `pivot_height_m` otherwise (assumption: the mechanism
is then linear in its two heights, and recordings need not determine a third size).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.card import Card, Parameter, Passage, Said, Signature, itself, never


class Parameters(NamedTuple):
    """Heights of the load transfer, see `CARD`."""

    body_height_m: float
    pivot_height_m: float


class Levers(NamedTuple):
    """Levers from moments to the load of one wheel of every axle (A,), and further constants of the vehicle."""

    body: np.ndarray  # per M a h_body, including the carbody's share of M [1/m]
    bogie: np.ndarray  # per moment of the axle's bogie [1/m]
    first: np.ndarray  # index of the first axle of its bogie
    end: np.ndarray  # index after the last axle of its bogie
    borne: np.ndarray  # moment of its bogie's own masses about the drawing height, per deceleration [kg m]
    drawn_m: float  # drawing height, at which `borne` and J dw/dt count in full [m]


class Driven(NamedTuple):
    """Forces and moments of the wheelsets of N vehicles with A axles."""

    force: np.ndarray  # (N, A) T of the wheelset [N]
    turning: np.ndarray  # (N, A) J dw/dt [N m]


def memory(n: int, axle_positions_m: Sequence[float]) -> Driven:
    """Return the state of wheelsets without force."""
    return Driven(*(np.zeros((n, len(axle_positions_m))) for _ in Driven._fields))


def arms(
    axle_positions_m: tuple[float, ...], bodies: tuple[tuple[int, ...], ...]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the changes of the load of one wheel of every axle [1/m]: per M a h of the body, and per moment of its bogie.

    Each body has the mass share that its axles carry, and brakes itself: couplings transmit no moment. On two supports, the
    change of load balances the moment. On more supports, it is linear in the distance from their centre (assumption: a rigid
    body on springs, with stiffness proportional to the number of axles below). A single support takes no moment (assumption:
    the rest of the vehicle takes the moment of a single bogie or wheelset). The changes of a vehicle sum to zero.

    Parameters
    ----------
    axle_positions_m : behind the leading axle [m], ascending
    bodies : axles of each bogie, body by body from the front, see `Vehicle.running_gear`

    """
    axles = len(axle_positions_m)
    body_arms: list[float] = []
    bogie_arms: list[float] = []
    for body in bodies:
        centres = []
        for count in body:
            own = axle_positions_m[len(bogie_arms) : len(bogie_arms) + count]
            centres.append(sum(own) / count)
            bogie_arms += [lever / 2 for lever in _levers(own, (1,) * count)]  # two wheels an axle
        for count, lever in zip(body, _levers(tuple(centres), body), strict=True):
            body_arms += [sum(body) / axles * lever / (2 * count)] * count
    return tuple(body_arms), tuple(bogie_arms)


def _levers(places_m: tuple[float, ...], stiffness: tuple[int, ...]) -> tuple[float, ...]:
    """Return the change of each support's load [1/m] per pitching moment forward; `stiffness` in any unit."""
    if len(places_m) == 1:
        return (0.0,)
    if len(places_m) == 2:
        lever = 1.0 / (places_m[1] - places_m[0])
        return lever, -lever
    centre = sum(k * x for k, x in zip(stiffness, places_m, strict=True)) / sum(stiffness)
    turning = sum(k * (x - centre) ** 2 for k, x in zip(stiffness, places_m, strict=True))
    return tuple(k * (centre - x) / turning for k, x in zip(stiffness, places_m, strict=True))


def derive(vehicle: Vehicle) -> Levers:
    """Return the levers of a vehicle.

    Two or more axles under one support of a body are a bogie with a frame. Bodies lighter than their bogies and wheelsets have
    no mass of their own (assumption).
    """
    m, radius = vehicle.multibody, vehicle.wheel_radius_m
    wheelset_kg, height = m.wheelset_mass_kg + 2.0 * m.axle_box_mass_kg, m.drawing_height_m
    bogies = [count for body in vehicle.running_gear for count in body]
    frames_kg = [m.bogie_mass_kg if count > 1 else 0.0 for count in bogies]
    share = max(1.0 - (sum(frames_kg) + vehicle.axles * wheelset_kg) / vehicle.mass_kg, 0.0)
    body, bogie = arms(vehicle.axle_positions_m, vehicle.running_gear)
    ends = np.cumsum(bogies)
    borne = [
        frame * (m.bogie_height_m - height) + count * wheelset_kg * (radius - height)
        for frame, count in zip(frames_kg, bogies, strict=True)
    ]
    return Levers(
        share * np.array(body), np.array(bogie), np.repeat(ends - bogies, bogies), np.repeat(ends, bogies),
        np.repeat(borne, bogies), height,
    )  # fmt: skip


@inlined
def remember(p: Parameters, lever: Levers, driven: Driven, i: int, k: int, passage: Passage) -> None:
    """Store force and angular momentum change of an axle's wheelset."""
    if p.pivot_height_m == 0.0:
        return
    driven.force[i, k] = passage.force_n
    driven.turning[i, k] = passage.turning_nm


@inlined
def wheel_load(
    p: Parameters, lever: Levers, driven: Driven, i: int, k: int, load: float, mass_kg: float, deceleration_mps2: float
) -> float:  # fmt: skip
    """Load of one wheel [N] of axle k at a deceleration [m/s2], with the forces of the previous substep; at least zero."""
    load += mass_kg * deceleration_mps2 * p.body_height_m * lever.body[k]
    if p.pivot_height_m != 0.0:
        force, turning = 0.0, 0.0
        for j in range(lever.first[k], lever.end[k]):
            force += driven.force[i, j]
            turning += driven.turning[i, j]
        arm = force + (deceleration_mps2 * lever.borne[k] - turning) / lever.drawn_m
        load += p.pivot_height_m * arm * lever.bogie[k]
    return max(load, 0.0)


def steadily(p: Parameters, vehicle: Vehicle) -> np.ndarray:
    """Return the change of one wheel's load (A,) per deceleration [N / (m/s2)], with all wheels rolling and equal brakes."""
    lever = derive(vehicle)
    turning = vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m  # - J dw/dt per deceleration
    per_bogie = lever.end - lever.first
    arm = per_bogie * vehicle.mass_kg / vehicle.axles + (lever.borne + per_bogie * turning) / lever.drawn_m
    result: np.ndarray = vehicle.mass_kg * p.body_height_m * lever.body + p.pivot_height_m * arm * lever.bogie
    return result


CARD = Card(
    name="load_transfer",
    summary="deceleration loads the leading bogie and the leading axle of each bogie",
    parameters=(
        Parameter(
            "body_height_m", "m", 0.0, 1.2, 0.0, 4.0, "assumption: centre of mass 1.8 m (Manchester vehicle 1), pivots 0.6 m"
        ),
        Parameter("pivot_height_m", "m", 0.0, 0.6, 0.0, 2.0, "assumption: height of the traction rod above the rail"),
    ),
    record=Parameters,
    acts={"wheel_load": wheel_load, "after_passage": remember},
    derive=derive,
    memory=memory,
    recalls=never,
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
