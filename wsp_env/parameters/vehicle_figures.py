"""What a vehicle's parameters amount to: axle loads, decelerations, braked weight, times of the brake, in closed form.

Stops here are on a level, dry rail with rolling wheels: full demand at once, the distributor's ramp, the cylinder's lag.
"""

import math
from typing import NamedTuple

from wsp_env.parameters.vehicle import Brake, Vehicle

#: Braked weight percentage C / s - D of a stop from 120 km/h over s [m] (second-hand of UIC 544-1, passenger coaches, brake
#: position P; not checked against the leaflet, so an assumption).
BRAKED_WEIGHT_SPEED_KMH = 120.0
_BRAKED_WEIGHT_C_M, _BRAKED_WEIGHT_D = 83_634.0, 8.8

#: Adhesion [-] beyond which a brake asks for more than can be counted on (assumption; interoperability rules speak of 0.15).
RELIED_ON_ADHESION = 0.15

#: Axle load [t] beyond which few lines take a vehicle (assumption: line category D).
LARGEST_AXLE_LOAD_T = 22.5

_NEARLY = 0.95  # share of full pressure at which a cylinder counts as full


class VehicleFigure(NamedTuple):
    """One derived number."""

    name: str
    value: float
    unit: str
    digits: int = 2


def figures(vehicle: Vehicle) -> tuple[VehicleFigure, ...]:
    """Return what the parameters of a vehicle amount to, empty and laden."""
    brake, found = vehicle.brake, []
    for state, mass in (("empty", vehicle.mass_kg), ("laden", vehicle.mass_kg + vehicle.payload_kg)):
        distance = stopping_distance_m(vehicle, mass, BRAKED_WEIGHT_SPEED_KMH / 3.6)
        percentage = max(_BRAKED_WEIGHT_C_M / max(distance, 1e-3) - _BRAKED_WEIGHT_D, 0.0)
        found += [
            VehicleFigure(f"mass, {state}", mass / 1000.0, "t"),
            VehicleFigure(f"axle load, {state}", mass / vehicle.axles / 1000.0, "t"),
            VehicleFigure(f"deceleration at full brake, {state}", deceleration_mps2(vehicle, mass), "m/s2", 3),
            VehicleFigure(f"adhesion that full brake asks for, {state}", asked_adhesion(vehicle, mass), "-", 3),
            VehicleFigure(f"stop from {BRAKED_WEIGHT_SPEED_KMH:g} km/h on dry rail, {state}", distance, "m", 0),
            VehicleFigure(f"braked weight percentage, {state}", percentage, "%", 0),
            VehicleFigure(f"braked weight, {state}", percentage / 100.0 * mass / 1000.0, "t", 1),
        ]
    ring = 2.0 * math.pi * vehicle.wheel_radius_m / vehicle.tachometer.pulses_per_turn
    return (
        *found,
        VehicleFigure("brake torque of an axle at full pressure", vehicle.full_brake_torque_nm / 1000.0, "kN m"),
        VehicleFigure(f"time to {_NEARLY:.0%} of full pressure, demand at once", filling_s(brake, brake.demand_rise_s), "s"),
        VehicleFigure("the same by a dump valve from empty, distributor full", filling_s(brake, 0.0), "s"),
        VehicleFigure(
            f"time to vent to {1 - _NEARLY:.0%}", brake.dead_time_s - brake.vent_time_constant_s * math.log(1 - _NEARLY), "s"
        ),
        VehicleFigure("way between two pulses of a tachometer", 1000.0 * ring, "mm", 1),
        VehicleFigure("mass of the turning wheelsets at the rail", _turning_kg(vehicle) / 1000.0, "t"),
    )


def remarks(vehicle: Vehicle) -> tuple[str, ...]:
    """Return, sentence by sentence, what may be meant otherwise."""
    laden = vehicle.mass_kg + vehicle.payload_kg
    load, asked = laden / vehicle.axles / 1000.0, asked_adhesion(vehicle, vehicle.mass_kg)
    found = []
    if load > LARGEST_AXLE_LOAD_T:
        found.append(f"axle load {load:.1f} t laden: above the {LARGEST_AXLE_LOAD_T:g} t of most lines")
    if asked > RELIED_ON_ADHESION:
        found.append(f"full brake asks for an adhesion of {asked:.2f} when empty: wheels may slide on dry rail too")
    if vehicle.length_m <= vehicle.axle_positions_m[-1]:
        found.append(
            f"length_m = {vehicle.length_m:g} is not above the distance of the outer axles, {vehicle.axle_positions_m[-1]:g} "
            "m: no train can be made of it"
        )
    try:
        table = vehicle.contact.table_c11
    except ValueError:
        found.append("the contact ellipse is beyond Kalker's table: kalker_c11 cannot be compared")
    else:
        if abs(vehicle.contact.kalker_c11 / table - 1.0) > 0.02:
            found.append(
                f"kalker_c11 = {vehicle.contact.kalker_c11:g}, while Kalker's table has {table:.2f} for the ellipse at a "
                f"Poisson's ratio of {vehicle.contact.poisson_ratio:g}"
            )
    return tuple(found)


def deceleration_mps2(vehicle: Vehicle, mass_kg: float) -> float:
    """Return the deceleration [m/s2] at full brake, of rolling wheels, without running resistance."""
    force = vehicle.axles * vehicle.full_brake_torque_nm / vehicle.wheel_radius_m
    return force / (mass_kg + _turning_kg(vehicle))


def asked_adhesion(vehicle: Vehicle, mass_kg: float) -> float:
    """Return the adhesion coefficient [-] that full brake asks for: what is left of the torque slows the wheelset itself."""
    return deceleration_mps2(vehicle, mass_kg) / vehicle.gravity_mps2


def stopping_distance_m(vehicle: Vehicle, mass_kg: float, speed_mps: float) -> float:
    """Return the way [m] of a stop: the build-up counts as time lost at the first speed, half the ramp and the whole lag."""
    lost = 0.5 * vehicle.brake.demand_rise_s + vehicle.brake.fill_time_constant_s
    deceleration = deceleration_mps2(vehicle, mass_kg)
    return speed_mps * lost + 0.5 * speed_mps**2 / deceleration if deceleration > 0.0 else math.inf  # a torque of 1e-300 N m


def filling_s(brake: Brake, rise_s: float) -> float:
    """Return the time [s] to nearly full pressure behind a ramp of so long; at 0 the distributor is full, the valve opens."""
    lag = brake.fill_time_constant_s
    if rise_s <= 0.0:
        return brake.dead_time_s - lag * math.log(1.0 - _NEARLY)

    def pressure(t: float) -> float:
        ramp = min(t, rise_s)
        left = (ramp - lag * (1.0 - math.exp(-ramp / lag))) / rise_s
        return left if t <= rise_s else 1.0 - (1.0 - left) * math.exp(-(t - rise_s) / lag)

    low, high = 0.0, rise_s + 50.0 * lag
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if pressure(middle) < _NEARLY else (low, middle)
    return high


def venting_s(brake: Brake) -> float:
    """Return the time [s] from the command until a full cylinder is nearly empty."""
    return brake.dead_time_s - brake.vent_time_constant_s * math.log(1.0 - _NEARLY)


def _turning_kg(vehicle: Vehicle) -> float:
    return vehicle.axles * vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
