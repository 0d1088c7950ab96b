"""The running speed as a wheel slide protection knows it: from its wheel-speed sensors alone.

While no axle slides, the fastest wheel is the vehicle, but cannot decelerate faster than a bound. Once the protection has
acted, all axles may slide together and slowly; then only an axle that has been vented long enough to roll is believed. In
between, the reference runs on with the deceleration between the last two such moments, and a faster wheel raises it.
"""

import dataclasses

import numpy as np

from wsp_env.parameters.quantity import Checked, quantity
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

_TUNED = "assumption: chosen on the test programme (wsp evaluate)"


@dataclasses.dataclass(frozen=True)
class ReferenceParameters(Checked):
    """Times and bounds of the reference speed and of the sensors' monitoring."""

    filter_s: float = quantity(0.06, "s", _TUNED + "; low-pass of the wheel acceleration", 0.0, 1.0, open_low=True)
    reference_bound_mps2: float = quantity(1.4, "m/s2", "assumption: above the full brake's 1.2 m/s2", 0.1, 20.0)
    trend_filter_s: float = quantity(0.5, "s", _TUNED + "; low-pass of the reference's deceleration", 0.0, 10.0, open_low=True)
    resynchronise_s: float = quantity(4.0, "s", _TUNED + "; without a rolling axle: one is released", 0.1, 60.0)
    roll_s: float = quantity(0.5, "s", _TUNED + "; vented so long, a cylinder is empty", 0.0, 10.0)
    settled_mps2: float = quantity(0.4, "m/s2", _TUNED + "; a vented wheel accelerating less rolls", 0.0, 10.0)
    learning_s: float = quantity(0.5, "s", "assumption: cylinders fill, the wheels still roll freely", 0.0, 60.0)
    diameter_tolerance: float = quantity(0.06, "-", "assumption: UIC 541-05, wheels of 1000 to 920 mm alike", 0.0, 0.2)
    rotation_monitor_s: float = quantity(1.0, "s", _TUNED + "; a wheel standing for so long is reported", 0.0, 60.0)
    standing_mps: float = quantity(0.3, "m/s", "assumption: below, a wheel stands", 0.0, 5.0)
    running_mps: float = quantity(2.8, "m/s", "assumption: 10 km/h, above it a standing wheel is a fault", 0.0, 20.0)
    absent_share: float = quantity(0.5, "-", "assumption: a slower wheel before braking has no sensor", 0.0, 1.0)
    sensor_jump_mps2: float = quantity(100.0, "m/s2", "assumption: no wheel can decelerate so", 10.0, 1e4)


class ReferenceSpeed:
    """Reference speed, wheel accelerations, learnt diameters and faults of N vehicles with A axles.

    Attributes, all arrays: `reference` (N,) [m/s], `speed` (N, A) circumferential [m/s], `acceleration` (N, A) filtered [m/s2],
    `failed` and `standing` (N, A) bool: sensors without a believable signal, wheels that stand while the vehicle runs;
    `released` (N, A) bool: axles to vent until they roll.
    """

    def __init__(self, parameters: ReferenceParameters, n: int, vehicle: Vehicle) -> None:
        self.parameters = parameters
        shape = (n, vehicle.axles)
        self._nominal = vehicle.wheel_radius_m
        self._radius = np.full(shape, vehicle.wheel_radius_m)
        self._begun = False
        self._time = np.zeros(n)
        self._trend = np.zeros(n)  # deceleration of the vehicle [m/s2]
        self._known = np.zeros(n)  # speed when an axle last rolled for certain [m/s]
        self._age = np.zeros(n)  # time since then [s]
        self._vented = np.zeros(shape)  # for how long without a break [s]
        self._standing_for = np.zeros(shape)  # [s]
        self._wheel = np.zeros(shape)  # as last measured [rad/s]
        self._start = np.zeros(n)  # time of the first measurement [s]
        self._learnt = 0  # readings of the diameters so far
        self.reference = np.zeros(n)
        self.speed = np.zeros(shape)
        self.acceleration = np.zeros(shape)
        self.failed = np.zeros(shape, dtype=bool)
        self.standing = np.zeros(shape, dtype=bool)
        self.released = np.zeros(shape, dtype=bool)

    def update(self, measurement: Measurement, command: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Take a measurement, the commands (N, A) given before it and which vehicles (N,) are under the protection.

        Returns the time since the last measurement (N,) [s].
        """
        p = self.parameters
        step = np.maximum(measurement.time - self._time, 1e-6)
        self._time = measurement.time.copy()
        wheel = np.nan_to_num(measurement.wheel_speed, nan=0.0)
        self.failed |= ~np.isfinite(measurement.wheel_speed)
        if not self._begun:
            self._begun = True
            self._wheel = wheel
            self._start = measurement.time.copy()
            self.speed = self._radius * wheel
            self.reference = self.speed.max(axis=1)
            self.failed |= self.speed < self.parameters.absent_share * self.reference[:, None]  # nothing has braked it yet
            self._known = self.reference.copy()
            return step
        rolling = self._learn_diameters(wheel)
        speed = self._radius * wheel
        rate = self._radius * (wheel - self._wheel) / step[:, None]
        self._wheel = wheel
        self.failed |= rate < -p.sensor_jump_mps2
        self.speed = speed
        self.acceleration += (1.0 - np.exp(-step[:, None] / p.filter_s)) * (rate - self.acceleration)
        self._vented = np.where(command < -0.5, self._vented + step[:, None], 0.0)
        self.reference = np.where(rolling, speed.max(axis=1), self.reference)  # as the diameters now say
        self._known = np.where(rolling, self.reference, self._known)
        self._follow(step, active)
        stands = (speed < p.standing_mps) & (self.reference[:, None] > p.running_mps)
        self._standing_for = np.where(stands, self._standing_for + step[:, None], 0.0)
        self.standing = self._standing_for > p.rotation_monitor_s
        return step

    def _learn_diameters(self, wheel: np.ndarray) -> np.ndarray:
        """While all axles roll freely their circumferential speeds are equal: the diameters differ; return where (N,)."""
        p = self.parameters
        turning = self._nominal * wheel.min(axis=1) > p.standing_mps
        rolling: np.ndarray = (self._time - self._start <= p.learning_s) & ~self.failed.any(axis=1) & turning
        if rolling.any():
            ratio = wheel.mean(axis=1, keepdims=True) / np.maximum(wheel, 1e-6)
            ratio = np.clip(ratio, 1.0 - p.diameter_tolerance, 1.0 + p.diameter_tolerance)
            self._learnt += 1
            learnt = self._radius + (self._nominal * ratio - self._radius) / self._learnt  # the mean of all readings
            self._radius = np.where(rolling[:, None], learnt, self._radius)
        return rolling

    def _follow(self, step: np.ndarray, active: np.ndarray) -> None:
        p = self.parameters
        sound = np.where(self.failed, -np.inf, self.speed)
        fastest = sound.max(axis=1)
        fastest = np.where(np.isfinite(fastest), fastest, self.reference)
        self._age += step
        slowest = self._known - p.reference_bound_mps2 * self._age - p.standing_mps
        rolls = (self._vented >= p.roll_s) & (np.abs(self.acceleration) < p.settled_mps2) & (sound >= slowest[:, None])
        certain = active & rolls.any(axis=1)
        rolling = np.where(rolls, sound, -np.inf).max(axis=1)
        bounded = np.maximum(fastest, self.reference - p.reference_bound_mps2 * step)
        coasted = np.maximum(fastest, self.reference - self._trend * step)
        reference = np.where(certain, np.maximum(rolling, fastest), np.where(active, coasted, bounded))
        slope = np.clip((self.reference - reference) / step, 0.0, p.reference_bound_mps2)
        passive_gain = 1.0 - np.exp(-step / p.trend_filter_s)
        between = np.clip((self._known - reference) / np.maximum(self._age, 1e-6), 0.0, p.reference_bound_mps2)
        certain_gain = self._age / (self._age + 1.0)  # two moments close together say little
        self._trend += np.where(certain, certain_gain * (between - self._trend), 0.0)
        self._trend += np.where(active, 0.0, passive_gain * (slope - self._trend))
        renewed = certain | ~active
        self.reference = np.maximum(reference, 0.0)
        self._known = np.where(renewed, self.reference, self._known)
        self._age = np.where(renewed, 0.0, self._age)
        self._release(active & (self._age > p.resynchronise_s))

    def _release(self, wanted: np.ndarray) -> None:
        """Release one sound axle: the one vented longest, else the last, which runs on the rail that the others cleaned.

        A wheel that stands although it has been vented may have a valve that is stuck: it is chosen only where all stand.
        """
        order = self._vented + 1e-6 * np.arange(self.speed.shape[1])
        stuck = self.failed | self.standing
        useless = np.where(stuck.all(axis=1, keepdims=True), self.failed, stuck)
        chosen = np.argmax(np.where(useless, -1.0, order), axis=1)
        keep = self.released & ~useless
        chosen = np.where(keep.any(axis=1), np.argmax(keep, axis=1), chosen)
        self.released = wanted[:, None] & (np.arange(self.speed.shape[1]) == chosen[:, None])
