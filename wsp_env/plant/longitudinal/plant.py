"""The longitudinal plant behind the port: owns the arrays, checks what comes in, calls the compiled step."""

import math

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import plain
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms as library
from wsp_env.plant.components import brake, tachometer
from wsp_env.plant.longitudinal.state import State, batch, physics
from wsp_env.plant.longitudinal.step import ROWS, advance
from wsp_env.plant.port import Choice, Measurement, Plant, Setup, Stop, Truth, check_command, check_stop


class LongitudinalPlant(Plant):
    """N vehicles of one kind in longitudinal motion, each braking under its own conditions.

    Parameters
    ----------
    vehicle : what brakes
    n : number of vehicles in the batch
    setup : clock, commands, physics, grid of the track

    """

    def __init__(self, vehicle: Vehicle, n: int = 1, setup: Setup | None = None) -> None:
        if n < 1:
            raise ParameterError(f"a batch of {n} vehicles is impossible: n must be at least 1")
        self.vehicle = vehicle
        self.n = n
        self.setup = setup = setup or Setup()
        if setup.track_geometry is not None:
            raise ParameterError(
                "the longitudinal plant runs on a straight, smooth track: leave track_geometry out, or take plant multibody"
            )
        self._mechanisms = library.make(setup.mechanisms)
        batched = batch(n, vehicle, setup, self._mechanisms)
        self.state, self.conditions, self._physics, self.constants = batched
        self.moving = np.zeros(n, dtype=bool)
        self._law = vehicle.contact.law
        self._given = (plain(batched), self.moving, np.empty((ROWS, vehicle.axles)))

    def start(self, index: int, stop: Stop, mechanisms: Choice | None = None) -> None:
        """Put vehicle `index` at the start of a stop, see `Plant.start`."""
        check_stop(stop, self.vehicle)
        own = self._mechanisms if mechanisms is None else library.make(mechanisms)
        for array, row in zip(self._physics, physics(own, self.vehicle), strict=True):
            array[index] = row
        c, s = self.conditions, self.state
        for array in (*s[: State._fields.index("brake")], *(array for memory in s.memory for array in memory)):
            array[index] = 0.0
        c.mu_cd[index] = stop.mu_cd
        c.tau[index] = library.believed_to_true("tau", own, stop.tau)
        c.mass[index] = library.believed_to_true("mass", own, stop.mass)
        c.demand[index] = stop.demand
        c.gradient[index] = library.believed_to_true("gradient", own, stop.gradient)
        c.noise[index] = stop.noise
        c.key[index] = stop.key
        c.radius[index] = library.believed_to_true("radii", own, stop.radius)
        c.profile[index] = stop.profile
        c.coverage[index] = stop.coverage
        s.speed[index] = s.recorded_speed[index] = stop.initial_speed
        s.wheel_speed[index] = stop.initial_speed / c.radius[index]
        s.slip_speed[index] = s.speed[index] - c.radius[index] * s.wheel_speed[index]
        brake.release(index, s.brake, self.constants.brake)
        tachometer.begin(index, s.wheel_speed[index], s.tachometer)
        self.moving[index] = True

    def step(self, command: ArrayLike) -> None:
        """Advance by one control interval under the commands (N, A), see `wsp_env.plant.command`.

        `ValueError` for a wrong shape or a command that is not finite.
        """
        advance(check_command(command, self.n, self.vehicle.axles), self._law, *self._given)

    def reading(self) -> Measurement:
        """Return what the sensors say now, cylinder pressures included; copies."""
        s = self.state
        return Measurement(s.time.copy(), s.tachometer.measured.copy(), self.conditions.demand.copy(), s.brake.pressure.copy())

    def truth(self) -> Truth:
        """Return what is; the arrays change with every step."""
        s = self.state
        return Truth(
            s.time, s.position, s.speed, s.deceleration, s.wheel_speed, s.slip_speed, s.brake.pressure, s.brake.distributor,
            s.adhesion, s.adhesion_d, s.adhesion_r, s.brake.air, s.contact_work, s.brake_work, s.resistance_work,
        )  # fmt: skip

    def preview(self, then: float | None = None) -> np.ndarray:
        """Return the cylinder pressures (N, A) [bar] once the commands on their way have acted, see `Plant.preview`."""
        s, b = self.state.brake, self.constants.brake
        pressure: np.ndarray = s.pressure.copy()
        last = math.nan if then is None else float(then)
        brake.look_ahead(pressure, last, self.setup.control_interval_s, self.conditions.demand, s, b)
        return pressure

    def set_state(self, index: int, wheel_speed_radps: np.ndarray, pressure_bar: np.ndarray) -> None:
        """Let a stop that was just started begin with these wheel speeds and pressures (A,), the distributor filled."""
        s = self.state
        s.wheel_speed[index] = wheel_speed_radps
        s.slip_speed[index] = s.speed[index] - self.conditions.radius[index] * s.wheel_speed[index]
        s.brake.pressure[index] = pressure_bar
        s.brake.distributor[index] = self.vehicle.brake.full_pressure_bar

    @property
    def kinetic_energy(self) -> np.ndarray:
        """Kinetic energy of each vehicle with its wheelsets (N,) [J]."""
        wheels = 0.5 * np.sum(self._physics.inertia * self.state.wheel_speed**2, axis=1)
        energy: np.ndarray = 0.5 * self.conditions.mass * self.state.speed**2 + wheels
        return energy
