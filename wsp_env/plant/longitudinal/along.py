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

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import inlined, loop
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.resistance import running_resistance
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.card import LOCKED_MPS, Doing, Moment, Passage, doing_at, note_doing
from wsp_env.plant.longitudinal.state import PlantConstants, constants, physics
from wsp_env.plant.mechanisms import Active, Mechanisms
from wsp_env.plant.port import Choice, Setup
from wsp_env.plant.slots import (
    after_contact,
    after_passage,
    before_contact,
    contact,
    recovery,
    resistance,
    surface,
    torque,
    torque_factor,
    true_speed,
    wheel_load,
    wheel_speed,
)


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """A measured stop, T samples of A axles; smoothed, without gaps.

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

    def __post_init__(self) -> None:
        """Make the arrays what the compiled loop takes, and check them."""
        samples, axles = np.shape(self.wheel_speed_radps) if np.ndim(self.wheel_speed_radps) == 2 else (0, 0)
        if samples == 0 or axles == 0:
            raise ParameterError(f"wheel_speed_radps has shape {np.shape(self.wheel_speed_radps)}, expected (samples, axles)")
        for field in dataclasses.fields(self):
            array = np.ascontiguousarray(getattr(self, field.name), dtype=np.float64)
            shape = (samples, axles) if field.name.startswith(("wheel", "brake")) else (samples,)
            if array.shape != shape:
                raise ParameterError(f"{field.name} has shape {array.shape}, expected {shape}")
            if not np.isfinite(array).all():
                raise ParameterError(f"{field.name} is not finite at sample {np.argwhere(~np.isfinite(array))[0][0]}")
            object.__setattr__(self, field.name, array)
        object.__setattr__(self, "position_m", np.maximum.accumulate(self.position_m))
        if not (np.diff(self.time_s) > 0.0).all():
            raise ParameterError("time_s does not rise from sample to sample")
        farthest = float(np.diff(self.position_m).max(initial=0.0))
        if farthest > min(card.longest_step_m for card in mechanisms.ALL.values()):
            raise ParameterError(f"samples lie up to {farthest:g} m apart, too far to follow what the wheels leave on the rail")


@dataclasses.dataclass(frozen=True)
class Belief:
    """What is believed of one stop."""

    mu_cd: ArrayLike  # kinetic friction of the contaminated rail [-]; a number, (T, 1) or (T, A)
    tau: float  # recovery rate [m/J]
    mass_kg: float  # [kg]
    radius_m: ArrayLike  # of the wheels [m]; a number or (A,)
    gradient: float = 0.0  # rise over distance [-]


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
    mass_kg: float  # with the mechanisms on it
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
    own = mechanisms.make(choice)
    _, law, inertia = physics(own, vehicle)
    believed = vehicle.contact.law
    return PlantModel(constants(vehicle, Setup()), own, type(believed)(*map(float, law)), inertia, vehicle.axle_positions_m)


def along(trajectory: Trajectory, run: Belief, m: PlantModel, doings: np.ndarray | None = None) -> Prediction:
    """Evaluate the model of `model` along a trajectory (T samples, A axles).

    `doings` (fields of `Doing`, T, A), if given, is filled with what every axle is doing, as slot "before_contact" is told.

    Raises
    ------
    ParameterError
        when trajectory and vehicle have different numbers of axles, or a condition of the run cannot be

    """
    samples, axles = trajectory.wheel_speed_radps.shape
    if axles != len(m.axle_positions_m):
        raise ParameterError(f"the trajectory has {axles} axles, the vehicle {len(m.axle_positions_m)}")
    mass = mechanisms.believed_to_true("mass", m.mechanisms, run.mass_kg)
    radius = np.array(
        mechanisms.believed_to_true("radii", m.mechanisms, np.broadcast_to(run.radius_m, (axles,))), dtype=np.float64
    )
    gradient = mechanisms.believed_to_true("gradient", m.mechanisms, run.gradient)
    mu_cd = np.broadcast_to(np.asarray(run.mu_cd, dtype=np.float64), (samples, axles))
    for name, lowest in (("mu_cd", mu_cd.min()), ("mass_kg", mass), ("radius_m", radius.min())):
        if not lowest > 0.0:
            raise ParameterError(f"{name} = {lowest:g} is impossible: it must be above 0")
    tau = mechanisms.believed_to_true("tau", m.mechanisms, run.tau)
    if not 0.0 <= tau < np.inf:
        raise ParameterError(f"tau = {tau:g} m/J is impossible: it must be finite, 0 or more")
    per_axle = np.empty((7, samples, axles))
    per_vehicle = np.empty((2, samples))
    active = Active(m.mechanisms, m.constants.derived, mechanisms.remember(1, m.axle_positions_m))
    conditions = _Believed(mu_cd, float(tau), float(mass), float(gradient), radius, m.inertia_kgm2)
    doings = np.empty((len(Doing._fields), 1, axles)) if doings is None else doings
    kept = np.zeros((_KEPT, axles))
    _evaluate(_columns(trajectory), conditions, m.constants, m.law, active, per_axle, per_vehicle, kept, doings)
    adhesion, slope, load, slip, wheel, factor, true = per_axle
    speed, resisted = per_vehicle
    return Prediction(adhesion, slope, load, slip, wheel, factor, true, speed, resisted, mass, radius, m.inertia_kgm2)


class _Believed(NamedTuple):
    """The conditions of a run, as the compiled loop takes them."""

    mu_cd: np.ndarray
    tau: float
    mass: float
    gradient: float
    radius: np.ndarray
    inertia: np.ndarray


class _Columns(NamedTuple):
    """The fields of `Trajectory`, as the compiled loop takes them."""

    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    position: np.ndarray
    wheel: np.ndarray
    wheel_acceleration: np.ndarray
    torque: np.ndarray


def _columns(trajectory: Trajectory) -> _Columns:
    return _Columns(*(getattr(trajectory, field.name) for field in dataclasses.fields(trajectory)))


_SLIP = Doing._fields.index("slip")


@inlined
def _held_back(j: int, k: int, measured: _Columns, c: _Believed) -> tuple[float, float]:
    """Return T [N] and J dw/dt [N m] of a wheelset by its own balance; of a locked one its share of the vehicle's force."""
    if c.radius[k] * measured.wheel[j, k] < LOCKED_MPS:
        return -c.mass * measured.acceleration[j] / measured.wheel.shape[1], 0.0
    turning = c.inertia[k] * measured.wheel_acceleration[j, k]
    return (measured.torque[j, k] + turning) / c.radius[k], turning


# Rows of the scratch array `kept` (_KEPT, axles): at the last sample the friction power of one wheel and the braking power of
# the axle [W] and the slip speed [m/s]; so far the heat in both contacts [J] and the angle turned [rad]; the wheels' speed now
# [rad/s].
_FRICTION, _BRAKING, _SLID, _WORK, _ANGLE, _WHEEL, _KEPT = range(7)


@loop
def _evaluate(
    measured: _Columns,
    c: _Believed,
    p: PlantConstants,
    law: Any,
    active: Active,
    per_axle: np.ndarray,
    per_vehicle: np.ndarray,
    kept: np.ndarray,
    doings: np.ndarray,
) -> None:
    samples, axles = measured.wheel.shape
    full_torque = p.brake.torque_per_bar * p.brake.full_pressure
    static = c.mass * p.gravity / (2.0 * axles)
    for j in range(samples):
        before = max(j - 1, 0)
        duration = measured.time[j] - measured.time[before]
        speed = true_speed(active, measured.speed[j], measured.acceleration[j])
        mean_wheel, braking = 0.0, 0.0
        for k in range(axles):
            offset = p.axle_offset[k]
            force, turning = _held_back(j, k, measured, c)
            passage = Passage(
                measured.position[before] - offset, measured.position[j] - offset, kept[_FRICTION, k] * duration,
                kept[_BRAKING, k] * duration, duration, measured.torque[j, k], full_torque,
                kept[_SLID, k], force, turning,
            )  # fmt: skip
            after_passage(active, 0, k, passage)
            last = kept[_WHEEL, k]
            kept[_WHEEL, k] = wheel_speed(active, measured.wheel[j, k], measured.wheel_acceleration[j, k])
            kept[_WORK, k] += 2.0 * kept[_FRICTION, k] * duration
            kept[_ANGLE, k] += 0.5 * (last + kept[_WHEEL, k]) * duration
            mean_wheel += kept[_WHEEL, k] / axles
            braking += measured.torque[j, k] / (full_torque * axles)
        believed = running_resistance(speed, p.resistance) + c.mass * p.gravity * c.gradient
        now, deceleration = measured.time[j] - measured.time[0], -measured.acceleration[j]
        moment = Moment(now, measured.position[j], deceleration, braking)
        at = j if doings.shape[1] > 1 else 0
        for k in range(axles):
            rate = measured.wheel_acceleration[j, k]
            doing = Doing(
                now, duration, speed, deceleration, kept[_WHEEL, k], rate, speed - c.radius[k] * kept[_WHEEL, k],
                -deceleration - c.radius[k] * rate, measured.position[j] - p.axle_offset[k], kept[_ANGLE, k], c.radius[k],
                float(axles), mean_wheel, measured.torque[j, k], full_torque, kept[_WORK, k],
            )  # fmt: skip
            note_doing(doing, doings, at, k)
            before_contact(active, 0, k, doing)
        per_vehicle[0, j] = speed
        per_vehicle[1, j] = resistance(0, speed, believed, moment, active)
        rolled = speed * duration
        for k in range(axles):
            wheel, slip = kept[_WHEEL, k], doings[_SLIP, at, k]
            load = wheel_load(0, k, c.mass, deceleration, static, active)
            on = surface(0, k, measured.position[j] - p.axle_offset[k], rolled, c.mu_cd[j, k], 1.0, law.mu_cr, active)
            adhesion = contact(slip, speed, load, on, recovery(active, 0, k, c.tau), law, active)
            after_contact(active, 0, k, rolled, adhesion.kept)
            nominal = measured.torque[j, k]
            factor = torque_factor(active, 0, k, c.radius[k] * wheel, nominal / p.brake.torque_per_bar)
            true = torque(0, k, factor * nominal, doing_at(doings, at, k, 0.0), active)
            kept[_FRICTION, k] = adhesion.f * load * abs(slip)
            kept[_BRAKING, k] = true * wheel
            kept[_SLID, k] = slip
            per_axle[0, j, k] = adhesion.f if slip >= 0.0 else -adhesion.f
            per_axle[1, j, k] = adhesion.df_ds
            per_axle[2, j, k] = load
            per_axle[3, j, k] = slip
            per_axle[4, j, k] = wheel
            per_axle[5, j, k] = factor
            per_axle[6, j, k] = true


def true_wheel_acceleration(m: PlantModel, read_rate: np.ndarray, read_jerk: np.ndarray) -> np.ndarray:
    """Return dw/dt (T, A) [rad/s2], mechanisms on the sensors undone, from the recorded one and its rate [rad/s3].

    What a sensor does is linear and the same at all times, so the rate passes `slots.wheel_speed` as the speed does.
    """
    rate = np.empty(read_rate.shape)
    active = Active(m.mechanisms, m.constants.derived, mechanisms.remember(1, m.axle_positions_m))
    _undone(read_rate, read_jerk, active, rate)
    return rate


@loop
def _undone(read_rate: np.ndarray, read_jerk: np.ndarray, active: Active, rate: np.ndarray) -> None:
    for j in range(rate.shape[0]):
        for k in range(rate.shape[1]):
            rate[j, k] = wheel_speed(active, read_rate[j, k], read_jerk[j, k])
