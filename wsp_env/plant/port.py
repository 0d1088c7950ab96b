"""The front door of the plant: what anyone may ask of a braked vehicle, and nothing else.

Environments, evaluation, recordings and agents know a plant by this module only (import-linter sees to it). N is the number of
vehicles of a batch, A the number of axles. A plant of somebody else is a class that takes `(vehicle, n, setup)` and has the
members of `Plant`; it may derive from `Plant`, and takes part by its import path, `plant="package.module:Class"`.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import TrackGeometry
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.command import APPLIES, VENTS

#: Physics beyond the paper's model, {mechanism: {parameter: value}}, see `wsp_env.plant.mechanisms.make`.
Choice = Mapping[str, Mapping[str, float]]

#: Distance of the nodes that describe the track [m].
TRACK_STEP_M = 5.0


class Measurement(NamedTuple):
    """What the sensors of N vehicles with A axles say at one moment; never the true speed or adhesion."""

    time: np.ndarray  # (N,) since the start of the stop [s]
    wheel_speed: np.ndarray  # (N, A) from the tachometers [rad/s]
    demand: np.ndarray  # (N,) brake demand, 0 to 1 of full pressure [-]
    pressure: np.ndarray | None = None  # (N, A) in the cylinders [bar], only where the vehicle has the sensors


class Truth(NamedTuple):
    """What no controller may know. The arrays belong to the plant: read them at once, copy what is kept, write nothing."""

    time: np.ndarray  # (N,) since the start of the stop [s]
    position: np.ndarray  # (N,) of the leading axle along the track [m]
    speed: np.ndarray  # (N,) [m/s]
    deceleration: np.ndarray  # (N,) [m/s2]
    wheel_speed: np.ndarray  # (N, A) [rad/s]
    slip_speed: np.ndarray  # (N, A) v - r w [m/s]
    pressure: np.ndarray  # (N, A) in the brake cylinders [bar]
    distributor: np.ndarray  # (N,) pressure that the distributor gives [bar]
    adhesion: np.ndarray  # (N, A) f = T / N [-], signed as the slip
    adhesion_d: np.ndarray  # (N, A) its limit without recovery [-]
    adhesion_r: np.ndarray  # (N, A) its limit after full recovery [-]
    air: np.ndarray  # (N, A) let into the cylinders [Nl]
    contact_work: np.ndarray  # (N, A) heat in both contacts of the wheelset [J]
    brake_work: np.ndarray  # (N,) heat in discs and pads [J]
    resistance_work: np.ndarray  # (N,) against running resistance and gradient [J]


class Conditions(NamedTuple):
    """What the stops are made of; constant while they last, except that a demand may be changed between steps."""

    mu_cd: np.ndarray  # (N,) kinetic friction coefficient of the contaminated rail [-]
    tau: np.ndarray  # (N,) recovery rate [m/J]
    mass: np.ndarray  # (N,) [kg]
    demand: np.ndarray  # (N,) brake demand, 0 to 1 of full pressure [-]
    gradient: np.ndarray  # (N,) rise over distance, positive uphill [-]
    noise: np.ndarray  # (N,) standard deviation of the wheel-speed sensors [rad/s]
    key: np.ndarray  # (N,) uint64, from which the sensor noise of the stop is computed
    radius: np.ndarray  # (N, A) of the wheels [m]
    profile: np.ndarray  # (N, M) mu_cd along the track relative to `mu_cd` [-], nodes `Setup.track_step_m` apart
    coverage: np.ndarray  # (N, M) share of the contaminant layer that lies there [-]: 1 contaminated, 0 clean


@dataclasses.dataclass(frozen=True)
class Stop:
    """The conditions of one stop, as they are believed; arrays are (A,) and (M,)."""

    mu_cd: float  # [-]
    tau: float  # [m/J]
    initial_speed: float  # [m/s]
    mass: float  # [kg]
    demand: float  # [-]
    gradient: float  # [-]
    noise: float  # [rad/s]
    key: int
    radius: np.ndarray  # (A,) [m]
    profile: np.ndarray  # (M,) [-]
    coverage: np.ndarray  # (M,) [-]


@dataclasses.dataclass(frozen=True)
class Setup:
    """How a plant is run: clock, commands, physics and the grid of the track.

    A plant that does not know the `mechanisms` or the `track_geometry` asked for refuses them with a `ParameterError`. So does
    this record what cannot be of the rest.
    """

    control_interval_s: float = 0.02  # time between commands
    substep_s: float | None = None  # longest substep of the integration; None: the plant's own
    mechanisms: Choice = dataclasses.field(default_factory=dict)
    pressure_control: bool = False  # commands are shares of the demanded pressure, see `wsp_env.plant.command`
    track_step_m: float = TRACK_STEP_M
    track_nodes: int = 1
    track_geometry: TrackGeometry | None = None  # curves, irregularities, rails; None: the plant's own, straight and smooth

    def __post_init__(self) -> None:
        """Refuse a clock or a grid that cannot be."""
        bounds = {
            "control_interval_s": (1e-4, 1.0),
            "substep_s": (1e-6, 1.0),
            "track_step_m": (0.01, 1e4),
            "track_nodes": (1, 10**7),
        }
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if name == "substep_s" and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
                unit = {"s": " s", "m": " m"}.get(name.rpartition("_")[2], "")
                raise ParameterError(f"{name} = {value}{unit} is impossible: it must be a number in [{low:g}, {high:g}]")


class Plant(Protocol):
    """N vehicles of one kind, each braking under its own conditions."""

    vehicle: Vehicle
    n: int
    setup: Setup
    moving: np.ndarray  # (N,) bool; a vehicle that stands stays as it is
    conditions: Conditions  # as they are, with the mechanisms on mass, gradient and radius

    def start(self, index: int, stop: Stop, mechanisms: Choice | None = None) -> None:
        """Put vehicle `index` at the start of a stop: rolling freely at its initial speed with empty cylinders.

        `mechanisms` is the physics of this stop alone, in place of the batch's. `ParameterError` names a condition that cannot
        be.
        """

    def step(self, command: np.ndarray) -> None:
        """Advance by one control interval under the commands (N, A), see `wsp_env.plant.command`."""

    def reading(self) -> Measurement:
        """Return what the sensors say now, cylinder pressures included; copies."""

    def truth(self) -> Truth:
        """Return what is; valid until the next step."""

    def preview(self, then: float | None = None) -> np.ndarray:
        """Return the cylinder pressures (N, A) [bar] once the commands on their way have acted, in whole control intervals.

        With `then`, a command for all axles, one interval later under it. A plant that does not say so is taken for one whose
        valves act at once.
        """
        truth = self.truth()
        aims = {
            VENTS: np.zeros_like(truth.pressure),
            APPLIES: np.repeat(truth.distributor[:, None], self.vehicle.axles, axis=1),
        }
        return truth.pressure.copy() if then is None else aims.get(then, truth.pressure.copy())

    def set_state(self, index: int, wheel_speed_radps: np.ndarray, pressure_bar: np.ndarray) -> None:
        """Let a stop that was just started begin with these wheel speeds and pressures (A,), the distributor filled.

        `ParameterError` from a plant that cannot.
        """
        raise ParameterError(f"{type(self).__name__} cannot begin a stop from recorded wheel speeds and pressures")

    def given_up(self) -> Mapping[int, str]:
        """Return the vehicles that left the track or cannot be computed any more, each with the reason.

        They move no more. A plant that does not say so is taken for one that never gives up.
        """
        return {}

    def further_truth(self) -> Mapping[str, np.ndarray]:
        """Return what else this plant knows, arrays (N, ...) by name with the unit at its end; copies, for `info`."""
        return {}


def given_up(plant: Plant) -> Mapping[int, str]:
    """Return what `Plant.given_up` says; nothing where a plant of somebody else has no such member."""
    return plant.given_up() if hasattr(plant, "given_up") else {}


def further_truth(plant: Plant) -> Mapping[str, np.ndarray]:
    """Return what `Plant.further_truth` says; nothing where a plant of somebody else has no such member."""
    return plant.further_truth() if hasattr(plant, "further_truth") else {}


#: What every plant has.
MEMBERS = ("vehicle", "n", "setup", "moving", "conditions", "start", "step", "reading", "truth", "preview", "set_state")

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
    shapes = {"radius": (vehicle.axles,), "profile": np.shape(stop.coverage), "coverage": np.shape(stop.profile)}
    for name, shape in shapes.items():
        given = np.shape(getattr(stop, name))
        if given != shape or np.size(getattr(stop, name)) == 0:
            raise ParameterError(
                f"{name} has shape {given}: a stop has one radius an axle, and as many nodes of profile as of coverage"
            )
    friction_r = vehicle.contact.kinetic_friction_r
    if not 0.0 < stop.mu_cd <= friction_r:
        raise ParameterError(
            f"mu_cd = {stop.mu_cd:g} is impossible: it must lie in (0, {friction_r:g}], up to kinetic_friction_r (mu_cr)"
        )
    values = {name: getattr(stop, "noise" if name == "sensor_noise" else name) for name in LIMITS}
    for name, (low, high, unit) in LIMITS.items():
        for value in (np.min(values[name]), np.max(values[name])):
            if not low <= value <= high:
                raise ParameterError(
                    f"{name} = {value:g} is impossible: it must lie in [{low:g}, {high:g}] {unit}".removesuffix(" -")
                )


def check_command(command: ArrayLike, n: int, axles: int) -> np.ndarray:
    """Return a copy of the commands (N, A) as floats; `ValueError` for a wrong shape or a command that is not finite."""
    # A copy: a read-only or strided array is another type to numba, and would be compiled for anew.
    command = np.array(command, dtype=np.float64, order="C")
    if command.shape != (n, axles):
        raise ValueError(f"commands have shape {command.shape}, expected {(n, axles)}: one per vehicle and axle")
    if not np.isfinite(command).all():
        row, axle = np.argwhere(~np.isfinite(command))[0]
        raise ValueError(f"the command of vehicle {row}, axle {axle + 1} is {command[row, axle]}: commands must be finite")
    return command
