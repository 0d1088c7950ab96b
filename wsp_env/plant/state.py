"""The arrays a plant works on: what moves (`State`), what a stop is made of (`Conditions`), what stays (`Constants`).

N is the number of vehicles of the batch, A the number of axles.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from wsp_env.contact.degraded import AdhesionLaw
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.mechanisms import (
    Mechanisms,
    check_axles,
    falling_friction,
    flash_temperature,
    initial_slope,
    leading_axle_cleaning,
    load_transfer,
    recovery_shape,
)


class State(NamedTuple):
    """Everything that changes in a step; float64 arrays of shape (N,) or (N, A) unless said otherwise."""

    time: np.ndarray  # [s]
    position: np.ndarray  # of the leading axle along the track [m]
    speed: np.ndarray  # [m/s]
    deceleration: np.ndarray  # at the start of the last substep [m/s2]
    supply: np.ndarray  # pressure that the distributor offers [bar]
    wheel_speed: np.ndarray  # (N, A) [rad/s]
    pressure: np.ndarray  # (N, A) in the brake cylinder [bar]
    commands: np.ndarray  # (N, K, A) commands under way to the valves, newest first
    angle: np.ndarray  # (N, A) turned by the wheel [rad]
    edge_angle: np.ndarray  # (N, A) of the last counted pulse edge [rad]
    edge_time: np.ndarray  # (N, A) of that edge [s]
    counted: np.ndarray  # (N, A) speed from the pulses [rad/s]
    filtered: np.ndarray  # (N, A) the same as the sensor gives it, see wheel_speed_lag [rad/s]
    measured: np.ndarray  # (N, A) the same with the sensor's noise [rad/s]
    recorded_speed: np.ndarray  # (N,) of the vehicle, as its own recorder has it, see clock_offset [m/s]
    adhesion: np.ndarray  # (N, A) f = T / N [-], signed as the slip
    adhesion_d: np.ndarray  # (N, A) its limit without recovery [-]
    adhesion_r: np.ndarray  # (N, A) its limit after full recovery [-]
    air: np.ndarray  # (N, A) let into the cylinders [Nl]
    brake_work: np.ndarray  # (N,) heat in discs and pads [J]
    contact_work: np.ndarray  # (N, A) heat in both contacts of the wheelset [J]
    resistance_work: np.ndarray  # (N,) against running resistance and gradient [J]
    rail_energy: np.ndarray  # (N, cells) spent per metre on one rail under the vehicle [J/m]
    rail_pending: np.ndarray  # (N, A) spent in the present cell [J]
    recovery: np.ndarray  # (N, A) share of the film removed, see contaminant_memory [-]
    discs: np.ndarray  # (N, A) rise of their temperature, see pad_friction [K]
    applied: np.ndarray  # (N,) 1 once the brake was applied, see non_adhesive_brake [-]


class Conditions(NamedTuple):
    """What a stop is made of; constant while it lasts, except that a demand may be changed between steps."""

    mu_cd: np.ndarray  # (N,) kinetic friction coefficient of the contaminated rail [-]
    tau: np.ndarray  # (N,) recovery rate [m/J]
    mass: np.ndarray  # (N,) [kg]
    demand: np.ndarray  # (N,) brake demand, 0 to 1 of full pressure [-]
    gradient: np.ndarray  # (N,) rise over distance, positive uphill [-]
    noise: np.ndarray  # (N,) standard deviation of the wheel-speed sensors [rad/s]
    key: np.ndarray  # (N,) uint64, from which the sensor noise of the stop is computed
    radius: np.ndarray  # (N, A) of the wheels [m]
    profile: np.ndarray  # (N, M) mu_cd along the track relative to `mu_cd` [-], nodes `track_step` apart
    coverage: np.ndarray  # (N, M) share of the film that lies there [-]: 1 contaminated, 0 clean


class Constants(NamedTuple):
    """What is the same in every stop of a batch, as the compiled step takes it."""

    law: AdhesionLaw  # with the mechanisms that change it
    mechanisms: Mechanisms
    axle_offset: np.ndarray  # (A,) behind the leading axle [m]; no tuple: one compilation for any number of axles
    body_arm: np.ndarray  # (A,) see load_transfer [1/m]
    pivot_arm: np.ndarray  # (A,) see load_transfer [1/m]
    heating: float  # see flash_temperature [K s1.5 / (N m0.5)]
    inertia: float  # of a wheelset [kg m2]
    gravity: float  # [m/s2]
    resistance_a: float  # [N]
    resistance_b: float  # [N s/m]
    resistance_c: float  # [N s2/m2]
    full_pressure: float  # [bar]
    torque_per_bar: float  # per axle [N m/bar]
    demand_rise: float  # rate of the distributor [bar/s]
    fill_time: float  # time constant [s]
    vent_time: float  # time constant [s]
    air_per_bar: float  # air let in per rise of the cylinder pressure [Nl/bar]
    pulse_angle: float  # between two edges [rad]
    track_step: float  # [m]
    dead_steps: int  # whole control intervals of the valves' dead time
    dead_rest: float  # what is left of it [s]
    pressure_control: bool  # commands are pressures, 0 to 1 of the demand, instead of vent / hold / apply
    substeps: int  # per control interval
    substep: float  # [s]


#: Pressure of one normal atmosphere [bar]: a normal litre is a litre of air at this pressure.
ATMOSPHERE_BAR = 1.01325


def constants(
    vehicle: Vehicle,
    control_interval_s: float,
    substeps: int,
    mechanisms: Mechanisms,
    pressure_control: bool,
    track_step_m: float,
) -> Constants:
    """Return the compiled step's constants of a vehicle; `ParameterError` for a mechanism on an axle it does not have."""
    check_axles(mechanisms, vehicle.axles)
    brake = vehicle.brake
    dead_steps = math.floor(brake.dead_time_s / control_interval_s + 1e-9)
    body_arm, pivot_arm = load_transfer.arms(vehicle.axle_positions_m, vehicle.running_gear)
    law = initial_slope.law(mechanisms.initial_slope, vehicle.contact.law)
    law = recovery_shape.law(mechanisms.recovery_shape, falling_friction.law(mechanisms.falling_friction, law))
    return Constants(
        law=law,
        mechanisms=mechanisms,
        axle_offset=np.array(vehicle.axle_positions_m),
        body_arm=np.array(body_arm),
        pivot_arm=np.array(pivot_arm),
        heating=flash_temperature.heating(vehicle.contact.semi_axis_a_m, vehicle.contact.semi_axis_b_m),
        inertia=vehicle.wheelset_inertia_kgm2,
        gravity=vehicle.gravity_mps2,
        resistance_a=vehicle.resistance_a_n,
        resistance_b=vehicle.resistance_b_ns_per_m,
        resistance_c=vehicle.resistance_c_ns2_per_m2,
        full_pressure=brake.full_pressure_bar,
        torque_per_bar=brake.torque_per_bar_nm,
        demand_rise=brake.full_pressure_bar / brake.demand_rise_s,
        fill_time=brake.fill_time_constant_s,
        vent_time=brake.vent_time_constant_s,
        air_per_bar=brake.cylinder_volume_l / ATMOSPHERE_BAR,
        pulse_angle=2.0 * math.pi / vehicle.tachometer.pulses_per_turn,
        track_step=track_step_m,
        dead_steps=dead_steps,
        dead_rest=max(brake.dead_time_s - dead_steps * control_interval_s, 0.0),
        pressure_control=pressure_control,
        substeps=substeps,
        substep=control_interval_s / substeps,
    )


def allocate(n: int, vehicle: Vehicle, dead_steps: int) -> State:
    """Return the state of n vehicles at rest with empty cylinders."""
    axles = vehicle.axles
    shapes = {
        "commands": (n, dead_steps + 2, axles),
        "rail_energy": (n, leading_axle_cleaning.cells(vehicle.axle_positions_m[-1])),
    }
    per_vehicle = {
        "time", "position", "speed", "deceleration", "supply", "brake_work", "resistance_work", "recorded_speed", "applied",
    }  # fmt: skip
    return State(*(np.zeros(shapes.get(name, (n,) if name in per_vehicle else (n, axles))) for name in State._fields))


@dataclasses.dataclass(frozen=True)
class Stop:
    """The conditions of one stop, before they are laid into a batch; arrays are (A,) and (M,)."""

    mu_cd: float  # [-]
    tau: float  # [m/J]
    initial_speed: float  # [m/s]
    mass: float  # [kg]
    demand: float  # [-]
    gradient: float  # [-]
    noise: float  # [rad/s]
    key: int
    radius: np.ndarray  # (A,) [m]
    profile: np.ndarray  # (M,) [-]
    coverage: np.ndarray  # (M,) [-]
