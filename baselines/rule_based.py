"""A rule-based wheel slide protection in the manner of EN 15595.

Per axle a state machine applies, vents, holds and re-applies in pulses, on the axle's slip below a reference speed and on its
deceleration. Around it: a reference speed from all axles with learning of wheel diameters and monitoring of sensors and
rotation (`baselines.reference_speed`), a safety timer, a low-speed cut-out, a degraded mode for a failed speed sensor. What we
know of EN 15595:2018+A1:2023 and UIC 541-05 is that these functions are required; the numbers are not public: each is a named
parameter marked as an assumption.
"""

import dataclasses

import numpy as np

from baselines.reference_speed import ReferenceParameters, ReferenceSpeed
from baselines.safety_timer import SafetyParameters, SafetyTimer
from wsp_env.parameters.quantity import quantity
from wsp_env.parameters.vehicle import Vehicle, check_vehicle
from wsp_env.plant.command import APPLIES, VENTS
from wsp_env.plant.port import Measurement

#: States of an axle.
APPLY, VENT, HOLD, PULSE = 0, 1, 2, 3

_TUNED = "assumption: chosen on the test programme (wsp evaluate)"


@dataclasses.dataclass(frozen=True)
class RuleBasedParameters(ReferenceParameters, SafetyParameters):
    """Thresholds and times of the rules."""

    slip_base_mps: float = quantity(0.1, "m/s", _TUNED + "; slip threshold at standstill", 0.0, 10.0)
    slip_per_speed: float = quantity(0.07, "-", _TUNED + "; growth of the threshold with the speed", 0.0, 1.0)
    slip_large_factor: float = quantity(2.5, "-", _TUNED + "; times the threshold: vents unless the wheel recovers", 1.0, 20.0)
    slip_small_factor: float = quantity(0.3, "-", _TUNED + "; times the threshold: vents at a large deceleration", 0.0, 1.0)
    slip_release_factor: float = quantity(0.05, "-", _TUNED + "; times the threshold: re-applies below", 0.0, 1.0)
    deceleration_mps2: float = quantity(4.0, "m/s2", _TUNED + "; wheel deceleration that vents with slip", 0.0, 50.0)
    deceleration_large_mps2: float = quantity(5.0, "m/s2", _TUNED + "; vents with small slip", 0.0, 100.0)
    recovered_mps2: float = quantity(-0.5, "m/s2", _TUNED + "; acceleration that ends venting", -10.0, 50.0)
    reaccelerated_mps2: float = quantity(4.0, "m/s2", _TUNED + "; re-acceleration that re-applies", 0.0, 50.0)
    pulse_on_s: float = quantity(0.1, "s", _TUNED + "; re-application pulse", 0.0, 1.0, open_low=True)
    pulse_off_s: float = quantity(0.26, "s", _TUNED + "; hold between pulses", 0.0, 2.0)
    pulsing_s: float = quantity(1.5, "s", _TUNED + "; pulses, then full application", 0.0, 20.0)
    calm_s: float = quantity(3.0, "s", _TUNED + "; all axles applied for so long: the slide is over", 0.0, 60.0)
    blind_rest_s: float = quantity(0.3, "s", _TUNED + "; safety_rest_s of an axle without sensor: too short to lock", 0.0, 60.0)
    cut_out_mps: float = quantity(1.4, "m/s", "assumption: EN 15595, no WSP below 3 to 5 km/h", 0.0, 10.0)
    long_slide: float = quantity(0.0, "-", "assumption: devices of today hold 0.1 to 0.25 to clean the rail; 0: off", 0.0, 0.3)
    long_slide_trial_s: float = quantity(8.0, "s", "assumption: two renewals of the reference speed", 1.0, 60.0)
    long_slide_gain: float = quantity(
        1.1, "-", "assumption: deceleration in the trial over that before; else given up", 0.0, 5.0
    )


class LongSlide:
    """The long slide of today's devices, an option: large slip is held on purpose where it cleans the rail.

    Once the protection has acted for as long as a trial takes, large slip is tried. It is kept if the vehicle slows more than
    before, and given up for the rest of the stop if not.
    """

    def __init__(self, parameters: RuleBasedParameters, n: int) -> None:
        self.parameters = parameters
        self._for = np.zeros(n)  # in this phase [s]
        self._from = np.zeros(n)  # reference speed at its begin [m/s]
        self._before = np.zeros(n)  # deceleration of the phase before the trial [m/s2]
        self._phase = np.zeros(n, dtype=int)  # 0 usual slip, 1 trial, 2 kept, 3 given up

    def creepage(self, step: np.ndarray, reference: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Return the growth of the slip threshold with the speed (N,) after `step` (N,) [s] more."""
        p, usual = self.parameters, np.asarray(self.parameters.slip_per_speed).reshape(-1)
        long = np.asarray(p.long_slide).reshape(-1)
        waits = (self._phase == 0) & ~active
        self._for = np.where(waits, 0.0, self._for + step)
        self._from = np.where(waits, reference, self._from)
        over = (self._for > p.long_slide_trial_s) & (self._phase < 2)
        slowed = (self._from - reference) / np.maximum(self._for, 1e-6)
        pays = slowed > p.long_slide_gain * self._before
        after = np.where(self._phase == 0, 1, np.where(pays, 2, 3))
        self._before = np.where(over & (self._phase == 0), slowed, self._before)
        self._phase = np.where(over, after, self._phase)
        self._for, self._from = np.where(over, 0.0, self._for), np.where(over, reference, self._from)
        held = ((self._phase == 1) | (self._phase == 2)) & (long > 0.0)
        chosen: np.ndarray = np.where(held, np.maximum(long, usual), usual)
        return chosen


class RuleBasedWSP:
    """The rule-based controller; `wheels.standing` and `wheels.failed` (N, A) report locked axles and failed speed sensors.

    Parameters
    ----------
    parameters : thresholds and times

    """

    def __init__(self, parameters: RuleBasedParameters | None = None) -> None:
        self.parameters = parameters or RuleBasedParameters()

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        check_vehicle(vehicle)
        shape = (n, vehicle.axles)
        self.wheels = ReferenceSpeed(self.parameters, n, vehicle)
        self._state = np.full(shape, APPLY)
        self._since = np.zeros(shape)  # in this state [s]
        self._timer = SafetyTimer(shape)
        self._expired = np.zeros(shape, dtype=bool)  # the safety timer applies the axle
        self._calm = np.full(n, np.inf)  # all axles applied for so long [s]
        self._command = np.ones(shape)
        self._blind = np.zeros(shape, dtype=bool)  # released, as its sensor failed and the rail is slippery
        self._long = LongSlide(self.parameters, n)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""
        step = self.wheels.update(measurement, self._command, self._calm <= self.parameters.calm_s)
        self._step_states(step)
        self._command = self._commands()
        return self._command

    def _step_states(self, step: np.ndarray) -> None:
        """One transition of every axle's state machine."""
        p = self.parameters
        state, acceleration = self._state, self.wheels.acceleration
        reference = self.wheels.reference[:, None]
        slip = reference - self.wheels.speed
        threshold = p.slip_base_mps + p.slip_per_speed * reference
        if np.any(p.long_slide):
            held = self._long.creepage(step, self.wheels.reference, self._calm <= p.calm_s)[:, None]
            threshold = p.slip_base_mps + held * reference
        slides = (slip > threshold) & (acceleration < -p.deceleration_mps2)
        slides |= (slip > p.slip_large_factor * threshold) & (acceleration < p.recovered_mps2)
        slides |= (slip > p.slip_small_factor * threshold) & (acceleration < -p.deceleration_large_mps2)
        caught = acceleration > p.recovered_mps2
        grips = (slip < p.slip_release_factor * threshold) | (acceleration > p.reaccelerated_mps2)
        settled = self._since > p.pulsing_s
        after = state.copy()
        after[(state == VENT) & caught] = HOLD
        after[(state == HOLD) & grips] = PULSE
        after[(state == PULSE) & settled] = APPLY
        after[(state == VENT) & grips] = PULSE
        after[slides] = VENT
        after[self.wheels.released] = VENT
        self._since = np.where(after == state, self._since + step[:, None], 0.0)
        self._state = after
        failed = self.wheels.failed
        self._calm = np.where(((after == APPLY) | failed).all(axis=1), self._calm + step, 0.0)
        # Degraded mode: an axle that cannot be watched is not braked while others slide; with no sensor left all are.
        self._blind = failed & ~failed.all(axis=1, keepdims=True) & (self._calm <= p.calm_s)[:, None]
        braking = ((after == APPLY) | (after == PULSE)) & ~self._blind
        rest = np.where(failed, p.blind_rest_s, p.safety_rest_s)
        self._expired = self._timer.expired(braking, step[:, None], p.safety_timer_s, rest)

    def _commands(self) -> np.ndarray:
        p = self.parameters
        state, failed = self._state, self.wheels.failed
        command = np.ones(state.shape)
        command[state == VENT] = VENTS
        command[state == HOLD] = 0.0
        period = p.pulse_on_s + p.pulse_off_s
        command[(state == PULSE) & (np.mod(self._since, period) >= p.pulse_on_s - 1e-9)] = 0.0
        command[failed] = APPLIES
        command[self._blind] = VENTS
        command[self._expired] = APPLIES
        command[self.wheels.reference < p.cut_out_mps] = APPLIES
        return command
