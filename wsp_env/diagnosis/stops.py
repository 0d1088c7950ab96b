"""Recorded stops prepared for the balances: smoothed channels, blocks of time, and what noise does to them.

The wheel's channels pass a Savitzky-Golay filter. The vehicle's speed is smoothed about its own momentum balance: what the
wheels' forces predict is taken away, the rest, which changes slowly, passes a long window, and the prediction is put back. That
keeps what is fast and leaves less than half of the noise that a filter of the speed alone leaves.
"""

import dataclasses

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from wsp_env.recordings import Campaign, Recording
from wsp_env.recordings.quality import describe

WHEEL_WINDOW_S = 0.09  # blocks average the rest; a longer window shifts what happens in a slide's transients
VEHICLE_WINDOW_S = 1.5  # of what the wheels' forces do not predict: normal variation of the brakes, slow in a stop
BLOCK_S = 0.16  # residuals are averaged over blocks: of the adhesion
VEHICLE_BLOCK_S = 0.4  # of the vehicle
STEP_S = 0.01  # faster recordings are thinned to about this after smoothing
EVALUATED_S = 0.02  # models are evaluated at about this
LEAST_SPEED_MPS = 4.0  # creepage is mostly noise below
LEAST_MOMENTUM_MPS = 10.0  # the vehicle's balance ends here: towards standstill the friction of pads is its own: assumption
LOCKED_MPS = 0.5  # circumferential speed below which a wheel counts as locked: its torque is a reaction
ROLLING_SHARE = 0.05  # of the largest torque, below which a wheel rolls freely
PRESSED_SHARE = (
    0.5  # of an axle's torque that its own pressure leaves unexplained, from which on the two do not belong together
)
_ORDER = 2


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviation of one sample of each channel, and what one block of its smoothed residual keeps of it."""

    speed: float  # [m/s]
    wheel: float  # [rad/s]
    torque: float  # [N m]
    step_s: float  # [s] between samples
    pressed: float = 0.0  # [N m] of the torque by the cylinder pressure, where that is recorded beside the torque

    def slip(self, radius: float) -> float:
        """Deviation of the slip speed's mean over a block [m/s]."""
        vehicle = self.speed * _kept(VEHICLE_WINDOW_S, BLOCK_S, self.step_s, 0)
        return float(np.hypot(vehicle, radius * self.wheel * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)))

    def moment(self, inertia: float) -> float:
        """Deviation of C + J dw/dt over a block [N m]."""
        torque = self.torque * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)
        return float(np.hypot(torque, inertia * self.wheel * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 1)))

    @property
    def block_torque(self) -> float:
        """Deviation of the measured torque less that by the cylinder pressure over a block [N m]."""
        return float(np.hypot(self.torque, self.pressed)) * _kept(WHEEL_WINDOW_S, BLOCK_S, self.step_s, 0)

    @property
    def block_speed(self) -> float:
        """Deviation of the raw vehicle speed's mean over a block [m/s]."""
        return self.speed / np.sqrt(max(VEHICLE_BLOCK_S / self.step_s, 1.0))


@dataclasses.dataclass(frozen=True)
class PreparedStop:
    """One recorded stop; T samples, A axles."""

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
    pressed: np.ndarray | None  # (T, A) by the recorded cylinder pressure, where the torque is measured beside it [N m]
    place: np.ndarray  # (T,) of the leading axle [m]
    usable: np.ndarray  # (T, A) bool: turning, fast enough, as recorded
    segment: np.ndarray  # (T,) int: stretches without a locked wheel, over which momentum is summed; -1 outside
    mass: float  # [kg]
    gradient: float  # [-] as believed
    believed_mu_cd: float  # [-]
    noise: Noise
    earlier: int = 0  # stops before it on the same rail (assumption: a campaign lists its runs in the order they were made)


def prepare(campaign: Campaign) -> tuple[list[PreparedStop], list[str]]:
    """Return the stops that can be used, and what was left out and why, with what the reader said of the runs."""
    stops, left_out = [], [sentence for run in campaign.runs.values() for sentence in run.warnings]
    left_out += _believed(campaign)
    per_bar = torque_per_bar(campaign)
    for name in (*campaign.tune, *campaign.validate):
        run = campaign.runs[name]
        group = "tune" if name in campaign.tune else "validate"
        needed = _length(VEHICLE_WINDOW_S, _step(run)) + 2
        fast = int((run.vehicle_speed_mps > LEAST_SPEED_MPS).sum())
        if fast < needed:
            left_out.append(f"run {name}: {fast} samples above {LEAST_SPEED_MPS:g} m/s, {needed} are needed")
            continue
        stop = _prepared(campaign, run, group, channel_noise(run, per_bar), per_bar)
        if not stop.usable.any():
            left_out.append(f"run {name}: left out, no sample can be compared with the law")
            continue
        if stop.pressed is not None and (strange := _strange_pressures(stop, stop.pressed)):
            axles = ", ".join(map(str, strange))
            left_out.append(f"run {name}: torque and cylinder pressure of axle {axles} do not go together; pressures left out")
            stop = dataclasses.replace(stop, pressed=None)
        stops.append(dataclasses.replace(stop, earlier=list(campaign.runs).index(name)))
    return stops, left_out


def _believed(campaign: Campaign) -> list[str]:
    """Say what nobody knows and is taken for granted: where runs began, what axles without sensors did."""
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
    """Return the axles, from 1, whose torque is not even roughly in proportion to their pressure: a dead channel, say."""
    found = []
    for k in range(stop.torque.shape[1]):
        torque, pressed = stop.torque[stop.usable[:, k], k], whole[stop.usable[:, k], k]
        scale = float(torque @ pressed) / max(float(pressed @ pressed), 1e-9)
        if np.linalg.norm(torque - scale * pressed) > PRESSED_SHARE * np.linalg.norm(torque):
            found.append(k + 1)
    return found


def thinned(stop: PreparedStop) -> PreparedStop:
    """Return the stop with neighbouring samples averaged until they are about `EVALUATED_S` apart."""
    stride = max(round(EVALUATED_S / stop.step_s), 1)
    if stride == 1:
        return stop
    kept = len(stop.time) // stride

    def cut(values: np.ndarray) -> np.ndarray:
        return values[: kept * stride].reshape(kept, stride, *values.shape[1:])

    mean = {
        field.name: cut(getattr(stop, field.name)).mean(axis=1)
        for field in dataclasses.fields(PreparedStop)
        if isinstance(getattr(stop, field.name), np.ndarray) and field.name not in ("usable", "segment")
    }
    segment = cut(stop.segment)
    usable: np.ndarray = np.all(cut(stop.usable), axis=1)
    whole = (segment == segment[:, :1]).all(axis=1)
    return dataclasses.replace(
        stop,
        step_s=stop.step_s * stride,
        usable=usable,
        segment=np.where(whole, segment[:, 0], -1),
        **mean,
    )


def torque_per_bar(campaign: Campaign) -> float:
    """Return the nominal torque of a wheelset for one bar in its brake cylinders [N m/bar]; 0: nothing says it.

    The campaign's; where torques and pressures were both measured, the best common one of all runs and axles.
    """
    vehicle = campaign.vehicle
    if not vehicle.torque_is_measured:
        return vehicle.torque_per_bar_nm
    both = square = 0.0
    for run in campaign.runs.values():
        if run.cylinder_pressure_bar is not None:
            turning = vehicle.wheel_radius_m * run.wheel_speed_radps > LOCKED_MPS
            both += float((run.brake_torque_nm * run.cylinder_pressure_bar)[turning].sum())
            square += float((run.cylinder_pressure_bar**2)[turning].sum())
    return max(both / square, 0.0) if square > 0.0 else 0.0


def channel_noise(run: Recording, per_bar: float = 0.0) -> Noise:
    """Estimate the noise of one run's channels by third differences; the median over the axles.

    Parameters
    ----------
    per_bar : torque of a wheelset for one bar in its cylinders [N m/bar]

    """
    wheel = float(np.median([describe(column).noise for column in run.wheel_speed_radps.T]))
    torque = float(np.median([describe(column).noise for column in run.brake_torque_nm.T]))
    speed, pressure = describe(run.vehicle_speed_mps).noise, 0.0
    if run.cylinder_pressure_bar is not None:
        pressure = float(np.median([describe(column).noise for column in run.cylinder_pressure_bar.T]))
    # A noiseless recording (a simulation) still has rounding and the smoothing's own error.
    return Noise(max(speed, 1e-3), max(wheel, 1e-3), max(torque, 1.0), _step(run), per_bar * pressure)


def _prepared(campaign: Campaign, run: Recording, group: str, noise: Noise, per_bar: float) -> PreparedStop:
    vehicle, step = campaign.vehicle, _step(run)
    wheel, rate, jerk, torque = smooth_wheels(run.wheel_speed_radps, run.brake_torque_nm, step)
    pressed: np.ndarray | None = None
    if per_bar > 0.0 and vehicle.torque_is_measured and run.cylinder_pressure_bar is not None:
        pressed = smooth_torque(per_bar * run.cylinder_pressure_bar, step)
    speed, acceleration = smooth_speed(run.vehicle_speed_mps, wheel, rate, torque, campaign, run.mass_kg, step)
    stride = max(round(STEP_S / step), 1)
    usable = (speed > LEAST_SPEED_MPS)[:, None] & (vehicle.wheel_radius_m * wheel > LOCKED_MPS)
    turning = (vehicle.wheel_radius_m * wheel > LOCKED_MPS).all(axis=1) & (speed > LEAST_MOMENTUM_MPS)
    end = _length(WHEEL_WINDOW_S, step)
    if run.suspect is not None and run.suspect.any():
        near = maximum_filter1d(run.suspect, 2 * end + 1, axis=0)
        usable &= ~near
        there = ~np.isin(np.arange(vehicle.axles) + 1, run.missing_axles)  # what stands in for the others is believed there
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
        run.mass_kg, run.gradient, run.kinetic_friction_d, noise,
    )  # fmt: skip


def smooth_wheels(wheel: np.ndarray, torque: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """Return wheel speed, its first and second rate, and torque, smoothed; arrays (..., T, A)."""
    length = _length(WHEEL_WINDOW_S, step)

    def smoothed(values: np.ndarray, derivative: int) -> np.ndarray:
        result: np.ndarray = savgol_filter(values, length, _ORDER, deriv=derivative, delta=step, axis=-2)
        return result

    return smoothed(wheel, 0), smoothed(wheel, 1), smoothed(wheel, 2), smooth_torque(torque, step)


def smooth_torque(torque: np.ndarray, step: float) -> np.ndarray:
    """Return a torque (..., T, A) smoothed as the wheels' speeds are."""
    result: np.ndarray = savgol_filter(torque, _length(WHEEL_WINDOW_S, step), _ORDER, axis=-2)
    return result


def smooth_speed(
    recorded: np.ndarray, wheel: np.ndarray, rate: np.ndarray, torque: np.ndarray, campaign: Campaign, mass: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the vehicle's speed (..., T) smoothed about its momentum balance, and its rate [m/s2]."""
    vehicle = campaign.vehicle
    turning = vehicle.wheel_radius_m * wheel > LOCKED_MPS
    moment = np.where(turning, torque + vehicle.wheelset_inertia_kgm2 * rate, 0.0)
    predicted_rate = -moment.sum(axis=-1) / (vehicle.wheel_radius_m * mass)
    predicted = (np.cumsum(predicted_rate, axis=-1) - 0.5 * predicted_rate) * step  # the trapezoidal sum
    length = _length(VEHICLE_WINDOW_S, step)
    rest = recorded - predicted
    return (
        predicted + savgol_filter(rest, length, _ORDER, axis=-1),
        predicted_rate + savgol_filter(rest, length, _ORDER, deriv=1, delta=step, axis=-1),
    )


def _step(run: Recording) -> float:
    return float(np.median(np.diff(run.time_s[:10_000])))


def _length(window_s: float, step_s: float) -> int:
    return int(max(2 * round(window_s / (2 * step_s)) + 1, _ORDER + 1))


def _kept(window_s: float, block_s: float, step_s: float, derivative: int) -> float:
    """Deviation that a block mean of the filtered channel keeps of white noise of deviation 1."""
    weights = savgol_coeffs(_length(window_s, step_s), _ORDER, deriv=derivative, delta=step_s)
    box = np.full(max(round(block_s / step_s), 1), 1.0)
    return float(np.linalg.norm(np.convolve(weights, box / box.sum())))
