"""A rule-based wheel slide protection in the manner of EN 15595.

Per axle a state machine applies, vents, holds and re-applies in pulses, on the axle's slip below a reference speed and on its
deceleration. Around it: a reference speed from all axles, learning of wheel diameters, a safety timer, a low-speed cut-out,
wheel-rotation monitoring, a degraded mode for a failed speed sensor. What we know of EN 15595:2018+A1:2023 and UIC 541-05 is
that these functions are required; the numbers are not public: each is a named parameter marked as an assumption.
"""

import dataclasses

import numpy as np

from wsp_env.envs.observation import Measurement
from wsp_env.parameters.quantity import Checked, quantity
from wsp_env.parameters.vehicle import Vehicle

#: States of an axle.
APPLY, VENT, HOLD, PULSE = 0, 1, 2, 3

_TUNED = "assumption: chosen on the test programme (wsp evaluate)"


@dataclasses.dataclass(frozen=True)
class RuleBasedParameters(Checked):
    """Thresholds and times of the rules."""

    slip_base_mps: float = quantity(0.35, "m/s", _TUNED, 0.0, 10.0)  # slip threshold at standstill
    slip_per_speed: float = quantity(0.025, "-", _TUNED + "; grows with the speed", 0.0, 1.0)
    slip_large_factor: float = quantity(2.5, "-", _TUNED + "; times the threshold: vents at any deceleration", 1.0, 20.0)
    slip_release_factor: float = quantity(0.5, "-", _TUNED + "; times the threshold: re-applies below", 0.0, 1.0)
    deceleration_mps2: float = quantity(1.6, "m/s2", _TUNED + "; wheel deceleration that vents with slip", 0.0, 50.0)
    deceleration_large_mps2: float = quantity(6.0, "m/s2", _TUNED + "; vents at once", 0.0, 100.0)
    recovered_mps2: float = quantity(0.3, "m/s2", _TUNED + "; acceleration that ends venting", -10.0, 50.0)
    reaccelerated_mps2: float = quantity(3.0, "m/s2", _TUNED + "; re-acceleration that re-applies", 0.0, 50.0)
    filter_s: float = quantity(0.06, "s", _TUNED + "; low-pass of the wheel acceleration", 0.0, 1.0, open_low=True)
    pulse_on_s: float = quantity(0.04, "s", _TUNED + "; re-application pulse", 0.0, 1.0, open_low=True)
    pulse_off_s: float = quantity(0.16, "s", _TUNED + "; hold between pulses", 0.0, 2.0)
    pulsing_s: float = quantity(2.0, "s", _TUNED + "; pulses, then full application", 0.0, 20.0)
    reference_bound_mps2: float = quantity(1.4, "m/s2", "assumption: above the full brake's 1.2 m/s2", 0.1, 20.0)
    resynchronise_s: float = quantity(3.0, "s", _TUNED + "; all axles sliding: one is released to roll", 0.1, 60.0)
    safety_timer_s: float = quantity(10.0, "s", "assumption: EN 15595, venting at most 10 s", 0.1, 60.0)
    cut_out_mps: float = quantity(1.4, "m/s", "assumption: EN 15595, no WSP below 3 to 5 km/h", 0.0, 10.0)
    learning_s: float = quantity(0.5, "s", "assumption: cylinders fill, the wheels still roll freely", 0.0, 60)
    diameter_tolerance: float = quantity(0.06, "-", "assumption: UIC 541-05, wheels of 1000 to 920 mm alike", 0.0, 0.2)
    rotation_monitor_s: float = quantity(1.0, "s", _TUNED + "; standing wheel at running speed is reported", 0.0, 60.0)
    sensor_jump_mps2: float = quantity(100.0, "m/s2", "assumption: no wheel can decelerate so", 10.0, 1e4)


class RuleBasedWSP:
    """The rule-based controller; `standing` and `failed` (N, A) report locked axles and failed speed sensors.

    Parameters
    ----------
    parameters : thresholds and times

    """

    def __init__(self, parameters: RuleBasedParameters | None = None) -> None:
        self.parameters = parameters or RuleBasedParameters()

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        shape = (n, vehicle.axles)
        self._radius = np.full(shape, vehicle.wheel_radius_m)
        self._nominal = vehicle.wheel_radius_m
        self._speed = np.full(shape, np.nan)  # last peripheral speed [m/s]
        self._acceleration = np.zeros(shape)  # filtered [m/s2]
        self._reference = np.zeros(n)
        self._trend = np.zeros(n)  # deceleration of the reference when it was last credible [m/s2]
        self._all_sliding = np.zeros(n)  # for how long [s]
        self._released = np.zeros(n, dtype=bool)  # the last axle is let roll to renew the reference
        self._state = np.full(shape, APPLY)
        self._since = np.zeros(shape)  # in this state [s]
        self._unbraked = np.zeros(shape)  # since the last application [s]
        self._standing_for = np.zeros(shape)
        self._rest = np.zeros(shape)  # the safety timer keeps the axle applied for so long [s]
        self._time = np.zeros(n)
        self.standing = np.zeros(shape, dtype=bool)
        self.failed = np.zeros(shape, dtype=bool)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""
        p = self.parameters
        first = np.isnan(self._speed).all()
        step = np.maximum(measurement.time - self._time, 1e-6)
        self._time = measurement.time.copy()
        wheel = np.nan_to_num(measurement.wheel_speed, nan=0.0)
        self.failed |= ~np.isfinite(measurement.wheel_speed)
        if first:
            self._speed = self._radius * wheel
            self._reference = self._speed.max(axis=1)
            self.failed |= self._speed < 0.5 * self._reference[:, None]  # standing from the start: nothing braked it
            return np.ones_like(self._speed)
        self._learn_diameters(wheel)
        speed = self._radius * wheel
        rate = (speed - self._speed) / step[:, None]
        self.failed |= rate < -p.sensor_jump_mps2
        self._speed = speed
        gain = 1.0 - np.exp(-step[:, None] / p.filter_s)
        self._acceleration += gain * (rate - self._acceleration)
        threshold = p.slip_base_mps + p.slip_per_speed * self._reference[:, None]
        self._update_reference(step, threshold)
        slip = self._reference[:, None] - speed
        self._monitor_rotation(step)
        self._step_states(step, slip, p.slip_base_mps + p.slip_per_speed * self._reference[:, None])
        return self._commands()

    def _learn_diameters(self, wheel: np.ndarray) -> None:
        """While all axles roll freely their peripheral speeds are equal: what differs is the diameter."""
        p = self.parameters
        rolling = (self._time <= p.learning_s) & ~self.failed.any(axis=1) & (wheel.min(axis=1) > 1.0)
        if rolling.any():
            ratio = wheel.mean(axis=1, keepdims=True) / np.maximum(wheel, 1e-6)
            ratio = np.clip(ratio, 1.0 - p.diameter_tolerance, 1.0 + p.diameter_tolerance)
            learnt = self._radius + 0.1 * (self._nominal * ratio - self._radius)
            self._radius = np.where(rolling[:, None], learnt, self._radius)

    def _update_reference(self, step: np.ndarray, threshold: np.ndarray) -> None:
        """Fastest sound axle; when all slide, the reference runs on with the deceleration it last had."""
        p = self.parameters
        sound = np.where(self.failed, -np.inf, self._speed)
        fastest = sound.max(axis=1)
        fastest = np.where(np.isfinite(fastest), fastest, self._reference)
        falling = np.clip(self._trend, 0.2, p.reference_bound_mps2)
        coasted = self._reference - falling * step
        sliding = (fastest < coasted - 0.25 * threshold[:, 0]) | (self._reference - fastest > 0.5 * threshold[:, 0])
        bounded = np.maximum(fastest, self._reference - p.reference_bound_mps2 * step)
        reference = np.where(sliding, np.maximum(coasted, fastest), bounded)
        trend_gain = 1.0 - np.exp(-step / 0.5)
        slope = np.clip((self._reference - reference) / step, 0.0, p.reference_bound_mps2)
        self._trend += np.where(sliding, 0.0, trend_gain * (slope - self._trend))
        self._reference = np.maximum(reference, 0.0)
        self._all_sliding = np.where(sliding, self._all_sliding + step, 0.0)
        # Release the last sound axle until it rolls: it then is the fastest and renews the reference.
        self._released = (self._all_sliding > p.resynchronise_s) & sliding

    def _monitor_rotation(self, step: np.ndarray) -> None:
        stands = (self._speed < 0.3) & (self._reference[:, None] > 2.0 * self.parameters.cut_out_mps)
        self._standing_for = np.where(stands, self._standing_for + step[:, None], 0.0)
        self.standing = self._standing_for > self.parameters.rotation_monitor_s

    def _step_states(self, step: np.ndarray, slip: np.ndarray, threshold: np.ndarray) -> None:
        """One transition of every axle's state machine."""
        p = self.parameters
        state, acceleration = self._state, self._acceleration
        slides = (slip > threshold) & (acceleration < -p.deceleration_mps2)
        slides |= (slip > p.slip_large_factor * threshold) & (acceleration < p.recovered_mps2)
        slides |= (acceleration < -p.deceleration_large_mps2) & (slip > 0.3 * threshold)
        caught = acceleration > p.recovered_mps2
        grips = (slip < p.slip_release_factor * threshold) | (acceleration > p.reaccelerated_mps2)
        settled = self._since > p.pulsing_s
        after = state.copy()
        after[slides] = VENT
        after[(state == VENT) & ~slides & caught] = HOLD
        after[(state == HOLD) & ~slides & grips] = PULSE
        after[(state == PULSE) & ~slides & settled] = APPLY
        after[(state == VENT) & ~slides & grips] = PULSE
        self._since = np.where(after == state, self._since + step[:, None], 0.0)
        self._state = after
        braking = (after == APPLY) | (after == PULSE)
        self._unbraked = np.where(braking, 0.0, self._unbraked + step[:, None])
        expired = self._unbraked > p.safety_timer_s
        self._rest = np.where(expired, 1.0, np.maximum(self._rest - step[:, None], 0.0))
        self._unbraked[expired] = 0.0

    def _commands(self) -> np.ndarray:
        p = self.parameters
        state = self._state
        command = np.ones(state.shape)
        command[state == VENT] = -1.0
        command[state == HOLD] = 0.0
        period = p.pulse_on_s + p.pulse_off_s
        resting = (state == PULSE) & (np.mod(self._since, period) >= p.pulse_on_s - 1e-9)
        command[resting] = 0.0
        if self._released.any():
            last = self.failed.shape[1] - 1 - np.argmax(~self.failed[:, ::-1], axis=1)
            rows = np.flatnonzero(self._released)
            command[rows, last[rows]] = -1.0
        command[self._rest > 0.0] = 1.0
        if self.failed.any():  # degraded mode: an axle without sensor does what its neighbour does
            for k in range(state.shape[1]):
                neighbour = k ^ 1 if (k ^ 1) < state.shape[1] else k
                lost = self.failed[:, k] & ~self.failed[:, neighbour]
                command[lost, k] = command[lost, neighbour]
                command[self.failed[:, k] & self.failed[:, neighbour], k] = 1.0
        command[self._reference < p.cut_out_mps] = 1.0
        return command
