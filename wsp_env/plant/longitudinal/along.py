"""The plant's physics along a measured trajectory: what contact, brake and resistances would have done there.

The same slots as in the plant's step (`wsp_env.plant.slots`) are evaluated at the measured speeds instead of integrating them.
Evaluation is causal: a sample depends on itself and earlier ones, through the slow states (memory of the contaminant layer,
discs' temperature, energy on the rail), which run through the whole recording on the model's own adhesion at the measured slip.

With a prediction a caller forms the four balances, w and v being the prediction's wheel and vehicle speed, r its radii and
J its inertia, T = (C + J dw/dt) / r the force of a wheelset from its own balance (C is torque_nm, or the measured torque):

    vehicle     mass dv/dt + sum T + resistance
    adhesion    T / (2 wheel_load) - adhesion
    kinematics  v - r w while rolling freely
    actuator    measured torque - torque_nm
"""

import copy
import dataclasses
import itertools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.contact.traction import Adhesion
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.card import Doing
from wsp_env.plant.longitudinal.samples import AT_ONCE, KEPT, SPARE, Columns, Found, Given, evaluate, undone
from wsp_env.plant.longitudinal.state import PlantConstants, constants, physics
from wsp_env.plant.mechanisms import Active, Mechanisms
from wsp_env.plant.port import Choice, Setup


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """A measured stop, T samples of A axles, or several one after the other; smoothed, without gaps.

    Anything array-like is accepted and kept as float64. `ParameterError` for shapes that do not fit together, for numbers that
    are not finite, a time that does not rise or samples farther
    apart than the mechanisms that remember the rail can follow.
    """

    time_s: np.ndarray  # (T,) [s], rising
    speed_mps: np.ndarray  # (T,) of the vehicle, as recorded [m/s]
    acceleration_mps2: np.ndarray  # (T,) its derivative [m/s2]
    position_m: np.ndarray  # (T,) of the leading axle, in running direction [m]; steps back are held
    wheel_speed_radps: np.ndarray  # (T, A) as recorded [rad/s]
    wheel_acceleration_radps2: np.ndarray  # (T, A) its derivative [rad/s2]
    brake_torque_nm: np.ndarray  # (T, A) per wheelset, measured or nominal gain x pressure, positive in braking [N m]
    first: tuple[int, ...] = (0,)  # the sample at which each stop begins
    mean_s: tuple[float, ...] = ()  # time over which the values of each stop are means [s]; (): they are instants

    def __post_init__(self) -> None:
        """Make the arrays what the compiled loop takes, and check them."""
        samples, axles = np.shape(self.wheel_speed_radps) if np.ndim(self.wheel_speed_radps) == 2 else (0, 0)
        if samples == 0 or axles == 0:
            raise ParameterError(f"wheel_speed_radps has shape {np.shape(self.wheel_speed_radps)}, expected (samples, axles)")
        for name in _ARRAYS:
            self._keep(name, getattr(self, name), (samples, axles) if name.startswith(("wheel", "brake")) else (samples,))
        if self.mean_s and len(self.mean_s) != len(self.first):
            raise ParameterError(f"mean_s has {len(self.mean_s)} values, expected one for each of {len(self.first)} stops")
        place = [np.maximum.accumulate(self.position_m[stop]) for stop in self.stops]
        object.__setattr__(self, "position_m", np.concatenate(place))
        if not all((np.diff(self.time_s[stop]) > 0.0).all() for stop in self.stops):
            raise ParameterError("time_s does not rise from sample to sample")
        farthest = max(float(np.diff(one).max(initial=0.0)) for one in place)
        if farthest > min(card.longest_step_m for card in mechanisms.ALL.values()):
            raise ParameterError(f"samples lie up to {farthest:g} m apart, too far to follow what the wheels leave on the rail")

    @property
    def stops(self) -> list[slice]:
        """The samples of each stop."""
        return [slice(*ends) for ends in itertools.pairwise((*self.first, len(self.time_s)))]

    @property
    def columns(self) -> Columns:
        """The arrays as the compiled loop takes them."""
        return Columns(*(getattr(self, name) for name in _ARRAYS))

    def measured(self, **arrays: np.ndarray) -> "Trajectory":
        """Return it with other speeds, of the vehicle or of its wheels."""
        other = copy.copy(self)
        for name, array in arrays.items():
            other._keep(name, array, getattr(self, name).shape)
        return other

    def _keep(self, name: str, values: ArrayLike, shape: tuple[int, ...]) -> None:
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.shape != shape:
            raise ParameterError(f"{name} has shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise ParameterError(f"{name} is not finite at sample {np.argwhere(~np.isfinite(array))[0][0]}")
        object.__setattr__(self, name, array)


_ARRAYS = tuple(field.name for field in dataclasses.fields(Trajectory) if field.name not in ("first", "mean_s"))


@dataclasses.dataclass(frozen=True)
class Belief:
    """What is believed of one stop; of several stops mass and gradient may be arrays (stops,)."""

    mu_cd: ArrayLike  # kinetic friction of the contaminated rail [-]; a number, (T, 1) or (T, A)
    tau: float  # recovery rate [m/J]
    mass_kg: ArrayLike  # [kg]
    radius_m: ArrayLike  # of the wheels [m]; a number or (A,)
    gradient: ArrayLike = 0.0  # rise over distance [-]


class Prediction(NamedTuple):
    """What the model says along a trajectory; wheels and axles in the order of the trajectory."""

    adhesion: np.ndarray  # (T, A) f = T / N, signed as the slip [-]
    adhesion_slope: np.ndarray  # (T, A) its derivative by the slip speed [s/m]
    wheel_load_n: np.ndarray  # (T, A) of one wheel [N]
    slip_speed_mps: np.ndarray  # (T, A) v - r w with the mechanisms on the sensors undone [m/s]
    wheel_speed_radps: np.ndarray  # (T, A) with the mechanisms on the sensors undone [rad/s]
    torque_factor: np.ndarray  # (T, A) brake torque over `brake_torque_nm` where that is a nominal one [-]
    torque_nm: np.ndarray  # (T, A) of the brakes, from `brake_torque_nm` where that is a nominal one [N m]
    speed_mps: np.ndarray  # (T,) with the mechanisms on the sensors undone [m/s]
    resistance_n: np.ndarray  # (T,) against the motion, beside the wheels: resistances, gradient, track brake [N]
    mass_kg: Any  # as in the belief, with the mechanisms on it
    radius_m: np.ndarray  # (A,) with the mechanisms on them [m]
    inertia_kgm2: np.ndarray  # (A,) of the wheelsets, with the mechanisms on it [kg m2]


class PlantModel(NamedTuple):
    """A vehicle with mechanisms on, as `along` takes it."""

    constants: PlantConstants
    mechanisms: Mechanisms
    law: Any  # with the mechanisms that change it
    inertia_kgm2: np.ndarray  # (A,) with the mechanisms that change it
    axle_positions_m: tuple[float, ...]


def model(vehicle: Vehicle, choice: Choice | None = None) -> PlantModel:
    """Return a vehicle with the mechanisms of `choice` on, see `mechanisms.make`."""
    return of_mechanisms(vehicle, mechanisms.make(choice))


def of_mechanisms(vehicle: Vehicle, own: Mechanisms) -> PlantModel:
    """Return a vehicle with mechanisms on."""
    _, law, inertia = physics(own, vehicle)
    believed = vehicle.contact.law
    return PlantModel(constants(vehicle, Setup()), own, type(believed)(*map(float, law)), inertia, vehicle.axle_positions_m)


#: Slots in which a mechanism changes speeds, torques or the forces beside the wheels.
_MOVING = frozenset(
    {"mass", "gradient", "radii", "inertia", "torque_factor", "torque", "force", "wheel_speed", "reading_factor", "true_speed"}
)


def moving(own: Mechanisms, loads: bool = False) -> Mechanisms:
    """Return mechanisms with those off that change nothing but the contacts, and the wheels' `loads` where these count too."""
    return mechanisms.acting_in(_MOVING | {"wheel_load"} if loads else _MOVING, own)


def along(
    trajectory: Trajectory, run: Belief, m: PlantModel, doings: np.ndarray | None = None, contacts: bool = True
) -> Prediction:  # fmt: skip
    """Evaluate the model of `model` along a trajectory (T samples, A axles).

    Parameters
    ----------
    doings : (fields of `Doing`, T, A), if given, is filled with what every axle is doing, as slot "before_contact" is told
    contacts : whether adhesion is asked for, without which the rest costs half; else it is not a number, unless the rest
        depends on it

    Raises
    ------
    ParameterError
        when trajectory and vehicle have different numbers of axles, or a condition of the run cannot be

    """
    samples, axles = trajectory.wheel_speed_radps.shape
    if axles != len(m.axle_positions_m):
        raise ParameterError(f"the trajectory has {axles} axles, the vehicle {len(m.axle_positions_m)}")
    stops, acting = len(trajectory.first), mechanisms.acting(m.mechanisms)
    masses, gradients = (
        np.array([
            mechanisms.believed_to_true(slot, m.mechanisms, float(one)) if slot in acting else one
            for one in np.broadcast_to(believed, (stops,))
        ], dtype=np.float64)
        for slot, believed in (("mass", run.mass_kg), ("gradient", run.gradient))
    )  # fmt: skip
    radius = np.array(
        mechanisms.believed_to_true("radii", m.mechanisms, np.broadcast_to(run.radius_m, (axles,))), dtype=np.float64
    )
    mu_cd = np.broadcast_to(np.asarray(run.mu_cd, dtype=np.float64), (samples, axles))
    for name, lowest in (("mu_cd", mu_cd.min()), ("mass_kg", masses.min()), ("radius_m", radius.min())):
        if not lowest > 0.0:
            raise ParameterError(f"{name} = {lowest:g} is impossible: it must be above 0")
    tau = mechanisms.believed_to_true("tau", m.mechanisms, run.tau)
    if not 0.0 <= tau < np.inf:
        raise ParameterError(f"tau = {tau:g} m/J is impossible: it must be finite, 0 or more")
    active = Active(m.mechanisms, m.constants.derived, mechanisms.remember(stops, m.axle_positions_m))
    given = Given(
        trajectory.columns, np.array([*trajectory.first, samples]), np.array(trajectory.mean_s or np.zeros(stops)), mu_cd,
        float(tau), masses, gradients, radius, m.inertia_kgm2, m.constants, m.law, active, "after_passage" in acting,
        "before_contact" in acting, doings is not None or "torque" in acting,
    )  # fmt: skip
    at_once = 1 if mechanisms.recalls(m.mechanisms) or doings is not None else AT_ONCE
    found = Found(
        np.empty((7, samples, axles)), np.empty((2, samples)), np.zeros((KEPT, stops, axles)),
        np.empty((len(Doing._fields), stops, axles)) if doings is None else doings,
        np.ones((8, at_once * axles + SPARE)), np.empty((len(Adhesion._fields), at_once * axles + SPARE)),
    )  # fmt: skip
    contacts = contacts or doings is not None or mechanisms.work_moves(m.mechanisms)
    evaluate(given, found, contacts, at_once)
    if not contacts:
        found.per_axle[:2] = np.nan
    adhesion, slope, load, slip, wheel, factor, true = found.per_axle
    speed, resisted = found.per_vehicle
    mass = masses if np.ndim(run.mass_kg) else float(masses[0])
    return Prediction(adhesion, slope, load, slip, wheel, factor, true, speed, resisted, mass, radius, m.inertia_kgm2)


def true_wheel_acceleration(m: PlantModel, read_rate: np.ndarray, read_jerk: np.ndarray) -> np.ndarray:
    """Return dw/dt (T, A) [rad/s2], mechanisms on the sensors undone, from the recorded one and its rate [rad/s3].

    What a sensor does is linear and the same at all times, so the rate passes `slots.wheel_speed` as the speed does.
    """
    if "wheel_speed" not in mechanisms.acting(m.mechanisms):
        return read_rate
    rate = np.empty(read_rate.shape)
    active = Active(m.mechanisms, m.constants.derived, mechanisms.remember(1, m.axle_positions_m))
    undone(read_rate, read_jerk, active, rate)
    return rate
