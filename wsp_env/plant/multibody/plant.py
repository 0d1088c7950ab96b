"""The multibody plant behind the port: the longitudinal plant's arrays, with bodies, suspensions and contacts under them."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.contact.geometry.port import PRESSED, Y, Z
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import TrackGeometry
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.mechanisms import ALL, NULL, Mechanisms, make
from wsp_env.plant.multibody import bodies
from wsp_env.plant.multibody.bodies import NOT_FINITE, OFF_THE_RAIL, BodyConstants, Elements
from wsp_env.plant.multibody.rolling import rolling_of
from wsp_env.plant.multibody.static import lowered
from wsp_env.plant.multibody.step import advance
from wsp_env.plant.multibody.structure import PITCH, WHEELSETS, X_, Z_, Structure, assemble
from wsp_env.plant.multibody.way import way_of
from wsp_env.plant.port import Choice, Setup, Stop, check_command

#: Longest substep [s], whatever the set-up says; docs/multibody.md has the table of errors that it is chosen by.
SUBSTEP_S = 5e-4

#: Where in a substep springs and normal contact forces are evaluated: next to the midpoint, with a little numerical damping.
THETA = 0.55

#: What is said of a stop that was given up; wheelsets count from 1.
REASONS = {OFF_THE_RAIL: "derailed: wheelset {} has left the rails", NOT_FINITE: "the motion is not finite any more"}


class MultibodyPlant(LongitudinalPlant):
    """N vehicles on two bogies, each braking under its own conditions.

    `conditions.mass` is the whole vehicle's; the speed is that of the centre of mass.

    Parameters
    ----------
    vehicle : what brakes; its part `multibody` holds bodies and suspensions
    n : number of vehicles in the batch
    setup : clock, commands, physics, grid of the track; its substep is shortened to `SUBSTEP_S`
    blocked : hold all bodies together but for the forward motion and the turning of the wheelsets

    """

    def __init__(self, vehicle: Vehicle, n: int = 1, setup: Setup | None = None, blocked: bool = False) -> None:
        setup = setup or Setup()
        structure = assemble(vehicle)
        substep = min(setup.substep_s or SUBSTEP_S, SUBSTEP_S)
        _refuse_load_transfer(make(setup.mechanisms))
        super().__init__(vehicle, n, dataclasses.replace(setup, substep_s=substep, track_geometry=None))
        self.setup = dataclasses.replace(setup, substep_s=substep)
        self._blocked = blocked
        self.bodies = bodies.allocate(n, len(structure.mass), vehicle.axles)
        self._scratch = bodies.scratch(len(structure.mass), vehicle.axles)
        self.body_constants = body_constants(vehicle, structure, setup.track_geometry or TrackGeometry())

    def start(self, index: int, stop: Stop, mechanisms: Choice | None = None) -> None:
        """Put vehicle `index` at the start of a stop, see `Plant.start`."""
        if mechanisms is not None:
            _refuse_load_transfer(make(mechanisms))
        super().start(index, stop, mechanisms)
        m, s = self.bodies, self.state
        structure = assemble(self.vehicle, float(self.conditions.mass[index]))
        for array in m:
            array[index] = 0
        m.rows[index] = -np.inf
        turning = self._turning
        mass = structure.mass.copy()
        mass[turning] = self._physics.inertia[index]
        m.mass[index], m.hanging[index], m.axle_load[index] = mass, structure.hanging, structure.axle_load
        m.inverse[index] = self._inverse(mass, structure.hanging)
        last = WHEELSETS + 6 * self.vehicle.axles
        m.speed[index, X_:last:6] = s.speed[index]
        m.speed[index, turning] = s.wheel_speed[index]
        m.position[index, Z_:last:6] = lowered(float(structure.axle_load.mean()) / 2.0, self.body_constants.rolling).z
        m.wheel_load[index] = structure.axle_load[:, None] / 2.0

    @property
    def _turning(self) -> np.ndarray:
        """Coordinates (A,) of the wheelsets' turning."""
        return WHEELSETS + 6 * np.arange(self.vehicle.axles) + PITCH

    def _inverse(self, mass: np.ndarray, hanging: np.ndarray) -> np.ndarray:
        """Return the inverse (n, n) of M + theta h C + (theta h)^2 K, or that of the blocked vehicle's M."""
        b, h = self.body_constants, self.body_constants.theta * self.constants.substep
        if not self._blocked:
            e = b.elements
            whole: np.ndarray = np.linalg.inv(np.diag(mass + h * h * hanging) + h * e.damping + h * h * e.stiffness)
            return whole
        axles = self.vehicle.axles
        free = np.zeros((len(mass), 1 + axles))
        free[X_ : WHEELSETS + 6 * axles : 6, 0] = 1.0
        free[self._turning, 1 + np.arange(axles)] = 1.0
        inverse: np.ndarray = free @ np.linalg.inv(free.T @ np.diag(mass) @ free) @ free.T
        return inverse

    def step(self, command: ArrayLike) -> None:
        """Advance by one control interval under the commands (N, A), see `Plant.step`."""
        given = check_command(command, self.n, self.vehicle.axles)
        advance(given, self._law, *self._given, (self.bodies, self.body_constants, self._scratch))

    def set_state(self, index: int, wheel_speed_radps: np.ndarray, pressure_bar: np.ndarray) -> None:
        """Let a stop that was just started begin with these wheel speeds and pressures (A,), the distributor filled."""
        super().set_state(index, wheel_speed_radps, pressure_bar)
        self.bodies.speed[index, self._turning] = wheel_speed_radps

    def given_up(self) -> Mapping[int, str]:
        """Return the vehicles that derailed or cannot be computed any more, with the reason."""
        fault = self.bodies.fault
        return {int(i): REASONS[int(fault[i, 0])].format(fault[i, 1] + 1) for i in np.flatnonzero(fault[:, 0])}

    def further_truth(self) -> Mapping[str, np.ndarray]:
        """Return wheel loads, contact points, lateral shift, derailment quotient, and where carbody and bogies are.

        Sides are left and right; a body shifts along x, y, z (forward, left, up) and turns about them (roll, pitch, yaw).
        """
        m = self.bodies
        lost = self.given_up()
        touches = m.rows[..., PRESSED] > 0.0
        loaded = m.wheel_load > 0.0
        return {
            "wheel_load_n": m.wheel_load.copy(),
            "guiding_force_n": m.guiding.copy(),
            "derailment_quotient": np.where(loaded, m.guiding / np.where(loaded, m.wheel_load, 1.0), np.nan),
            "lateral_shift_m": m.shift.copy(),
            "contact_points_m": np.where(touches[..., None], m.rows[..., [Y, Z]], np.nan),
            "body_shift_m": m.position[:, :WHEELSETS].reshape(self.n, 3, 6)[..., :3].copy(),
            "body_turn_rad": m.position[:, :WHEELSETS].reshape(self.n, 3, 6)[..., 3:].copy(),
            "given_up": np.array([lost.get(i, "") for i in range(self.n)]),
        }

    @property
    def kinetic_energy(self) -> np.ndarray:
        """Kinetic energy of all bodies (N,) [J]."""
        energy: np.ndarray = 0.5 * np.sum(self.bodies.mass * self.bodies.speed**2, axis=1)
        return energy

    @property
    def stored_energy(self) -> np.ndarray:
        """Energy in the springs and in the height of the bodies (N,) [J], but for bump-stops and contacts; straight track."""
        m, q = self.bodies, self.bodies.position
        springs = 0.5 * np.einsum("ni,ij,nj->n", q, self.body_constants.elements.stiffness, q) + 0.5 * np.sum(
            m.hanging * q**2, axis=1
        )
        lift = q[:, WHEELSETS + Z_ : WHEELSETS + 6 * self.vehicle.axles : 6]
        energy: np.ndarray = 0.5 * springs + np.sum(m.axle_load * lift, axis=1)
        return energy


def body_constants(vehicle: Vehicle, structure: Structure, track: TrackGeometry) -> BodyConstants:
    """Return what is the same in every stop; `ParameterError` for a track on which the vehicle cannot stand."""
    m = vehicle.multibody
    elements = Elements(
        structure.stiffness, structure.damping, structure.bump_stops, np.array(m.bump_stop_deflection_m),
        np.array(m.bump_stop_force_n), structure.place, structure.height,
    )  # fmt: skip
    return BodyConstants(elements, rolling_of(vehicle, track), way_of(track), structure.bogie_of, THETA)


def _refuse_load_transfer(own: Mechanisms) -> None:
    """Raise `ParameterError` for a mechanism that moves wheel loads, which this plant computes from its bodies."""
    for name, card in ALL.items():
        if "wheel_load" in card.acts and getattr(own, name) != getattr(NULL, name):
            raise ParameterError(f"mechanism {name}: the multibody plant moves the wheel loads by itself; leave it out")
