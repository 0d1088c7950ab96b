"""What stops are compared with: the clean rail, and perfect knowledge with the real brake and its valves.

Perfect knowledge knows the adhesion curve, the true slip, the pressures and the commands still under way, and steers each
wheelset to the slip of best adhesion under the slide limit. It is not a bound: it looks no further ahead than the valves'
dead time, and a better controller may beat it.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.evaluation.bound import Ceiling
from wsp_env.evaluation.runner import Conduct, StopRecords, record, start_plant
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.command import APPLIES, HOLDS, VENTS
from wsp_env.plant.port import Plant, Stop

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
    plant = start_plant(vehicle, dry, conduct)
    command = np.ones((plant.n, vehicle.axles))
    return record(plant, lambda: command, conduct)


def perfect_knowledge(vehicle: Vehicle, stops: Sequence[Stop], ceiling: Ceiling, conduct: Conduct) -> StopRecords:
    """Brake the stops with the valves commanded from the truth."""
    plant = start_plant(vehicle, stops, conduct)
    return record(plant, lambda: _commands(plant, ceiling), conduct)


def _commands(plant: Plant, ceiling: Ceiling) -> np.ndarray:
    """Return the commands (N, A) towards the slip of best adhesion."""
    state, ahead = plant.truth(), plant.vehicle.brake.dead_time_s
    speed = np.maximum(state.speed - ahead * state.deceleration, 0.1)
    _, best = ceiling.at(speed[None], (state.position + ahead * state.speed)[None])
    wanted = wanted_pressure(plant, np.minimum(best[0], MARGIN * ceiling.limit.slip(speed)[:, None]))
    return nearest(plant, wanted)


def wanted_pressure(plant: Plant, target: np.ndarray) -> np.ndarray:
    """Return the cylinder pressures (N, A) [bar] that bring the slips to `target` (N, A) [m/s] once the dead time is over."""
    state, c, vehicle = plant.truth(), plant.conditions, plant.vehicle
    ahead, per_bar, inertia = vehicle.brake.dead_time_s, vehicle.brake.torque_per_bar_nm, vehicle.wheelset_inertia_kgm2
    load = c.mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles)
    pressure = plant.preview()
    deceleration = state.deceleration[:, None]
    # The slip when the next command acts: linear from now, with the mean torque of the pressures on the way.
    slip = state.slip_speed
    force = 2.0 * load[:, None] * state.adhesion
    torque = per_bar * 0.5 * (state.pressure + pressure)
    slope = np.where(slip < target, force / np.maximum(slip, _LEAST_SLIP_MPS), 0.0)  # a secant; past the peak next to none
    rate = c.radius * (torque - c.radius * force) / inertia - deceleration
    relaxed = 1.0 / (1.0 + c.radius**2 * slope / inertia * ahead)  # grip holds the slip
    slip = np.clip(slip + ahead * rate * relaxed, 0.0, state.speed[:, None])
    wanted_rate = (target - slip) / SETTLING_S + deceleration
    wanted: np.ndarray = (c.radius * force + inertia / c.radius * wanted_rate) / per_bar
    return wanted


def nearest(plant: Plant, wanted: np.ndarray) -> np.ndarray:
    """Return the commands (N, A) whose pressure, one interval after the dead time, comes nearest to the one wanted."""
    commands = np.array([VENTS, HOLDS, APPLIES])
    missed = np.stack([np.abs(plant.preview(then) - wanted) for then in commands])
    command: np.ndarray = commands[np.argmin(missed, axis=0)]
    command[plant.truth().speed < END_MPS] = APPLIES
    return command
