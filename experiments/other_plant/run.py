"""Brakes stops of the other plant under a controller, and returns the figures of each."""

import math
from typing import Protocol

import numpy as np

from experiments.other_plant.draw import body
from experiments.other_plant.plant import END_S, advance
from experiments.other_plant.records import State, Stops
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

_STANDS_S = 0.4  # without a pulse after which the sensor says that the wheel stands [s] (assumption)


class Controller(Protocol):
    """What is braked with, see docs/drive_it.md."""

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin `n` stops of a vehicle."""

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""


class PulseSensors:
    """Wheel speeds from the edges of the pulse wheels, once a decision."""

    def __init__(self, stops: Stops, state: State, interval_s: float) -> None:
        """Begin with the edges that rolling wheels have passed before the stop."""
        self._stops, self._state = stops, state
        self._pitch = 2.0 * np.pi / stops.pulses[:, None]
        self._window = np.maximum(np.rint(stops.window_s / interval_s).astype(int), 1)
        deep = int(self._window.max()) + 1
        ago = np.ceil(np.arange(deep) * interval_s * state.omega_radps[:, :, None] / self._pitch[:, :, None])
        self._edges = -ago  # (N, A, decisions ago), as edges and times of the last edge
        self._times = state.edge_s[:, :, None] - ago * self._pitch[:, :, None] / state.omega_radps[:, :, None]
        self._speed = state.omega_radps.copy()

    def read(self, tick: int, time_s: float) -> np.ndarray:
        """Return the wheel speeds (N, A) [rad/s] at a decision: pulses of the window over the time between edges."""
        if tick > 0:
            self._edges = np.concatenate([self._state.edges[:, :, None], self._edges[:, :, :-1]], axis=2)
            self._times = np.concatenate([self._state.edge_s[:, :, None], self._times[:, :, :-1]], axis=2)
        row = np.arange(self._window.size)
        count = self._edges[:, :, 0] - self._edges[row, :, self._window]
        span = self._times[:, :, 0] - self._times[row, :, self._window]
        since = np.maximum(time_s - self._times[:, :, 0], 1e-9)
        silent = np.where(since > _STANDS_S, 0.0, np.minimum(self._speed, self._pitch / since))
        self._speed = np.where(count > 0, count * self._pitch / np.where(count > 0, span, 1.0), silent)
        noise = self._stops.noise_radps[:, None] * _normal(self._stops.key, tick, self._speed.shape[1])
        seen: np.ndarray = np.maximum(self._speed + noise, 0.0)
        return seen


def _normal(key: np.ndarray, tick: int, axles: int) -> np.ndarray:
    """Return standard normal numbers (N, A) that depend on key, decision and axle only (splitmix64, Box-Muller)."""
    place = np.uint64(2 * axles * tick) + np.arange(2 * axles, dtype=np.uint64)
    bits = key[:, None] + (place + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    share = ((bits ^ (bits >> np.uint64(31))) >> np.uint64(11)).astype(float) * 2.0**-53
    return np.asarray(np.sqrt(-2.0 * np.log1p(-share[:, :axles])) * np.cos(2.0 * np.pi * share[:, axles:]))


def start(stops: Stops, interval_s: float) -> State:
    """Return the state at the begin: rolling wheels, empty cylinders, valves open to the distributor."""
    n, axles = stops.radius_m.shape
    deep = math.ceil(float(stops.dead_s.max()) / interval_s) + 2
    omega = stops.speed_mps[:, None] / stops.radius_m
    pitch = 2.0 * np.pi / stops.pulses[:, None]

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    return State(
        ended=np.zeros(n, bool), time_s=zeros(n), speed_mps=stops.speed_mps.copy(), position_m=zeros(n), pitch_mps2=zeros(n),
        omega_radps=omega, pressure_bar=zeros(n, axles), pressing_bar=zeros(n, axles), spool=np.ones((n, axles)),
        command=np.ones((n, axles, deep)), angle_rad=stops.pulse_phase * pitch, edges=zeros(n, axles),
        edge_s=-stops.pulse_phase * pitch / omega, contact_j=zeros(n), brake_j=zeros(n), resistance_j=zeros(n), air_nl=zeros(n),
        braking=np.zeros(n, bool), watched_s=zeros(n), slip_m=zeros(n, axles), slip_squared=zeros(n, axles),
        standing_s=zeros(n, axles), locked_s=zeros(n),
    )  # fmt: skip


def simulate(controller: Controller, believed: Vehicle, stops: Stops, interval_s: float, substep_s: float) -> State:
    """Brake all stops and return the state at their ends; the arguments are those of `brake`."""
    common, state = body(believed), start(stops, interval_s)
    sensors = PulseSensors(stops, state, interval_s)
    n, axles = stops.radius_m.shape
    substeps = max(round(interval_s / substep_s), 1)
    controller.reset(n, believed)
    seen = sensors.read(0, 0.0)
    for tick in range(math.ceil(END_S / interval_s) + 1):
        if state.ended.all():
            break
        measurement = Measurement(np.full(n, tick * interval_s), seen.copy(), np.ones(n))
        command = np.array(controller.act(measurement), dtype=float, order="C")
        if command.shape != (n, axles) or not np.isfinite(command).all():
            raise ValueError(f"commands of shape {command.shape}, expected {(n, axles)}, all finite")
        advance(command, tick, interval_s, substeps, common, stops, state)
        now = sensors.read(tick + 1, (tick + 1) * interval_s)
        seen = np.where(state.ended[:, None], seen, now)  # who has ended goes on with the last measurement
    return state


def brake(
    controller: Controller, believed: Vehicle, stops: Stops, interval_s: float = 0.02, substep_s: float = 5e-4
) -> dict[str, np.ndarray]:
    """Brake stops with full demand from the first moment, and return their figures.

    Parameters
    ----------
    controller
        decides every `interval_s`; its commands hold until the next
    believed
        vehicle that is reported to the controller, and whose number of axles brakes
    stops
        true parameters, from `draw.draw`
    interval_s, substep_s
        between decisions, and of the integration [s]

    Returns
    -------
    dict
        arrays (N,): `distance_m` and `duration_s` until v < 0.3 m/s, or after 200 s; `mean_slip_mps`, the mean of v - r omega
        over axles and time from the first cylinder pressure above 0.1 bar to 5 km/h; `slip_deviation_mps`, its standard
        deviation over time, mean of the axles; `contact_energy_mj` in all contacts; `locked_s`, the longest time for which a
        wheel stands (rim below 0.5 m/s) above 15 km/h; `air_nl` vented by the dump valves, from isothermal cylinders of the
        believed volume (8 l an axle by default) [Nl of 1.01325 bar]

    """
    state = simulate(controller, believed, stops, interval_s, substep_s)
    watched = np.maximum(state.watched_s, 1e-9)[:, None]
    mean = state.slip_m / watched
    variance = np.maximum(state.slip_squared / watched - mean**2, 0.0)
    return {
        "distance_m": state.position_m,
        "mean_slip_mps": mean.mean(axis=1),
        "slip_deviation_mps": np.sqrt(variance).mean(axis=1),
        "contact_energy_mj": state.contact_j / 1e6,
        "locked_s": state.locked_s,
        "air_nl": state.air_nl,
        "duration_s": state.time_s,
    }
