"""A batch of braked vehicles: owns the arrays, checks what comes in, calls the compiled step."""

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.mechanisms import track_gradient, vehicle_mass, wheel_radius
from wsp_env.plant.state import Conditions, Constants, State, Stop, allocate, constants
from wsp_env.plant.step import ROWS, advance

#: Longest substep [s]. experiments/convergence.py: at 10 ms every stopping distance lies within 0.001 % of the converged one
#: and the heat in the contacts within 0.3 %; with every mechanism on at once, of first order, distances within 0.15 %.
SUBSTEP_S = 0.01


class Plant:
    """N vehicles of one kind, each braking under its own conditions.

    Parameters
    ----------
    vehicle : what brakes
    n : number of vehicles in the batch
    control_interval_s : time between commands [s]
    substep_s : longest substep of the integration [s]; the control interval is divided evenly
    mechanism_choice : physics beyond the paper's model, see `wsp_env.plant.mechanisms.make`
    pressure_control : commands are pressures (0 to 1 of the demand) instead of vent -1, hold 0, apply +1
    track_step_m, track_nodes : grid of what lies along the track

    """

    def __init__(
        self,
        vehicle: Vehicle,
        n: int = 1,
        control_interval_s: float = 0.02,
        substep_s: float = SUBSTEP_S,
        mechanism_choice: Mapping[str, Mapping[str, float]] | None = None,
        pressure_control: bool = False,
        track_step_m: float = 5.0,
        track_nodes: int = 1,
    ) -> None:
        if not 0.0 < control_interval_s <= 1.0:
            raise ParameterError(f"control_interval_s = {control_interval_s} s is impossible: it must lie in (0, 1]")
        if not 0.0 < substep_s <= 1.0:
            raise ParameterError(f"substep_s = {substep_s} s is impossible: it must lie in (0, 1]")
        if n < 1:
            raise ParameterError(f"a batch of {n} vehicles is impossible: n must be at least 1")
        self.vehicle = vehicle
        self.n = n
        self.control_interval_s = control_interval_s
        substeps = int(np.ceil(control_interval_s / substep_s - 1e-9))
        self._make = functools.partial(
            constants, vehicle, control_interval_s, substeps, pressure_control=pressure_control, track_step_m=track_step_m
        )
        self.constants: Constants = self._make(mechanisms=mechanisms.make(mechanism_choice))
        self._own: dict[int, Constants] = {}  # of the stops whose mechanisms are their own
        self._views: dict[int, tuple[State, Conditions]] = {}  # and their rows of the arrays
        self.state: State = allocate(n, vehicle, self.constants.dead_steps)
        axles = vehicle.axles
        self.conditions = Conditions(
            mu_cd=np.zeros(n),
            tau=np.zeros(n),
            mass=np.ones(n),
            demand=np.zeros(n),
            gradient=np.zeros(n),
            noise=np.zeros(n),
            key=np.zeros(n, dtype=np.uint64),
            radius=np.ones((n, axles)),
            profile=np.ones((n, track_nodes)),
            coverage=np.ones((n, track_nodes)),
        )
        self.moving = np.zeros(n, dtype=bool)
        self._work = np.empty((ROWS, axles))

    def start(self, index: int, stop: Stop, mechanism_choice: Mapping[str, Mapping[str, float]] | None = None) -> None:
        """Put vehicle `index` at the start of a stop: rolling freely at its initial speed with empty cylinders.

        The stop is what is believed; mechanisms on mass, gradient and radius turn it into what is. `mechanism_choice` is the
        physics of this stop alone, in place of the batch's; such stops are stepped one by one, which
        takes some 40 times as long.

        `ParameterError` names a condition that cannot be.
        """
        check_stop(stop, self.vehicle)
        self._own.pop(index, None)
        self._views.pop(index, None)
        own = self.constants if mechanism_choice is None else self._make(mechanisms=mechanisms.make(mechanism_choice))
        if mechanism_choice is not None:
            self._own[index], self._views[index] = own, self._rows(index)
        for array in self.state:
            array[index] = 0.0
        c, m = self.conditions, own.mechanisms
        c.mu_cd[index] = stop.mu_cd
        c.tau[index] = stop.tau
        c.mass[index] = vehicle_mass.mass(m.vehicle_mass, stop.mass)
        c.demand[index] = stop.demand
        c.gradient[index] = track_gradient.gradient(m.track_gradient, stop.gradient)
        c.noise[index] = stop.noise
        c.key[index] = stop.key
        c.radius[index] = wheel_radius.radii(m.wheel_radius, stop.radius)
        c.profile[index] = stop.profile
        c.coverage[index] = stop.coverage
        self.state.speed[index] = stop.initial_speed
        self.state.recorded_speed[index] = stop.initial_speed
        self.state.wheel_speed[index] = stop.initial_speed / c.radius[index]
        for reading in (self.state.counted, self.state.filtered, self.state.measured):
            reading[index] = self.state.wheel_speed[index]
        self.state.commands[index] = 1.0
        self.moving[index] = True

    def step(self, command: ArrayLike) -> None:
        """Advance by one control interval under the commands (N, A); vehicles that stand stay as they are.

        `ValueError` for a wrong shape or a command that is not finite.
        """
        # A copy: a read-only or strided array is another type to numba, and would be compiled for anew.
        command = np.array(command, dtype=np.float64, order="C")
        shape = (self.n, self.vehicle.axles)
        if command.shape != shape:
            raise ValueError(f"commands have shape {command.shape}, expected {shape}: one per vehicle and axle")
        if not np.isfinite(command).all():
            row, axle = np.argwhere(~np.isfinite(command))[0]
            raise ValueError(f"the command of vehicle {row}, axle {axle + 1} is {command[row, axle]}: commands must be finite")
        if not self._own:
            advance(command, self.state, self.conditions, self.constants, self.moving, self._work)
            return
        together = self.moving.copy()
        together[list(self._own)] = False
        standing = ~together
        advance(command, self.state, self.conditions, self.constants, together, self._work)
        self.moving &= together | standing
        for index, own in self._own.items():
            advance(command[index : index + 1], *self._views[index], own, self.moving[index : index + 1], self._work)

    def _rows(self, index: int) -> tuple[State, Conditions]:
        row = slice(index, index + 1)
        return State(*(array[row] for array in self.state)), Conditions(*(array[row] for array in self.conditions))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over a copied or unpickled plant's attributes; rows are views, which a copy would cut off."""
        self.__dict__.update(state)
        self._views = {index: self._rows(index) for index in self._own}

    @property
    def kinetic_energy(self) -> np.ndarray:
        """Kinetic energy of each vehicle with its wheelsets (N,) [J]."""
        wheels = 0.5 * self.vehicle.wheelset_inertia_kgm2 * np.sum(self.state.wheel_speed**2, axis=1)
        energy: np.ndarray = 0.5 * self.conditions.mass * self.state.speed**2 + wheels
        return energy

    @property
    def slip_speed(self) -> np.ndarray:
        """True slip speed v - r w of each wheelset (N, A) [m/s]."""
        slip: np.ndarray = self.state.speed[:, None] - self.conditions.radius * self.state.wheel_speed
        return slip


#: What the conditions of a stop may be: quantity -> lowest, highest, unit. mu_cd also stays below mu_cr, and above 0.
LIMITS = {
    "mu_cd": (0.0, 1.0, "-"),
    "tau": (0.0, 1.0, "m/J"),
    "initial_speed": (0.1, 100.0, "m/s"),
    "mass": (1.0, 1e6, "kg"),
    "demand": (0.0, 1.0, "of full pressure"),
    "gradient": (-0.1, 0.1, "-"),
    "sensor_noise": (0.0, 100.0, "rad/s"),
    "radius": (0.1, 2.0, "m"),
    "profile": (1e-3, math.inf, "everywhere"),
    "coverage": (0.0, 1.0, "everywhere"),
}


def check_stop(stop: Stop, vehicle: Vehicle) -> None:
    """Raise `ParameterError` for conditions that cannot be."""
    friction_r = vehicle.contact.kinetic_friction_r
    if not 0.0 < stop.mu_cd <= friction_r:
        raise ParameterError(
            f"mu_cd = {stop.mu_cd:g} is impossible: it must lie in (0, {friction_r:g}], up to kinetic_friction_r (mu_cr)"
        )
    values = {name: getattr(stop, "noise" if name == "sensor_noise" else name) for name in LIMITS}
    for name, (low, high, unit) in LIMITS.items():
        for value in (np.min(values[name]), np.max(values[name])):
            if not low <= value <= high:
                raise ParameterError(f"{name} = {value:g} is impossible: it must lie in [{low:g}, {high:g}] {unit}")
