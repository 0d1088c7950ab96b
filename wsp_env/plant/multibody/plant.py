"""The multibody plant behind the port: the longitudinal plant's arrays, with bodies, suspensions and contacts under them."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.multibody import bodies
from wsp_env.plant.multibody.bodies import NOT_FINITE, OFF_THE_RAIL, BodyConstants
from wsp_env.plant.multibody.elastic import elastic
from wsp_env.plant.multibody.static import lowered
from wsp_env.plant.multibody.step import advance
from wsp_env.plant.multibody.structure import PITCH, WHEELSETS, X_, Z_, assemble
from wsp_env.plant.multibody.way import Way, way
from wsp_env.plant.port import Choice, Setup, Stop

#: Longest substep [s].
SUBSTEP_S = 5e-4

#: Where in a substep springs and normal contact forces are evaluated: next to the midpoint, with a little numerical damping.
THETA = 0.55

#: Lateral shift and lift [m] of a wheelset beyond which it has derailed: half the width of a rail's head, the flange's height.
WIDEST_M, HIGHEST_M = 0.035, 0.028

#: What is said of a stop that was given up.
REASONS = {OFF_THE_RAIL: "derailed: wheelset {} has left the rails", NOT_FINITE: "the motion is not finite any more"}


class MultibodyPlant(LongitudinalPlant):
    """N vehicles on two bogies, each braking under its own conditions.

    Parameters
    ----------
    vehicle : what brakes; its part `multibody` holds bodies and suspensions
    n : number of vehicles in the batch
    setup : clock, commands, physics, grid of the track
    blocked : hold all bodies together but for the forward motion and the turning of the wheelsets

    """

    def __init__(self, vehicle: Vehicle, n: int = 1, setup: Setup | None = None, blocked: bool = False, track: Way | None = None) -> None:
        setup = setup or Setup()
        longest = min(setup.substep_s or SUBSTEP_S, 2.0 * SUBSTEP_S)
        structure = assemble(vehicle)
        super().__init__(vehicle, n, dataclasses.replace(setup, substep_s=longest))
        self.setup = setup
        self._blocked = blocked
        self.bodies = bodies.allocate(n, len(structure.mass), vehicle.axles)
        self._scratch = bodies.scratch(len(structure.mass), vehicle.axles)
        pair = make_pair(s1002(), uic60(), Wheelset(radius_m=vehicle.wheel_radius_m), Track())
        own = elastic(vehicle.contact)
        self.body_constants = BodyConstants(
            structure.stiffness, structure.damping, structure.bump_stops,
            np.array(vehicle.multibody.bump_stop_deflection_m), np.array(vehicle.multibody.bump_stop_force_n),
            structure.bogie_of, structure.place, structure.height, pair, own, track or way([]),
            vehicle.multibody.contact_damping_s_per_m, 1.0, vehicle.wheel_radius_m, WIDEST_M, HIGHEST_M, THETA,
        )  # fmt: skip
        reference = lowered(vehicle.static_wheel_load_n, self.body_constants).area_c11
        self.body_constants = self.body_constants._replace(reference=reference)

    def start(self, index: int, stop: Stop, mechanisms: Choice | None = None) -> None:
        """Put vehicle `index` at the start of a stop, see `Plant.start`."""
        super().start(index, stop, mechanisms)
        m, s, b = self.bodies, self.state, self.body_constants
        structure = assemble(self.vehicle, float(self.conditions.mass[index]))
        for array in m:
            array[index] = 0
        m.rows[index] = -np.inf
        wheelsets = WHEELSETS + 6 * np.arange(self.vehicle.axles)
        mass = structure.mass.copy()
        mass[wheelsets + PITCH] = self._physics.inertia[index]
        m.mass[index] = mass
        m.hanging[index] = structure.hanging
        m.axle_load[index] = structure.axle_load
        m.inverse[index] = self._inverse(mass, structure.hanging)
        m.speed[index, X_ : WHEELSETS + 6 * self.vehicle.axles : 6] = s.speed[index]
        m.speed[index, wheelsets + PITCH] = s.wheel_speed[index]
        settled = lowered(float(structure.axle_load.mean()) / 2.0, b)
        m.position[index, Z_ : WHEELSETS + 6 * self.vehicle.axles : 6] = settled.z
        m.wheel_load[index] = structure.axle_load[:, None] / 2.0

    def _inverse(self, mass: np.ndarray, hanging: np.ndarray) -> np.ndarray:
        """Return the inverse (n, n) of M + theta h C + (theta h)^2 K, or of what is free of it."""
        b, h = self.body_constants, self.body_constants.theta * self.constants.substep
        whole = np.diag(mass + h * h * hanging) + h * b.damping + h * h * b.stiffness
        if not self._blocked:
            return np.linalg.inv(whole)
        axles = self.vehicle.axles
        free = np.zeros((len(mass), 1 + axles))
        free[X_ : WHEELSETS + 6 * axles : 6, 0] = 1.0
        free[WHEELSETS + 6 * np.arange(axles) + PITCH, 1 + np.arange(axles)] = 1.0
        return free @ np.linalg.inv(free.T @ np.diag(mass) @ free) @ free.T

    def step(self, command: ArrayLike) -> None:
        """Advance by one control interval, see `Plant.step`."""
        from wsp_env.plant.port import check_command

        advance(
            check_command(command, self.n, self.vehicle.axles), self._law, *self._given, self.bodies, self.body_constants, self._scratch
        )

    def set_state(self, index: int, wheel_speed_radps: np.ndarray, pressure_bar: np.ndarray) -> None:
        """Let a stop that was just started begin with these wheel speeds and pressures (A,), the distributor filled."""
        super().set_state(index, wheel_speed_radps, pressure_bar)
        self.bodies.speed[index, WHEELSETS + 6 * np.arange(self.vehicle.axles) + PITCH] = wheel_speed_radps
