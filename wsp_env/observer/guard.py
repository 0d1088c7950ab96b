"""Sensor supervision: excludes faulty wheel sensors, and controls axles that cannot be monitored.

It is placed between the measurement and `wsp_env.observer.observation.Observer`, and between a controller and the valves. The
learned policies and the adaptive controller share it.

- Lost, frozen, noisy or dead sensors are detected. A sensor flagged as failed stays excluded for the rest of the stop. The
  observer then gets a wheel that rolls with the estimated running speed, and takes no correction from it.
- An axle whose valve does not obey (its wheel slows more than its estimated brake can cause) is excluded as well. A standing
  wheel is reported even if its sensor is excluded.
- While a reading repeats, the wheel is assumed to slow with the vehicle: a frozen reading must not hold up the estimated speed.
- Wheel radii are learned while all wheels roll before braking; the observer gets speeds converted to nominal wheels.
- Noise above the usual level is measured and filtered.
- An axle without a working sensor is braked by rules: fully if nothing slides, otherwise with less than the monitored axles
  use.
- A safety timer briefly applies the brake of any axle that was without brake for too long.
- At the end of a stop, no wheel locks because of an underestimated running speed: the fastest wheel counts too.
"""

import math
from typing import Any

import numpy as np

from wsp_env.compiled import loop, plain
from wsp_env.observer.doubts import (
    ABSENT_SHARE,
    NOISE_FILTER_S,
    GuardConstants,
    allocate,
    compare,
    doubts_of,
    guard_of,
    judge,
    learn,
    others,
    stands,
)
from wsp_env.observer.estimate import approach
from wsp_env.observer.observation import Observer, constants_of, memory_of
from wsp_env.observer.overrule import TIMER_REST_S, TIMER_S, overrule
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


class Guard:
    """Sensor supervision for the stops of one observer. Results: `failed`, `standing` (N, A) bool, `radius` (N, A) [m].

    Parameters
    ----------
    vehicle : for its nominal values
    observer : gets the corrected wheel speeds; its estimates are used
    n : number of stops
    timer_s, timer_rest_s : safety timer: longest time without brake, and duration of the application [s]

    """

    def __init__(
        self, vehicle: Vehicle, observer: Observer, n: int, timer_s: float = TIMER_S, timer_rest_s: float = TIMER_REST_S
    ) -> None:
        self._observer, self._radius = observer, vehicle.wheel_radius_m
        self.doubts = allocate(n, vehicle.axles)
        self._state = plain(self.doubts)
        slow = approach(observer.interval, NOISE_FILTER_S)
        self._given = plain(GuardConstants(self._radius, observer.interval, slow, timer_s, timer_rest_s))

    @property
    def failed(self) -> np.ndarray:
        """Excluded sensors (N, A) bool."""
        return self.doubts.failed

    @property
    def standing(self) -> np.ndarray:
        """Wheels that stand while the vehicle runs (N, A) bool."""
        return self.doubts.standing

    @property
    def radius(self) -> np.ndarray:
        """Learned radii (N, A) [m]."""
        return self._radius * self.doubts.ratio

    def begin(self, measurement: Measurement) -> np.ndarray:
        """Take the first measurement and reset the observer; return its observations (N, size)."""
        raw = self._readings(measurement)
        _begin(raw, self._state)
        observation = self._observer.reset(measurement._replace(wheel_speed=self.doubts.clean))
        self._observer.estimate.trusted[:] = ~self.doubts.failed
        _note(self._state, self._given, self._observer.state)
        return observation

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observations (N, size)."""
        raw = self._readings(measurement)
        _doubt(raw, self._state, self._given, self._observer.state, self._observer.given)
        return self._observer.observe(measurement._replace(wheel_speed=self.doubts.clean), command)

    def _readings(self, measurement: Measurement) -> np.ndarray:
        """Return the wheel speeds (N, A) [rad/s]; `ValueError` for wrong shapes or demands outside 0 to 1.

        The kernels do not check this: they would write beyond the ends of their arrays.
        """
        raw = np.array(measurement.wheel_speed, dtype=np.float64, order="C")
        demand = np.asarray(measurement.demand, dtype=np.float64)
        n, axles = self.doubts.clean.shape
        for name, given, shape in (("wheel_speed", raw.shape, (n, axles)), ("demand", demand.shape, (n,))):
            if given != shape:
                raise ValueError(f"{name} has shape {given}; the controller was reset for {n} stops of {axles} axles: {shape}")
        if not ((demand >= 0.0) & (demand <= 1.0)).all():
            raise ValueError(f"demand must lie between 0 (none) and 1 (full brake), got {demand}")
        return raw

    def overrule(self, command: np.ndarray) -> np.ndarray:
        """Change valve commands (N, A) in place: for unmonitored axles, the safety timer, and wheels about to lock."""
        overrule(command, self._state, self._given, self._observer.state, self._observer.given)
        return command


@loop
def _begin(raw: np.ndarray, state: Any) -> None:
    """Take the first readings (N, A) [rad/s]."""
    d = doubts_of(state)
    for i in range(raw.shape[0]):
        fastest = 0.0
        for k in range(raw.shape[1]):
            if math.isfinite(raw[i, k]):
                fastest = max(fastest, raw[i, k])
        for k in range(raw.shape[1]):
            d.failed[i, k] = not (math.isfinite(raw[i, k]) and raw[i, k] >= ABSENT_SHARE * fastest)
            d.raw[i, k] = d.speed[i, k] = fastest if d.failed[i, k] else raw[i, k]
        compare(i, d)
        for k in range(raw.shape[1]):
            d.clean[i, k] = d.ratio[i, k] * d.speed[i, k]


@loop
def _note(state: Any, given: Any, memory: Any) -> None:
    """Store the speeds with which a reading that repeats from the first one is compared."""
    d, c = doubts_of(state), guard_of(given)
    e = memory_of(memory).estimate
    for i in range(d.raw.shape[0]):
        for k in range(d.raw.shape[1]):
            d.held_at[i, k] = e.speed[i]
            d.others_at[i, k] = c.radius * others(i, k, d)


@loop
def _doubt(raw: np.ndarray, state: Any, given: Any, memory: Any, constants: Any) -> None:
    """Check the readings (N, A) [rad/s] of all stops; write the wheel speeds for the observer."""
    d, c = doubts_of(state), guard_of(given)
    e = memory_of(memory).estimate
    brake = constants_of(constants).estimator
    for i in range(raw.shape[0]):
        for k in range(raw.shape[1]):
            if d.failed[i, k]:
                stands(i, k, raw[i, k], d, c, e)
            else:
                judge(i, k, raw[i, k], d, c, e, brake)
        learn(i, d, e, brake)
        for k in range(raw.shape[1]):
            e.trusted[i, k] = not d.failed[i, k]
            if d.failed[i, k]:
                e.ahead[i, k] = 0.0
                d.clean[i, k] = e.speed[i] / c.radius
                continue
            d.clean[i, k] = d.ratio[i, k] * d.speed[i, k]
            if d.same[i, k] > 0.0:  # possibly frozen: until this is clear, the wheel is assumed to slow with the vehicle
                e.trusted[i, k] = False
                d.clean[i, k] = max(d.clean[i, k] + (e.speed[i] - d.held_at[i, k]) / c.radius, 0.0)
