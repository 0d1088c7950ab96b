"""What the observer estimates of N vehicles, `VehicleEstimate`, and what it takes for certain, `EstimatorConstants`."""

from typing import NamedTuple

import numpy as np

from wsp_env.contact import degraded
from wsp_env.contact.polach import saturation_slope
from wsp_env.observer import bounds
from wsp_env.parameters.vehicle import Vehicle

#: Time constant of the recent low-passed use of adhesion [s] (assumption).
USED_FILTER_S = 2.0

#: Time constant of the mean by which a wheel is faster than the estimated running speed [s] (assumption).
FASTER_FILTER_S = 0.1

#: Time constant for smoothing the used adhesion [s]; half the brake's own times.
ADHESION_FILTER_S = 0.1


class VehicleEstimate(NamedTuple):
    """Estimates for N vehicles with A axles, changed in place: read them, do not keep references."""

    speed: np.ndarray  # (N,) running speed [m/s]
    uncertainty: np.ndarray  # (N,) its standard deviation [m/s]
    doubtful: np.ndarray  # (N,) bool, a wheelset should roll to make the running speed certain
    distributor: np.ndarray  # (N,) pressure of the distributor, share of full pressure [-]
    demand: np.ndarray  # (N,) last demand, share of full pressure [-]
    mass_ratio: np.ndarray  # (N,) q, nominal over true mass [-]
    speed_variance: np.ndarray  # (N,) variance of the running speed [m2/s2]
    covariance: np.ndarray  # (N,) covariance of running speed and q [m/s]
    mass_variance: np.ndarray  # (N,) variance of q [-]
    rise: np.ndarray  # (N,) r, logarithm of the distributor's rise time over the nominal one [-]
    rise_variance: np.ndarray  # (N,) variance of r [-]
    rise_speed: np.ndarray  # (N,) covariance of running speed and r [m/s]
    rise_mass: np.ndarray  # (N,) covariance of q and r [-]
    other: np.ndarray  # (N,) a, deceleration by other forces than those of the rail [m/s2]
    other_variance: np.ndarray  # (N,) variance of a [m2/s4]
    other_speed: np.ndarray  # (N,) covariance of running speed and a [m2/s3]
    other_mass: np.ndarray  # (N,) covariance of q and a [m/s2]
    other_rise: np.ndarray  # (N,) covariance of r and a [m/s2]
    distributor_by_rise: np.ndarray  # (N,) derivative of the distributor's pressure with respect to r [-]
    pressure_by_rise: np.ndarray  # (N, A) derivative of the cylinder pressure with respect to r [-]
    since_slide: np.ndarray  # (N,) time since a wheel slid [s]; inf: no wheel has
    wheel: np.ndarray  # (N, A) circumferential wheel speed [m/s]
    pressure: np.ndarray  # (N, A) cylinder pressure, share of full pressure [-]
    pressure_to_come: np.ndarray  # (N, A) cylinder pressure after all commands under way have acted [-]
    most_distributor: np.ndarray  # (N,) highest possible pressure of the distributor, share of full pressure [-]
    most_pressure: np.ndarray  # (N, A) highest possible cylinder pressure, see `wsp_env.observer.bounds` [-]
    vented: np.ndarray  # (N, A) time for which all commands under way have been to vent [s]
    unseen: np.ndarray  # (N, A) possible excess of the brake over the estimate, as an adhesion, smoothed [-]
    adhesion: np.ndarray  # (N, A) used adhesion T / N, smoothed [-]
    usual_adhesion: np.ndarray  # (N, A) used adhesion, low-passed with `USED_FILTER_S` [-]
    rolling_adhesion: np.ndarray  # (N, A) brake adhesion below which a wheelset rolls [-]
    rolling_time: np.ndarray  # (N, A) time below that limit [s]
    ahead: np.ndarray  # (N, A) wheel speed minus running speed, smoothed [m/s]
    trusted: np.ndarray  # (N, A) bool, the wheel's speed may correct the running speed, see `wsp_env.observer.guard`
    commands: np.ndarray  # (N, K, A) commands under way to the valves, newest first


class EstimatorConstants(NamedTuple):
    """Nominal values of the vehicle with half its payload, and gains of the filters in an interval."""

    radius: float  # of a wheel [m]
    full_pressure: float  # [bar]
    interval: float  # between measurements [s]
    by_pressure: bool  # whether commands are pressures
    mass: float  # [kg]
    axle_weight: float  # [N]
    full_force: float  # brake force of a wheelset at full pressure, at the tread [N]
    full_brake: float  # see `full_brake` [-]
    rotating: float  # a wheelset's inertia as an equivalent mass [kg]
    creep: float  # creepage of a wheel that rolls under brake, over the adhesion it uses [-]
    rise: float  # change of the distributor's pressure in an interval, share of full pressure [-]
    fill: float  # gain of the approach in an interval [-]: filling of a cylinder
    vent: float  # venting of a cylinder [-]
    fill_most: float  # fastest filling [-]
    vent_least: float  # slowest venting [-]
    usual: float  # gain of `USED_FILTER_S` [-]
    smooth: float  # gain of `ADHESION_FILTER_S` [-]
    lift: float  # gain of `FASTER_FILTER_S` [-]


def full_brake(vehicle: Vehicle) -> float:
    """Return the adhesion [-] that full pressure requires of a wheelset with half the payload."""
    weight = (vehicle.mass_kg + 0.5 * vehicle.payload_kg) * vehicle.gravity_mps2 / vehicle.axles
    return vehicle.full_brake_torque_nm / vehicle.wheel_radius_m / weight


def _creep(vehicle: Vehicle, mass: float) -> float:
    """Return the creepage over the adhesion [-] of a rolling wheel on contaminated rail: the start of Polach's curve."""
    law = degraded.LAW.make(vehicle.contact)
    load = mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles)
    return load / (law.stiffness * saturation_slope(0.0, law.k_ad, law.k_sd))


def approach(interval: float, time_constant: float) -> float:
    """Return the gain [-] of a first-order low-pass in an interval; interval and time constant in [s]."""
    return float(1.0 - np.exp(-interval / time_constant))


def constants(vehicle: Vehicle, interval: float, by_pressure: bool) -> EstimatorConstants:
    """Return the constants for a measurement interval [s] and commands that are pressures or valve positions."""
    brake = vehicle.brake
    mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
    fastest, slowest = bounds.fill_and_vent(brake.fill_time_constant_s, brake.vent_time_constant_s)
    return EstimatorConstants(
        radius=vehicle.wheel_radius_m,
        full_pressure=brake.full_pressure_bar,
        interval=interval,
        by_pressure=by_pressure,
        mass=mass,
        axle_weight=mass * vehicle.gravity_mps2 / vehicle.axles,
        full_force=vehicle.full_brake_torque_nm / vehicle.wheel_radius_m,
        full_brake=full_brake(vehicle),
        rotating=vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2,
        creep=_creep(vehicle, mass),
        rise=interval / brake.demand_rise_s,
        fill=approach(interval, brake.fill_time_constant_s),
        vent=approach(interval, brake.vent_time_constant_s),
        fill_most=approach(interval, fastest),
        vent_least=approach(interval, slowest),
        usual=approach(interval, USED_FILTER_S),
        smooth=approach(interval, ADHESION_FILTER_S),
        lift=approach(interval, FASTER_FILTER_S),
    )


def allocate(n: int, vehicle: Vehicle, interval: float) -> VehicleEstimate:
    """Allocate the estimates of n vehicles; `begin` sets their values."""
    axles = vehicle.axles
    per_vehicle = {"speed", "uncertainty", "distributor", "demand", "mass_ratio", "since_slide"}
    per_vehicle |= {"speed_variance", "covariance", "mass_variance", "rise", "rise_variance", "rise_speed", "rise_mass"}
    per_vehicle |= {"other", "other_variance", "other_speed", "other_mass", "other_rise"}
    per_vehicle |= {"distributor_by_rise", "most_distributor"}
    arrays = {name: np.zeros(n if name in per_vehicle else (n, axles)) for name in VehicleEstimate._fields}
    arrays["doubtful"] = np.zeros(n, dtype=bool)
    arrays["trusted"] = np.ones((n, axles), dtype=bool)
    arrays["commands"] = np.zeros((n, round(vehicle.brake.dead_time_s / interval) + 1, axles))
    return VehicleEstimate(**arrays)
