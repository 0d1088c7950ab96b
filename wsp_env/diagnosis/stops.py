"""Recorded stops prepared for the balances: smoothed channels, blocks of time, and the effect of noise on them.

The wheel's channels pass a Savitzky-Golay filter. The vehicle's speed is estimated from its momentum balance: the prediction by
the wheels' forces is subtracted, the slow remainder is separated from its noise (`wsp_env.diagnosis.speed`), and the prediction
is added again. Fast changes of speed are thus preserved.
"""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from wsp_env.diagnosis.speed import SpeedEstimator, SpeedNoise, estimate, estimate_noise, nodes
from wsp_env.diagnosis.zeros import zeroed
from wsp_env.parameters.resistance import Resistance, running_resistance
from wsp_env.plant.card import LOCKED_MPS
from wsp_env.recordings import Campaign, Recording
from wsp_env.recordings.quality import describe

WHEEL_WINDOW_S = 0.09  # blocks average further; a longer window would distort the transients of a slide
LEAST_S = 1.5  # shortest usable stop; a shorter one does not determine the course of speed
BLOCK_S = 0.16  # length of the blocks of the adhesion
VEHICLE_BLOCK_S = 0.4  # length of the blocks of the vehicle balance
STEP_S = 0.01  # faster recordings are thinned to about this step after smoothing
LEAST_SPEED_MPS = 4.0  # below this speed, creepage is mostly noise
LEAST_MOMENTUM_MPS = 10.0  # lower end of the vehicle balance: near standstill, pad friction is different (assumption)
SLIP_MPS = 0.1  # smallest slip change of interest
#: Creepage [-] and slip speed [m/s] that a sliding wheel exceeds both. The contact then limits its force. An unimportant sensor
#: error does not make a rolling wheel look like this (assumption: twice the smallest slip of interest).
SLIDES, SLIDES_MPS = 0.01, 2.0 * SLIP_MPS
ROLLING_SHARE = 0.05  # share of the largest torque below which a wheel rolls freely
_GAINS = 2.0  # largest ratio of a brake's gain to the nominal one, or the reverse
PRESSED_SHARE = 0.5  # unexplained share of an axle's torque from which on its pressure does not belong to it
_ORDER = 2
#: Window [s] and order of the filters of a wheel's speed and its derivatives. The derivatives keep fourth-order courses: a
#: lower order would reduce the wheel's acceleration but not the torque, as less inertia does.
_FILTERS = {0: (WHEEL_WINDOW_S, 2), 1: (0.15, 4), 2: (0.19, 4)}


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviation of a sample's noise in each channel, and what remains of it in a block of the residual."""

    speed: SpeedNoise
    wheel: float  # [rad/s]
    torque: float  # [N m]
    step_s: float  # [s] between samples
    pressed: float = 0.0  # [N m] of the torque from the cylinder pressure, if recorded beside the torque

    def slip(self, radius: float) -> float:
        """Return the standard deviation of a block's mean slip speed by the noise of the wheel sensor [m/s]."""
        return radius * self.wheel * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)

    def moment(self, inertia: np.ndarray) -> np.ndarray:
        """Return the standard deviations (A,) of C + J dw/dt over a block [N m], for inertias (A,) [kg m2]."""
        torque = self.torque * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)
        result: np.ndarray = np.hypot(torque, inertia * self.wheel * _kept(_FILTERS[1][0], BLOCK_S, self.step_s, 1))
        return result

    @property
    def block_torque(self) -> float:
        """The standard deviation of measured torque minus torque from the cylinder pressure over a block [N m]."""
        return float(np.hypot(self.torque, self.pressed)) * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)


@dataclasses.dataclass(frozen=True)
class PreparedStop:
    """One recorded stop, prepared; T samples, A axles."""

    name: str
    group: str  # "tune" or "validate"
    step_s: float
    time: np.ndarray  # (T,) [s]
    speed: np.ndarray  # (T,) smoothed [m/s]
    acceleration: np.ndarray  # (T,) [m/s2]
    recorded_speed: np.ndarray  # (T,) as recorded, mean over each thinned sample [m/s]
    wheel: np.ndarray  # (T, A) [rad/s]
    wheel_rate: np.ndarray  # (T, A) [rad/s2]
    wheel_jerk: np.ndarray  # (T, A) [rad/s3]
    torque: np.ndarray  # (T, A) [N m]
    pressed: np.ndarray | None  # (T, A) torque from the cylinder pressure, if measured beside the torque [N m]
    place: np.ndarray  # (T,) of the leading axle [m]
    usable: np.ndarray  # (T, A) bool: turning, fast enough, not suspect
    segment: np.ndarray  # (T,) int: stretches without a locked wheel, over which the momentum is integrated; -1 outside
    mass: float  # [kg]
    gradient: float  # [-] as believed
    believed_mu_cd: float  # [-]
    noise: Noise
    uncertain: np.ndarray  # (T, m) standard deviations of the estimated speed along its principal directions [m/s]
    estimator: SpeedEstimator
    start_is_known: bool = True  # whether the start position on the track was measured
    earlier: int = 0  # number of earlier stops on the same rail (assumption: a campaign lists its runs in their order)


def least_slip(speed: np.ndarray) -> np.ndarray:
    """Slip speed [m/s] above which a wheel slides, at vehicle speeds [m/s]."""
    result: np.ndarray = np.maximum(SLIDES * speed, SLIDES_MPS)
    return result


def prepare(campaign: Campaign) -> tuple[list[PreparedStop], list[str]]:
    """Return the usable stops, and notes: the reader's warnings, assumptions, and what was left out and why."""
    stops: list[PreparedStop] = []
    campaign = zeroed(campaign)
    left_out = [sentence for run in campaign.runs.values() for sentence in run.warnings]
    left_out += _believed(campaign)
    per_bar = torque_per_bar(campaign)
    courses = {}
    for name in (*campaign.tune, *campaign.validate):
        run = campaign.runs[name]
        needed = _length(LEAST_S, _step(run)) + 2
        fast = int((run.vehicle_speed_mps > LEAST_SPEED_MPS).sum())
        if fast < needed:
            left_out.append(f"run {name}: {fast} samples above {LEAST_SPEED_MPS:g} m/s, {needed} are needed")
            continue
        if run.suspect is not None and run.suspect.all():  # nor does it contribute to the noise estimate
            left_out.append(f"run {name}: left out, no sample can be compared with the law")
            continue
        courses[name] = _predicted(campaign, run)
    if not courses:
        return stops, left_out
    speed_noise = estimate_noise([one.nodes() for one in courses.values()])
    for name, course in courses.items():
        run, group = campaign.runs[name], "tune" if name in campaign.tune else "validate"
        stop = _prepared(campaign, run, group, course, channel_noise(run, speed_noise, per_bar), per_bar)
        if not stop.usable.any():
            left_out.append(f"run {name}: left out, no sample can be compared with the law")
            continue
        if stop.pressed is not None and (strange := _strange_pressures(stop, stop.pressed)):
            axles = ", ".join(map(str, strange))
            left_out.append(f"run {name}: torque and cylinder pressure of axle {axles} do not go together; pressures left out")
            stop = dataclasses.replace(stop, pressed=None)
        earlier = list(campaign.runs).index(name)
        stops.append(dataclasses.replace(stop, start_is_known=run.start_is_known, earlier=earlier))
    return stops, left_out


def _believed(campaign: Campaign) -> list[str]:
    """Return notes on assumed data: unknown start positions, and axles without sensors."""
    notes = []
    if unknown := [name for name, run in campaign.runs.items() if not run.start_is_known]:
        notes.append(
            f"start positions of {', '.join(unknown)} are not known: these runs share no place of the track, and a change of "
            "the rail along it is seen only within a run, from axle to axle; places are counted one run after the other"
        )
    gone: dict[tuple[int, ...], list[str]] = {}
    for name, run in campaign.runs.items():
        if run.missing_axles:
            gone.setdefault(run.missing_axles, []).append(name)
    for axles, names in gone.items():
        notes.append(
            f"axle {', '.join(map(str, axles))} of run {', '.join(names)} has no usable sensors and is not compared with the "
            "law; in the vehicle's balance its force is its believed torque over the radius, with the others' mean wheel "
            "acceleration"
        )
    return notes


def _strange_pressures(stop: PreparedStop, whole: np.ndarray) -> list[int]:
    """Return the axles, from 1, whose torque is not even roughly proportional to the pressure, as with a dead channel."""
    found = []
    for k in range(stop.torque.shape[1]):
        torque, pressed = stop.torque[stop.usable[:, k], k], whole[stop.usable[:, k], k]
        scale = np.clip(float(torque @ pressed) / max(float(pressed @ pressed), 1e-9), 1.0 / _GAINS, _GAINS)
        if np.linalg.norm(torque - scale * pressed) > PRESSED_SHARE * np.linalg.norm(torque):
            found.append(k + 1)
    return found


def torque_per_bar(campaign: Campaign) -> float:
    """Return the nominal torque of a wheelset per bar of cylinder pressure [N m/bar]; 0 if unknown.

    It is the campaign's value, or the common least-squares value of all runs and axles if both were measured and the campaign
    has no value, or an impossible one (`gain_is_stated`).
    """
    stated = campaign.vehicle.torque_per_bar_nm
    return stated if not campaign.vehicle.torque_is_measured or gain_is_stated(campaign) else _measured_per_bar(campaign)


def gain_is_stated(campaign: Campaign) -> bool:
    """Whether a campaign states the brakes' nominal torque per bar, not unlike what was measured if both were."""
    stated, measured = campaign.vehicle.torque_per_bar_nm, _measured_per_bar(campaign)
    return stated > 0.0 and 1.0 / _GAINS < measured / stated < _GAINS


def _measured_per_bar(campaign: Campaign) -> float:
    """Return the torque per bar [N m/bar] of all runs and axles by least squares; without pressures, what is stated."""
    vehicle = campaign.vehicle
    both = square = 0.0
    for run in campaign.runs.values():
        if run.cylinder_pressure_bar is not None:
            turning = vehicle.wheel_radius_m * run.wheel_speed_radps > LOCKED_MPS
            both += float((run.brake_torque_nm * run.cylinder_pressure_bar)[turning].sum())
            square += float((run.cylinder_pressure_bar**2)[turning].sum())
    return max(both / square, 0.0) if square > 0.0 else vehicle.torque_per_bar_nm


def channel_noise(run: Recording, speed: SpeedNoise, per_bar: float = 0.0) -> Noise:
    """Estimate the noise of one run's wheel and brake channels by third differences; the median over the axles.

    Parameters
    ----------
    speed : noise of the vehicle's recorded speed
    per_bar : torque of a wheelset per bar of cylinder pressure [N m/bar]

    """
    wheel = float(np.median([describe(column).noise for column in run.wheel_speed_radps.T]))
    torque = float(np.median([describe(column).noise for column in run.brake_torque_nm.T]))
    pressure = 0.0
    if run.cylinder_pressure_bar is not None:
        pressure = float(np.median([describe(column).noise for column in run.cylinder_pressure_bar.T]))
    # A noiseless (simulated) recording still has errors of rounding and smoothing.
    return Noise(speed, max(wheel, 1e-3), max(torque, 1.0), _step(run), per_bar * pressure)


@dataclasses.dataclass(frozen=True)
class _Course:
    """The smoothed channels of a run, and the part of its speed that the wheels' balances do not predict."""

    step: float  # [s]
    wheels: tuple[np.ndarray, ...]  # wheel speed, its first and second rate, torque (T, A)
    predicted_rate: np.ndarray  # (T,) [m/s2]
    predicted: np.ndarray  # (T,) [m/s]
    rest: np.ndarray  # (T,) recorded minus predicted speed [m/s]
    fast: slice  # from the first to the last sample above `LEAST_SPEED_MPS`

    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] since the start and means [m/s] of the rest's nodes (n,).

        Samples near standstill are left out. A vehicle that stands is held by forces that no balance predicts, and sensors
        that count pulses are late before it stands. Both would count as accelerations of the whole stop.
        """
        time, mean = nodes(self.rest[self.fast], self.step)
        return time + self.fast.start * self.step, mean


def _predicted(campaign: Campaign, run: Recording) -> _Course:
    vehicle, step = campaign.vehicle, _step(run)
    wheel, rate, jerk, torque = smooth_wheels(run.wheel_speed_radps, run.brake_torque_nm, step)
    turning = vehicle.wheel_radius_m * wheel > LOCKED_MPS
    if run.suspect is not None and run.suspect.any():  # a jump of a channel is no acceleration
        rate = np.where(maximum_filter1d(run.suspect, 2 * _length(WHEEL_WINDOW_S, step) + 1, axis=0), 0.0, rate)
    moment = np.where(turning, torque + vehicle.wheelset_inertia_kgm2 * rate, 0.0)
    resistance = running_resistance(run.vehicle_speed_mps, Resistance(*vehicle.resistance_n))
    predicted_rate = -(moment.sum(axis=-1) / vehicle.wheel_radius_m + resistance) / run.mass_kg
    predicted = (np.cumsum(predicted_rate) - 0.5 * predicted_rate) * step  # the trapezoidal sum
    fast = np.flatnonzero(run.vehicle_speed_mps > LEAST_SPEED_MPS)
    return _Course(
        step, (wheel, rate, jerk, torque), predicted_rate, predicted, run.vehicle_speed_mps - predicted,
        slice(int(fast[0]), int(fast[-1]) + 1),
    )  # fmt: skip


def _estimated(course: _Course, noise: SpeedNoise) -> tuple[np.ndarray, np.ndarray, np.ndarray, SpeedEstimator]:
    """Return the vehicle's speed (T,), its rate (T,), its principal uncertainties (T, m) and its estimator."""
    time, mean = course.nodes()
    found = estimate(noise, time, mean)
    spline = CubicSpline(time, np.column_stack([found.course, found.modes]))
    every = np.arange(len(course.rest)) * course.step
    held = np.clip(every, time[0], time[-1])  # extrapolate linearly beyond the outer nodes
    values, rates = spline(held), spline(held, 1)
    values += rates * (every - held)[:, None]
    estimator = SpeedEstimator(time, found.gain)
    return course.predicted + values[:, 0], course.predicted_rate + rates[:, 0], values[:, 1:], estimator


def _prepared(campaign: Campaign, run: Recording, group: str, course: _Course, noise: Noise, per_bar: float) -> PreparedStop:
    vehicle, step = campaign.vehicle, course.step
    wheel, rate, jerk, torque = course.wheels
    pressed: np.ndarray | None = None
    if per_bar > 0.0 and vehicle.torque_is_measured and run.cylinder_pressure_bar is not None:
        pressed = smooth_torque(per_bar * run.cylinder_pressure_bar, step)
    speed, acceleration, uncertain, estimator = _estimated(course, noise.speed)
    stride = max(round(STEP_S / step), 1)
    usable = (speed > LEAST_SPEED_MPS)[:, None] & (vehicle.wheel_radius_m * wheel > LOCKED_MPS)
    turning = (vehicle.wheel_radius_m * wheel > LOCKED_MPS).all(axis=1) & (speed > LEAST_MOMENTUM_MPS)
    end = _length(WHEEL_WINDOW_S, step)
    if run.suspect is not None and run.suspect.any():
        near = maximum_filter1d(run.suspect, 2 * end + 1, axis=0)
        usable &= ~near
        there = ~np.isin(np.arange(vehicle.axles) + 1, run.missing_axles)  # for missing axles, the substitute values are used
        turning &= ~near[:, there].any(axis=1)
    usable[:end] = usable[len(usable) - end :] = False
    turning[:end] = turning[len(turning) - end :] = False
    behind = np.cumsum(speed) * step
    begins = np.diff(np.concatenate([[0], turning.astype(int)])) == 1
    segment = np.where(turning, np.cumsum(begins) - 1, -1)
    thin = slice(stride // 2, None, stride)
    raw = run.vehicle_speed_mps[: len(speed) // stride * stride].reshape(-1, stride).mean(axis=1)
    kept = len(raw)
    pressed = None if pressed is None else pressed[thin][:kept]
    return PreparedStop(
        run.name, group, step * stride, run.time_s[thin][:kept], speed[thin][:kept], acceleration[thin][:kept], raw,
        wheel[thin][:kept], rate[thin][:kept], jerk[thin][:kept], torque[thin][:kept], pressed,
        (run.start_position_m + behind)[thin][:kept], usable[thin][:kept], segment[thin][:kept],
        run.mass_kg, run.gradient, run.kinetic_friction_d, noise, uncertain[thin][:kept],
        dataclasses.replace(estimator, time=estimator.time + run.time_s[0]),
    )  # fmt: skip


def smooth_wheels(wheel: np.ndarray, torque: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """Return smoothed wheel speed, its first and second derivative, and smoothed torque; arrays (..., T, A)."""

    def smoothed(values: np.ndarray, derivative: int) -> np.ndarray:
        window, order = _FILTERS[derivative]
        length = max(_length(window, step), order + 1 + order % 2)
        result: np.ndarray = savgol_filter(values, length, order, deriv=derivative, delta=step, axis=-2)
        return result

    return smoothed(wheel, 0), smoothed(wheel, 1), smoothed(wheel, 2), smooth_torque(torque, step)


def wheel_filter(step: float) -> np.ndarray:
    """Return the weights (w,) of the filter of a wheel's speed."""
    result: np.ndarray = savgol_coeffs(_length(WHEEL_WINDOW_S, step), _ORDER)
    return result


def smooth_torque(torque: np.ndarray, step: float) -> np.ndarray:
    """Return a torque (..., T, A) smoothed like the wheel speeds."""
    result: np.ndarray = savgol_filter(torque, _length(WHEEL_WINDOW_S, step), _ORDER, axis=-2)
    return result


def _step(run: Recording) -> float:
    return float(np.median(np.diff(run.time_s[:10_000])))


def _length(window_s: float, step_s: float) -> int:
    return int(max(2 * round(window_s / (2 * step_s)) + 1, _ORDER + 1))


def _kept(window_s: float, block_s: float, step_s: float, derivative: int) -> float:
    """Return the standard deviation of a block mean of the filtered channel, for white noise of deviation 1."""
    order = _ORDER if derivative == 0 else _FILTERS[derivative][1]
    length = max(_length(window_s, step_s), order + 1 + order % 2)
    weights = savgol_coeffs(length, order, deriv=derivative, delta=step_s)
    box = np.full(max(round(block_s / step_s), 1), 1.0)
    return float(np.linalg.norm(np.convolve(weights, box / box.sum())))
