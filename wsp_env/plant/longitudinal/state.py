"""The arrays of the longitudinal plant: what moves (`State`), each stop's physics (`Physics`), what stays (`PlantConstants`).

N is the number of vehicles of the batch, A the number of axles.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.resistance import Resistance
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.components import brake, tachometer
from wsp_env.plant.components.rail import RailConstants
from wsp_env.plant.mechanisms import Derived, Mechanisms, Memory
from wsp_env.plant.port import Conditions, Setup

#: Longest substep [s]. experiments/convergence.py: at 10 ms every stopping distance lies within 0.001 % of the converged one
#: and the heat in the contacts within 0.3 %; with every mechanism on at once, of first order, distances within 0.15 %.
SUBSTEP_S = 0.01


class State(NamedTuple):
    """Everything that changes in a step; float64 arrays of shape (N,) or (N, A), and the states of the components."""

    time: np.ndarray  # [s]
    position: np.ndarray  # of the leading axle along the track [m]
    speed: np.ndarray  # [m/s]
    deceleration: np.ndarray  # at the start of the last substep [m/s2]
    wheel_speed: np.ndarray  # (N, A) [rad/s]
    wheel_rate: np.ndarray  # (N, A) its rate of change in the last substep [rad/s2]
    slip_speed: np.ndarray  # (N, A) v - r w [m/s]
    recorded_speed: np.ndarray  # (N,) of the vehicle, as its own recorder has it [m/s]
    adhesion: np.ndarray  # (N, A) f = T / N [-], signed as the slip
    adhesion_d: np.ndarray  # (N, A) its limit without recovery [-]
    adhesion_r: np.ndarray  # (N, A) its limit after full recovery [-]
    brake_work: np.ndarray  # (N,) heat in discs and pads [J]
    contact_work: np.ndarray  # (N, A) heat in both contacts of the wheelset [J]
    resistance_work: np.ndarray  # (N,) against running resistance and gradient [J]
    brake: brake.BrakeState
    tachometer: tachometer.TachometerState
    memory: Memory  # of the mechanisms


class Physics(NamedTuple):
    """The physics of each stop, which may be its own."""

    mechanisms: np.ndarray  # (N, mechanisms.ROW) parameters of all mechanisms
    law: np.ndarray  # (N, fields) the traction law with the mechanisms that change it
    inertia: np.ndarray  # (N, A) of the wheelsets [kg m2]


class PlantConstants(NamedTuple):
    """What is the same in every stop of a batch, as the compiled step takes it."""

    derived: Derived  # what mechanisms derive from the vehicle
    brake: brake.BrakeConstants
    tachometer: tachometer.TachometerConstants
    rail: RailConstants
    axle_offset: np.ndarray  # (A,) behind the leading axle [m]; no tuple: one compilation for any number of axles
    gravity: float  # [m/s2]
    resistance: Resistance
    substeps: int  # per control interval
    substep: float  # [s]


class Batch(NamedTuple):
    """All that the compiled step works on."""

    state: State
    conditions: Conditions
    physics: Physics
    constants: PlantConstants


def constants(vehicle: Vehicle, setup: Setup) -> PlantConstants:
    """Return the compiled step's constants of a vehicle."""
    interval = setup.control_interval_s
    substeps = math.ceil(interval / (setup.substep_s or SUBSTEP_S) - 1e-9)
    return PlantConstants(
        derived=mechanisms.derive(vehicle),
        brake=brake.constants(vehicle.brake, vehicle.axles, interval, interval / substeps, setup.pressure_control),
        tachometer=tachometer.constants(vehicle.tachometer),
        rail=RailConstants(setup.track_step_m),
        axle_offset=np.array(vehicle.axle_positions_m),
        gravity=vehicle.gravity_mps2,
        resistance=vehicle.resistance,
        substeps=substeps,
        substep=interval / substeps,
    )


def allocate(n: int, vehicle: Vehicle, p: PlantConstants) -> State:
    """Return the state of n vehicles at rest with empty cylinders."""
    axles = vehicle.axles
    per_vehicle = {"time", "position", "speed", "deceleration", "recorded_speed", "brake_work", "resistance_work"}
    names = [name for name in State._fields if name not in ("brake", "tachometer", "memory")]
    return State(
        **{name: np.zeros((n,) if name in per_vehicle else (n, axles)) for name in names},
        brake=brake.allocate(n, axles, p.brake),
        tachometer=tachometer.allocate(n, axles),
        memory=mechanisms.remember(n, vehicle.axle_positions_m),
    )


def physics(m: Mechanisms, vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a row of `Physics`: all mechanisms' parameters; the law and the wheelsets' inertia with those that change them.

    `ParameterError` for a mechanism on an axle that the vehicle does not have, or that the vehicle's traction law has no place
    for.
    """
    mechanisms.check_axles(m, vehicle.axles)
    law = mechanisms.believed_to_true("law", m, vehicle.contact.law)
    inertia = mechanisms.believed_to_true("inertia", m, np.full(vehicle.axles, vehicle.wheelset_inertia_kgm2))
    if not (np.min(inertia) > 0.0 and np.isfinite(inertia).all()):
        raise ParameterError(f"wheelset inertia of {np.min(inertia):g} kg m2 is impossible: it must be above 0")
    return mechanisms.row(m), np.array(law, dtype=np.float64), np.array(inertia, dtype=np.float64)


def conditions(n: int, axles: int, nodes: int) -> Conditions:
    """Return the conditions of n vehicles that brake under nothing yet."""
    return Conditions(
        mu_cd=np.zeros(n),
        tau=np.zeros(n),
        mass=np.ones(n),
        demand=np.zeros(n),
        gradient=np.zeros(n),
        noise=np.zeros(n),
        key=np.zeros(n, dtype=np.uint64),
        radius=np.ones((n, axles)),
        profile=np.ones((n, nodes)),
        coverage=np.ones((n, nodes)),
    )


def batch(n: int, vehicle: Vehicle, setup: Setup, m: Mechanisms) -> Batch:
    """Return n vehicles at rest, all with the same mechanisms."""
    p = constants(vehicle, setup)
    own = Physics(*(np.tile(row, (n, 1)) for row in physics(m, vehicle)))
    return Batch(allocate(n, vehicle, p), conditions(n, vehicle.axles, setup.track_nodes), own, p)
