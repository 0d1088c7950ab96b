"""Drives a batch of stops with one controller: measurement in, command out; records what happened."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.child import TookTooLongError, limited
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.faults import Faults, standing_reported
from wsp_env.evaluation.policy import Policy
from wsp_env.parameters.track_geometry import TrackGeometry
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.command import share_of_pressure
from wsp_env.plant.port import Measurement, Plant, Setup, Stop, given_up

#: Time between two commands [s], as in the environments; a WSP decides some 50 times a second (assumption).
CONTROL_INTERVAL_S = 0.02

#: Time that a controller may take for one decision [s] of the processor: it may load a lot at its first one (assumption);
#: what numba compiles does not count, see `wsp_env.child.limited`.
DECISION_LIMIT_S = 30.0

#: A stop that has not ended after so long is given up [s]: a locked coach on soap needs some 250 s from 200 km/h.
TIME_LIMIT_S = 400.0


class ControllerFailure(Exception):  # noqa: N818  # what is reported is the controller's failure, not an error of this package
    """A controller raised, or returned what is no command; the message says what, when and where."""


@dataclasses.dataclass(frozen=True)
class StopRecords:
    """What happened in N stops with A axles, at the T + 1 ends of the control intervals; a vehicle at rest keeps its state."""

    time: np.ndarray  # (T + 1,) since the start [s]
    speed: np.ndarray  # (T + 1, N) [m/s]
    position: np.ndarray  # (T + 1, N) of the leading axle [m]
    slip: np.ndarray  # (T + 1, N, A) v - r w [m/s]
    pressure: np.ndarray  # (T + 1, N, A) [bar]
    adhesion: np.ndarray  # (T + 1, N, A) f = T / N [-]
    command: np.ndarray  # (T, N, A) -1 vent, 0 hold, +1 apply
    steps: np.ndarray  # (N,) number of control intervals until the vehicle stood
    duration: np.ndarray  # (N,) [s]
    distance: np.ndarray  # (N,) [m]
    stopped: np.ndarray  # (N,) bool; False: given up at the time limit, or by the plant
    air: np.ndarray  # (N, A) [Nl]
    contact_work: np.ndarray  # (N, A) heat in both contacts of the wheelset [J]
    reported: np.ndarray | None = None  # (T, N, A) bool, wheels that the controller says stand; None: it was not asked


@dataclasses.dataclass(frozen=True)
class Conduct:
    """How stops are run, whatever brakes."""

    control_interval_s: float = CONTROL_INTERVAL_S
    time_limit_s: float = TIME_LIMIT_S
    pressure_sensors: bool = False
    mechanisms: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    plant: str = "longitudinal"  # see `wsp_env.plant.make_plant`
    track_geometry: TrackGeometry | None = None  # see `wsp_env.plant.port.Setup`


def run(
    controller: Controller,
    vehicle: Vehicle,
    stops: Sequence[Stop],
    conduct: Conduct = Conduct(),  # frozen
    sensor_fails_s: np.ndarray | None = None,
    faults: Faults | None = None,
) -> StopRecords:
    """Brake all `stops` at once with one controller.

    A controller commands valves (-1 vent, 0 hold, +1 apply); one with the attribute `action = "pressure"` commands pressures,
    -1 none to +1 the demanded one.

    Parameters
    ----------
    stops : N conditions, all with the same number of track nodes
    conduct : control interval, time limit, sensors
    sensor_fails_s : (N, A) time from which a wheel's sensor reads 0 [s]; inf where it stays sound
    faults : what else fails; its sensors count where `sensor_fails_s` is not given

    Raises
    ------
    ControllerFailure
        whatever the controller raises or returns instead of numbers from -1 to +1 of shape (N, A)
    ParameterError
        for a policy whose contract does not fit

    """
    if isinstance(controller, Policy):
        controller.check(vehicle, conduct.control_interval_s, conduct.pressure_sensors)
    by_pressure = getattr(controller, "action", "valve") == "pressure"
    plant = start_plant(vehicle, stops, conduct, by_pressure)
    _guarded(controller, "reset", 0.0, len(stops), vehicle)
    fails = faults.sensor_s if faults is not None and sensor_fails_s is None else sensor_fails_s
    reported: list[np.ndarray] = []

    def decide() -> np.ndarray:
        seen = measure(plant, conduct.pressure_sensors, fails)
        time = float(np.max(seen.time))
        command = check_command(controller, _guarded(controller, "act", time, seen), seen.wheel_speed.shape, time)
        reported.append(standing_reported(controller, command.shape))
        wanted = share_of_pressure(command) if by_pressure else command
        return wanted if faults is None else faults.acting(wanted, seen.time, by_pressure)

    return dataclasses.replace(record(plant, decide, conduct), reported=np.stack(reported))


def start_plant(vehicle: Vehicle, stops: Sequence[Stop], conduct: Conduct, by_pressure: bool = False) -> Plant:
    """Return a plant with every stop at its start."""
    setup = Setup(
        conduct.control_interval_s,
        mechanisms=conduct.mechanisms,
        pressure_control=by_pressure,
        track_nodes=len(stops[0].profile),
        track_geometry=conduct.track_geometry,
    )
    plant = make_plant(vehicle, len(stops), setup, conduct.plant)
    for i, stop in enumerate(stops):
        plant.start(i, stop)
    return plant


def record(plant: Plant, decide: Callable[[], np.ndarray], conduct: Conduct) -> StopRecords:
    """Step the plant under the commands of `decide` until all its vehicles stand; return what happened."""
    samples: dict[str, list[np.ndarray]] = {name: [] for name in ("speed", "position", "slip", "pressure", "adhesion")}
    commands = []
    steps = np.zeros(plant.n, dtype=int)

    def sample() -> None:
        now = plant.truth()
        values = (now.speed, now.position, now.slip_speed, now.pressure, now.adhesion)
        for name, value in zip(samples, values, strict=True):
            samples[name].append(value.astype(np.float64 if name == "position" else np.float32))

    sample()
    for _ in range(int(np.ceil(conduct.time_limit_s / conduct.control_interval_s - 1e-9))):
        steps += plant.moving
        command = decide()
        plant.step(command)
        commands.append(command.astype(np.float32))
        sample()
        if not plant.moving.any():
            break
    end = plant.truth()
    stopped = ~plant.moving
    stopped[list(given_up(plant))] = False
    return StopRecords(
        time=conduct.control_interval_s * np.arange(len(commands) + 1),
        **{name: np.stack(values) for name, values in samples.items()},
        command=np.stack(commands),
        steps=steps,
        duration=end.time.copy(),
        distance=end.position.copy(),
        stopped=stopped,
        air=end.air.copy(),
        contact_work=end.contact_work.copy(),
    )


def measure(plant: Plant, pressure_sensors: bool = False, sensor_fails_s: np.ndarray | None = None) -> Measurement:
    """Return what the sensors of a plant say now, failed ones 0; copies."""
    reading = plant.reading()
    if sensor_fails_s is not None:
        reading.wheel_speed[reading.time[:, None] >= sensor_fails_s] = 0.0
    return reading if pressure_sensors else reading._replace(pressure=None)


def check_command(controller: Controller, given: Any, shape: tuple[int, ...], time: float) -> np.ndarray:
    """Return the commands as floats; `ControllerFailure` when they are not numbers from -1 to +1 of that shape."""
    who = type(controller).__name__
    try:
        if given is None:  # numpy would take it for nan
            raise TypeError
        command = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ControllerFailure(f"{who}.act returned {type(given).__name__} instead of numbers at {time:.2f} s") from None
    if command.shape != shape:
        raise ControllerFailure(
            f"{who}.act returned shape {command.shape} at {time:.2f} s, expected {shape}: one command per stop and axle"
        )
    if not np.isfinite(command).all():
        stop, axle = np.argwhere(~np.isfinite(command))[0]
        value = command[stop, axle]
        raise ControllerFailure(f"{who}.act returned {value} for axle {axle + 1} of stop {stop + 1} at {time:.2f} s")
    if (beyond := np.argwhere(np.abs(command) > 1.0)).size:
        stop, axle = beyond[0]
        given = f"{who}.act returned {command[stop, axle]:g} for axle {axle + 1} of stop {stop + 1} at {time:.2f} s"
        raise ControllerFailure(f"{given}: {meaning_of(controller)}")
    return command


def meaning_of(controller: Controller) -> str:
    """Say what the numbers are that a controller returns."""
    if getattr(controller, "action", "valve") == "pressure":
        return "-1 asks for no pressure, +1 for the demanded one"
    return "-1 vents, 0 holds, +1 applies (the environments' actions 0, 1, 2 less one)"


def _guarded(controller: Controller, method: str, time: float, *arguments: Any) -> Any:
    try:
        with limited(DECISION_LIMIT_S):
            return getattr(controller, method)(*arguments)
    except TookTooLongError:
        what = f"{type(controller).__name__}.{method} took more than {DECISION_LIMIT_S:g} s of the processor"
        raise ControllerFailure(f"{what} at {time:.2f} s") from None
    except (Exception, SystemExit) as error:  # whatever a third-party controller raises
        what = f"{type(controller).__name__}.{method} raised {type(error).__name__} at {time:.2f} s: {error}"
        raise ControllerFailure(what) from error
