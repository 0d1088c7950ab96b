"""Stops and vehicles that the tests of plant and mechanisms brake."""

import dataclasses

import numpy as np

from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Brake, Tachometer, Vehicle
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.port import Setup, Stop

#: No dead time and a distributor that is always full: the torque follows the valve alone.
DIRECT = Brake(demand_rise_s=1e-6, dead_time_s=0.0)
FINE = Tachometer(pulses_per_turn=10_000.0)


def a_stop(vehicle: Vehicle, **changes) -> Stop:
    """A stop on a level, uniformly wet track without sensor noise; `changes` are fields of `Stop`."""
    usual = {
        "mu_cd": 0.06, "tau": 1.9e-4, "initial_speed": 30.0, "mass": vehicle.mass_kg, "demand": 1.0, "gradient": 0.0,
        "noise": 0.0, "key": 1, "radius": np.full(vehicle.axles, vehicle.wheel_radius_m), "profile": np.ones(1),
        "coverage": np.ones(1),
    }  # fmt: skip
    return Stop(**(usual | changes))


def plant_of(vehicle: Vehicle, n: int = 1, **setup) -> LongitudinalPlant:
    """N vehicles at rest; `setup` are fields of `Setup`."""
    return LongitudinalPlant(vehicle, n, Setup(**setup))


def arrays(state, before="") -> dict[str, np.ndarray]:
    """Every array of a state by name, those of its components too."""
    found = {}
    for name, value in state._asdict().items():
        found |= arrays(value, f"{before}{name}.") if hasattr(value, "_asdict") else {before + name: value}
    return found


def a_plant(name: str = "bogie", interval: float = 0.02, substep: float = 0.005, vehicle=None, **changes) -> LongitudinalPlant:
    """One vehicle at the start of `a_stop(**changes)`."""
    vehicle = dataclasses.replace(VEHICLES[name], **(vehicle or {}))
    plant = plant_of(vehicle, 1, control_interval_s=interval, substep_s=substep)
    plant.start(0, a_stop(vehicle, **changes))
    return plant


def run(plant: LongitudinalPlant, seconds: float, command=1.0) -> None:
    """Keep one command for a time, or until the vehicles stand."""
    commands = np.broadcast_to(np.asarray(command, dtype=float), plant.state.wheel_speed.shape)
    for _ in range(round(seconds / plant.setup.control_interval_s)):
        plant.step(commands)
