"""The plant's physics along a measured trajectory: what contact, brake and resistances would have done there.

The same slots as in the plant's step (`wsp_env.plant.slots`) are evaluated at the measured speeds instead of integrating them.
Evaluation is causal: a sample depends on itself and earlier ones, through the slow states (film memory, discs' temperature,
energy on the rail), which run through the whole recording on the model's own adhesion at the measured slip.

With a prediction a caller forms the four balances, w and v being the prediction's wheel and vehicle speed, r its radii and
T = (torque_factor C + J dw/dt) / r the force of a wheelset from its own balance (C the believed or measured torque):

    vehicle     mass dv/dt + sum T + resistance
    adhesion    T / (2 wheel_load) - adhesion
    kinematics  v - r w while rolling freely
    actuator    measured torque - torque_factor (nominal gain x pressure)
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import loop
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.mechanisms import (
    clock_offset,
    leading_axle_cleaning,
    non_adhesive_brake,
    pad_friction,
    track_gradient,
    vehicle_mass,
    wheel_radius,
    wheel_speed_lag,
)
from wsp_env.plant.slots import contact, rail, resistance, torque_factor, wheel_load
from wsp_env.plant.state import Constants, constants


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """A measured stop, T samples of A axles; smoothed, without gaps.

    Anything array-like is accepted and kept as float64. `ParameterError` for shapes that do not fit together, for numbers that
    are not finite, a time that does not rise or samples more than `leading_axle_cleaning.SPARE_CELLS` metres apart.
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
        if farthest > leading_axle_cleaning.SPARE_CELLS * leading_axle_cleaning.CELL_M:
            raise ParameterError(f"samples lie up to {farthest:g} m apart, too far to follow what the wheels leave on the rail")


@dataclasses.dataclass(frozen=True)
class Run:
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
    speed_mps: np.ndarray  # (T,) with the mechanisms on the sensors undone [m/s]
    resistance_n: np.ndarray  # (T,) against the motion, beside the wheels: resistances, gradient, track brake [N]
    mass_kg: float  # with `vehicle_mass`
    radius_m: np.ndarray  # (A,) with `wheel_radius` [m]


def model(vehicle: Vehicle, choice: Mapping[str, Mapping[str, float]] | None = None) -> Constants:
    """Return a vehicle with the mechanisms of `choice` on (see `mechanisms.make`) as `along` takes it."""
    return constants(vehicle, 0.01, 1, mechanisms.make(choice), False, 1.0)  # what concerns the step's clock is not used


def along(trajectory: Trajectory, run: Run, p: Constants) -> Prediction:
    """Evaluate the model of `model` along a trajectory (T samples, A axles).

    Raises
    ------
    ParameterError
        when trajectory and vehicle have different numbers of axles, or a condition of the run cannot be

    """
    samples, axles = trajectory.wheel_speed_radps.shape
    if axles != len(p.axle_offset):
        raise ParameterError(f"the trajectory has {axles} axles, the vehicle {len(p.axle_offset)}")
    m = p.mechanisms
    mass = vehicle_mass.mass(m.vehicle_mass, run.mass_kg)
    radius = wheel_radius.radii(m.wheel_radius, np.broadcast_to(run.radius_m, (axles,)))
    mu_cd = np.broadcast_to(np.asarray(run.mu_cd, dtype=np.float64), (samples, axles))
    for name, lowest in (("mu_cd", mu_cd.min()), ("mass_kg", mass), ("radius_m", radius.min())):
        if not lowest > 0.0:
            raise ParameterError(f"{name} = {lowest:g} is impossible: it must be above 0")
    if not 0.0 <= run.tau < np.inf:
        raise ParameterError(f"tau = {run.tau:g} m/J is impossible: it must be finite, 0 or more")
    per_axle = np.empty((6, samples, axles))
    per_vehicle = np.empty((2, samples))
    cells = leading_axle_cleaning.cells(float(p.axle_offset[-1]))
    gradient = track_gradient.gradient(m.track_gradient, run.gradient)
    conditions = (mu_cd, float(run.tau), float(mass), float(gradient), radius)
    _evaluate(_columns(trajectory), conditions, p, per_axle, per_vehicle, np.zeros((_STATES, axles)), np.zeros((1, cells)))
    adhesion, slope, load, slip, wheel, factor = per_axle
    return Prediction(adhesion, slope, load, slip, wheel, factor, per_vehicle[0], per_vehicle[1], mass, radius)


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


# Rows of the scratch array `state` (_STATES, A): the film's recovery [-], rise of the discs' temperature [K], energy of one
# wheel in the present cell of rail [J], friction power of one wheel [W] and braking power of the axle [W] at the last sample.
_RECOVERY, _DISCS, _PENDING, _FRICTION, _BRAKING, _STATES = range(6)


@loop
def _evaluate(
    measured: _Columns,
    conditions: tuple[np.ndarray, float, float, float, np.ndarray],
    p: Constants,
    per_axle: np.ndarray,
    per_vehicle: np.ndarray,
    state: np.ndarray,
    ring: np.ndarray,
) -> None:
    mu_cd, tau, mass, gradient, radius = conditions
    samples, axles = measured.wheel.shape
    m = p.mechanisms
    applied = 0.0
    full_torque = p.torque_per_bar * p.full_pressure
    for j in range(samples):
        before = max(j - 1, 0)
        duration = measured.time[j] - measured.time[before]
        speed = clock_offset.speed(m.clock_offset, measured.speed[j], measured.acceleration[j])
        for k in range(axles):
            applied = non_adhesive_brake.applied(m.non_adhesive_brake, applied, measured.torque[j, k], full_torque)
        per_vehicle[0, j] = speed
        per_vehicle[1, j] = resistance(speed, mass, gradient, applied, p)
        for k in range(axles):
            place = measured.position[j] - p.axle_offset[k]
            leading_axle_cleaning.remember(
                m.leading_axle_cleaning, k, measured.position[before] - p.axle_offset[k], place,
                state[_FRICTION, k] * duration, 0, ring, state[_PENDING : _PENDING + 1],
            )  # fmt: skip
            warmer = pad_friction.warmer(m.pad_friction, state[_DISCS, k], state[_BRAKING, k] * duration, duration)
            wheel = wheel_speed_lag.wheel_speed(m.wheel_speed_lag, measured.wheel[j, k], measured.wheel_acceleration[j, k])
            slip = speed - radius[k] * wheel
            load = wheel_load(k, mass, -measured.acceleration[j], p)
            film = leading_axle_cleaning.film_left(m.leading_axle_cleaning, 0, place, ring)
            on, past = rail(place, mu_cd[j, k], film, state[_RECOVERY, k], speed * duration, p)
            law = contact(slip, speed, load, on, tau, p)
            torque = measured.torque[j, k]
            factor = torque_factor(k, radius[k] * wheel, torque / p.torque_per_bar, warmer, p)
            state[_RECOVERY, k] = past * state[_RECOVERY, k] + (1.0 - past) * (1.0 - law.kept)
            state[_DISCS, k] = warmer
            state[_FRICTION, k] = law.f * load * abs(slip)
            state[_BRAKING, k] = factor * torque * wheel
            per_axle[0, j, k] = law.f if slip >= 0.0 else -law.f
            per_axle[1, j, k] = law.df_ds
            per_axle[2, j, k] = load
            per_axle[3, j, k] = slip
            per_axle[4, j, k] = wheel
            per_axle[5, j, k] = factor
