"""The environment itself, for a batch of N stops: the single environment is the batch of one."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from wsp_env.envs import step
from wsp_env.envs.task import Task
from wsp_env.observer.observation import Observer
from wsp_env.parameters.quantity import ParameterError, shown
from wsp_env.parameters.track_geometry import find_track_geometry
from wsp_env.plant import make_plant
from wsp_env.plant.command import pressure_commands, share_of_pressure, valve_commands
from wsp_env.plant.port import Measurement, Setup, further_truth, given_up
from wsp_env.scenario import PINS, check_mechanisms, draw, draw_mechanisms, ends_of


class BrakingBatch:
    """N braking stops of one kind of vehicle: plant, observer, reward, start and end of a stop.

    Parameters
    ----------
    vehicle_name : "wheelset", "bogie" or "coach"
    n : number of stops in the batch
    task : the options

    """

    def __init__(self, vehicle_name: str, n: int, task: Task) -> None:
        self.task = task
        self.n = n
        self.vehicle = task.make_vehicle(vehicle_name)
        self.scenario = task.distributions
        if self.scenario.mu_cd[1] > self.vehicle.contact.kinetic_friction_r:
            raise ParameterError(
                f"scenario: mu_cd = {self.scenario.mu_cd} goes beyond kinetic_friction_r (mu_cr) = "
                f"{self.vehicle.contact.kinetic_friction_r:g} of the vehicle's contact; lower the one or raise the other"
            )
        self.weights = task.weights
        self._prices = step.prices(task)
        self._by_pressure = task.action == "pressure"
        self._drawn = check_mechanisms(task.mechanisms)
        setup = Setup(
            task.control_interval_s,
            task.substep_s,
            ends_of(task.mechanisms, 1),  # refuses an axle that the vehicle does not have
            pressure_control=self._by_pressure,
            track_nodes=task.track_nodes,
            track_geometry=find_track_geometry(task.track_geometry) if task.track_geometry != "" else None,
        )
        self.plant = make_plant(self.vehicle, n, setup, task.plant)
        self.observer = Observer(self.vehicle, task.control_interval_s, task.pressure_sensors, self._by_pressure)
        bound = Observer.BOUND
        self.observation_space = spaces.Box(-bound, bound, (self.observer.size,), np.float32)
        axles = self.vehicle.axles
        self.action_space: spaces.Space[Any] = (
            spaces.Box(-1.0, 1.0, (axles,), np.float32) if self._by_pressure else spaces.MultiDiscrete([3] * axles)
        )
        self._fresh = True

    def start(
        self,
        generators: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None = None,
        mask: np.ndarray | None = None,
    ) -> np.ndarray:
        """Begin new stops, all or where `mask` (N,) is True, each from its own generator; return observations (N, size).

        `options` pins conditions by name (see `wsp_env.scenario.PINS`), by one value for all or a sequence of N.
        """
        if mask is None and not self._fresh and options is None:
            mask = np.ones(self.n, dtype=bool)
        pins = self._pins(options)
        classic = self.task.adhesion == "classic"
        for i in range(self.n) if mask is None else np.flatnonzero(mask).tolist():
            own = {name: values[i] for name, values in pins.items()}
            if self.task.stops:
                chosen = own.pop("condition", None)
                drawn = int(generators[i].integers(len(self.task.stops)))
                condition = self.task.condition(drawn if chosen is None else chosen)
                own = {name: value for name, value in condition.items() if name != "name"} | own
            stop = draw(self.scenario, self.vehicle, generators[i], self.task.track_nodes, own, classic)
            self.plant.start(i, stop, draw_mechanisms(self.task.mechanisms, generators[i]) if self._drawn else None)
        observation = self.observer.reset(self.measurement(), None if self._fresh else mask)
        self._fresh = False
        return observation

    def _pins(self, options: Mapping[str, Any] | None) -> dict[str, list[Any]]:
        if options is not None and not isinstance(options, Mapping):
            raise ParameterError(f"reset options must be a dictionary, {{name: value}}, got {shown(options)}")
        pins = {}
        for name, value in (options or {}).items():
            valid = (*PINS, "condition") if self.task.stops else PINS
            if name not in valid:
                raise ParameterError(f"unknown reset option {shown(name)}; valid: {', '.join(valid)}")
            single = isinstance(value, str) or not isinstance(value, Sequence | np.ndarray)
            if name == "track" and not single:  # one profile for all, or a kind or profile for each
                single = all(isinstance(node, int | float | np.number) for node in value)
            if single:
                pins[name] = [value] * self.n
            elif len(value) == self.n:
                pins[name] = list(value)
            else:
                raise ParameterError(f"reset option {name} has {len(value)} values, expected one or {self.n} (one per stop)")
        return pins

    def commands(self, actions: Any) -> np.ndarray:
        """Return actions (N, A) as commands: -1, 0, +1 of the valves or -1 to +1 of the pressure; `ValueError` if wrong."""
        if self._fresh:
            raise RuntimeError("step before reset: call reset() first, it draws the conditions of the stop")
        try:
            command = np.array(actions, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise ValueError(f"actions must be numbers, got {shown(actions)}") from None
        axles = self.vehicle.axles
        if command.shape != (self.n, axles):
            got, want = (
                (command.shape[1:], (axles,)) if self.n == 1 and command.shape[:1] == (1,) else (command.shape, (self.n, axles))
            )
            raise ValueError(f"the action has shape {got}, expected {want}: one entry per axle of the {self.vehicle.name}")
        valid = pressure_commands(command) if self._by_pressure else valve_commands(command)
        if not valid:
            array = np.asarray(actions, dtype=np.float64)
            if not np.isfinite(array).all():
                raise ValueError(f"the action {array.tolist()} is not finite: give numbers from {self.action_space}")
            raise ValueError(f"the action {array.tolist()} is not valid: 0 vents, 1 holds, 2 applies, per axle")
        return command

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Advance by one control interval.

        Returns the observations (N, size), the rewards (N,), the reward's terms by name, each (N,), and who terminated and who
        was truncated, both (N,) bool.
        """
        given = self.commands(actions)
        plant, task = self.plant, self.task
        state = plant.truth()
        before = np.empty((5, self.n))
        step.note(state.position, state.time, state.air, state.speed, self._dry_deceleration(), before)
        plant.step(share_of_pressure(given) if self._by_pressure else given)
        state = plant.truth()
        terms, reward = np.empty((len(step.TERMS), self.n)), np.empty(self.n)
        step.judge(
            before, state.position, state.time, state.air, state.speed, state.slip_speed, self._prices, terms, reward,
        )  # fmt: skip
        lost = np.zeros(self.n, dtype=bool)
        lost[list(given_up(plant))] = True
        terminated = ~plant.moving & ~lost
        late = (state.time >= task.time_limit_s - 1e-9) | (state.position >= task.track_limit_m)
        observation = self.observer.observe(self.measurement(), given)
        return observation, reward, dict(zip(step.TERMS, terms, strict=True)), terminated, (late | lost) & ~terminated

    def _dry_deceleration(self) -> np.ndarray:
        """Return the deceleration (N,) [m/s2] of the demanded brake on dry rail, of a tenth of full brake at least."""
        vehicle, c = self.vehicle, self.plant.conditions
        force = np.maximum(c.demand, 0.1) * vehicle.axles * vehicle.full_brake_torque_nm / vehicle.wheel_radius_m
        rotating = vehicle.axles * vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
        deceleration: np.ndarray = force / (c.mass + rotating)
        return deceleration

    @property
    def locked(self) -> np.ndarray:
        """Wheelsets that stand while the vehicle runs (N, A) bool."""
        return self._derived()[0]

    def _derived(self) -> tuple[np.ndarray, np.ndarray]:
        """Return locked wheelsets (N, A) bool and air (N,) [Nl]."""
        state = self.plant.truth()
        locked, air = np.empty((self.n, self.vehicle.axles), dtype=bool), np.empty(self.n)
        step.derive(state.speed, state.slip_speed, state.air, locked, air)
        return locked, air

    def measurement(self) -> Measurement:
        """Return what the sensors say now; copies."""
        reading = self.plant.reading()
        return reading if self.task.pressure_sensors else reading._replace(pressure=None)

    def truth(self) -> dict[str, np.ndarray]:
        """Return what no controller may know, for `info`: arrays (N, ...) by name, copies."""
        state, conditions = self.plant.truth(), self.plant.conditions
        locked, air = self._derived()
        return {
            "time_s": state.time.copy(),
            "position_m": state.position.copy(),
            "speed_mps": state.speed.copy(),
            "wheel_speed_radps": state.wheel_speed.copy(),
            "slip_speed_mps": state.slip_speed.copy(),
            "pressure_bar": state.pressure.copy(),
            "adhesion": state.adhesion.copy(),
            "adhesion_d": state.adhesion_d.copy(),
            "adhesion_r": state.adhesion_r.copy(),
            "locked": locked,
            "air_nl": air,
            "contact_energy_j": state.contact_work.copy(),
            "mu_cd": conditions.mu_cd.copy(),
            "tau_m_per_j": conditions.tau.copy(),
            "mass_kg": conditions.mass.copy(),
            **further_truth(self.plant),
        }
