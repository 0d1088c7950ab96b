"""An observer that doubts: which wheel sensors to believe, and what to do with an axle that cannot be watched.

It stands between a measurement and `wsp_env.observer.observation.Observer`, and between a controller and the valves. The
learned policies and the adaptive controller share it.

- Sensors that are lost, frozen, noisy or dead are found and left out for the rest of the stop: what has failed once is not
  believed again while the brake depends on it. The observer is then given a wheel that rolls with the estimated running speed,
  and takes no correction from it.
- An axle whose valve does not obey is left out as well: its wheel slows more than its brake is taken to do. A wheel that stands
  is reported whether its sensor is believed or not.
- While a reading repeats, the wheel is taken to slow with the vehicle: a frozen one must not keep the estimated speed up.
- Wheel radii are learned while all wheels roll, before the brake acts: the observer is given speeds as of nominal wheels.
- Noise beyond what is usual is measured and filtered.
- An axle without a believed sensor is braked by rules: fully where nothing slides, otherwise by less than what the watched
  axles use.
- No axle stays without brake for ever: a safety timer applies it for a moment.
- At the end of a stop no wheel is left to lock on a running speed that is estimated too low: the fastest wheel counts too.
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
from wsp_env.observer.estimator import approach
from wsp_env.observer.observation import Observer, constants_of, memory_of
from wsp_env.observer.overrule import TIMER_REST_S, TIMER_S, overrule
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


class Guard:
    """Doubts for the stops of one observer; `failed`, `standing` (N, A) bool and `radius` (N, A) [m] say what was found.

    Parameters
    ----------
    vehicle : for its nominal values
    observer : that is given what is believed, and asked for what it estimates
    n : number of stops
    timer_s, timer_rest_s : of the safety timer: longest time without brake, and for how long it applies then [s]

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
        """Sensors that are not believed (N, A) bool."""
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
        """Take the first measurement, begin the observer; return its observations (N, size)."""
        raw = self._readings(measurement)
        _begin(raw, self._state)
        observation = self._observer.reset(measurement._replace(wheel_speed=self.doubts.clean))
        self._observer.estimate.trusted[:] = ~self.doubts.failed
        _note(self._state, self._given, self._observer.state)
        return observation

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observation (N, size)."""
        raw = self._readings(measurement)
        _doubt(raw, self._state, self._given, self._observer.state, self._observer.given)
        return self._observer.observe(measurement._replace(wheel_speed=self.doubts.clean), command)

    def _readings(self, measurement: Measurement) -> np.ndarray:
        """Return the wheel speeds (N, A) [rad/s]; `ValueError` for shapes or demands that cannot be.

        The kernels look at nothing of that: they would write beyond the ends of what is kept.
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
        """Change valve commands (N, A), in place, where an axle is not watched or a wheel would lock at the end of a stop."""
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
    """Note against which speeds a reading that repeats from the first one on is compared."""
    d, c = doubts_of(state), guard_of(given)
    e = memory_of(memory).estimate
    for i in range(d.raw.shape[0]):
        for k in range(d.raw.shape[1]):
            d.held_at[i, k] = e.speed[i]
            d.others_at[i, k] = c.radius * others(i, k, d)


@loop
def _doubt(raw: np.ndarray, state: Any, given: Any, memory: Any, constants: Any) -> None:
    """Judge the readings (N, A) [rad/s] of all stops; write what the observer is to believe."""
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
            if d.same[i, k] > 0.0:  # it may be frozen: until that is clear the wheel is taken to slow with the vehicle
                e.trusted[i, k] = False
                d.clean[i, k] = max(d.clean[i, k] + (e.speed[i] - d.held_at[i, k]) / c.radius, 0.0)
