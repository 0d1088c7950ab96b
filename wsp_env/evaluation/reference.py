"""What stops are compared with: the clean rail, and perfect knowledge with the real brake and its valves.

Perfect knowledge knows the adhesion curve, the true slip, the pressures and the commands still under way, and steers each
wheelset to the slip of best adhesion under the slide limit. It is not a bound: it looks no further ahead than the valves'
dead time, and a better controller may beat it.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.evaluation.bound import Ceiling
from wsp_env.evaluation.runner import Conduct, StopRecords, make_plant, record
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.plant import Plant
from wsp_env.plant.state import Stop

#: The slip is brought to the best one with this time constant [s]: slower than the valves, fast against the speed (assumption).
SETTLING_S = 0.25

#: Aimed at in place of the best slip or the slide limit [-], so that the valves' ripple stays within the limit (assumption).
MARGIN = 0.95

#: Below this speed [m/s] the brake is simply applied: slip has little meaning at standstill.
END_MPS = 1.0

_LEAST_SLIP_MPS = 1e-3


def clean_rail(vehicle: Vehicle, stops: Sequence[Stop], conduct: Conduct) -> StopRecords:
    """Brake the same stops on clean rail with the valves open: the reference of the ratio to the dry stop."""
    dry = [dataclasses.replace(stop, coverage=np.zeros_like(stop.coverage)) for stop in stops]
    plant = make_plant(vehicle, dry, conduct)
    command = np.ones((plant.n, vehicle.axles))
    return record(plant, lambda: command, conduct)


def perfect_knowledge(vehicle: Vehicle, stops: Sequence[Stop], ceiling: Ceiling, conduct: Conduct) -> StopRecords:
    """Brake the stops with the valves commanded from the truth."""
    plant = make_plant(vehicle, stops, conduct)
    return record(plant, lambda: _commands(plant, ceiling), conduct)


def _commands(plant: Plant, ceiling: Ceiling) -> np.ndarray:
    """Return the commands (N, A) towards the slip of best adhesion."""
    state, ahead = plant.state, dead_time(plant)
    speed = np.maximum(state.speed - ahead * state.deceleration, 0.1)
    _, best = ceiling.at(speed[None], (state.position + ahead * state.speed)[None])
    wanted = wanted_pressure(plant, np.minimum(best[0], MARGIN * ceiling.limit.slip(speed)[:, None]))
    return _nearest(plant, wanted)


def dead_time(plant: Plant) -> float:
    """Return the time from command to valve stroke [s]."""
    p = plant.constants
    return p.dead_steps * p.substep * p.substeps + p.dead_rest


def wanted_pressure(plant: Plant, target: np.ndarray) -> np.ndarray:
    """Return the cylinder pressures (N, A) [bar] that bring the slips to `target` (N, A) [m/s] once the dead time is over."""
    state, c, p = plant.state, plant.conditions, plant.constants
    ahead = dead_time(plant)
    load = c.mass * p.gravity / (2.0 * plant.vehicle.axles)
    pressure = _pressure_after_dead_time(plant)
    deceleration = state.deceleration[:, None]
    # The slip when the next command acts: linear from now, with the mean torque of the pressures on the way.
    slip = plant.slip_speed
    force = 2.0 * load[:, None] * state.adhesion
    torque = p.torque_per_bar * 0.5 * (state.pressure + pressure)
    slope = np.where(slip < target, force / np.maximum(slip, _LEAST_SLIP_MPS), 0.0)  # a secant; past the peak next to none
    rate = c.radius * (torque - c.radius * force) / p.inertia - deceleration
    relaxed = 1.0 / (1.0 + c.radius**2 * slope / p.inertia * ahead)  # grip holds the slip
    slip = np.clip(slip + ahead * rate * relaxed, 0.0, state.speed[:, None])
    wanted_rate = (target - slip) / SETTLING_S + deceleration
    wanted: np.ndarray = (c.radius * force + p.inertia / c.radius * wanted_rate) / p.torque_per_bar
    return wanted


def _nearest(plant: Plant, wanted: np.ndarray) -> np.ndarray:
    """Return the commands (N, A) whose pressure, one interval after the dead time, comes nearest to the one wanted."""
    state, p = plant.state, plant.constants
    pressure = _pressure_after_dead_time(plant)
    interval = p.substep * p.substeps
    offered = state.supply[:, None]
    filled = offered + (pressure - offered) * np.exp(-interval / np.where(offered > pressure, p.fill_time, p.vent_time))
    vented = pressure * np.exp(-interval / p.vent_time)
    choices = np.stack([np.abs(vented - wanted), np.abs(pressure - wanted), np.abs(filled - wanted)])
    command: np.ndarray = np.argmin(choices, axis=0) - 1.0
    command[state.speed < END_MPS] = 1.0
    return command


def _pressure_after_dead_time(plant: Plant) -> np.ndarray:
    """Cylinder pressures (N, A) [bar] once the commands under way have acted, in whole control intervals."""
    state, p = plant.state, plant.constants
    interval = p.substep * p.substeps
    pressure = state.pressure.copy()
    for age in range(p.dead_steps - 1, -1, -1):
        command = state.commands[:, age]
        target = np.where(command > 0.5, state.supply[:, None], 0.0)
        moved = target + (pressure - target) * np.exp(-interval / np.where(target > pressure, p.fill_time, p.vent_time))
        pressure = np.where(np.abs(command) > 0.5, moved, pressure)
    return pressure
