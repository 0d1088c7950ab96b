"""An observer that doubts: which wheel sensors to believe, and what to do with an axle that cannot be watched.

It stands between a measurement and `wsp_env.observer.observation.Observer`, and between a controller and the valves. The
learned policies and the adaptive controller share it.

- Sensors that are lost, frozen, noisy or dead are found and left out for the rest of the stop: what has failed once is not
  believed again while the brake depends on it. The observer is then given a wheel that rolls with the estimated running speed,
  and takes no correction from it.
- Wheel radii are learned while all wheels roll, before the brake acts: the observer is given speeds as of nominal wheels.
- Noise beyond what is usual is measured and filtered.
- An axle without a believed sensor is braked by rules: fully where nothing slides, otherwise by less than what the watched
  axles use.
- No axle stays without brake for ever: a safety timer applies it for a moment.
- At the end of a stop no wheel is left to lock on a running speed that is estimated too low: the fastest wheel counts too.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined, loop, plain, rebuilder
from wsp_env.observer.estimator import ROLLING_ADHESION, EstimatorConstants, VehicleEstimate, approach
from wsp_env.observer.observation import Observer, constants_of, memory_of
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.command import APPLIES, HOLDS, VENTS
from wsp_env.plant.port import Measurement

#: A circumferential speed that changes faster [m/s2] is none of a wheel (assumption: a full brake alone changes it by 16 m/s2).
JUMP_MPS2 = 100.0

#: Before the brake acts, a wheel slower than this share of the fastest has no sensor (assumption).
ABSENT_SHARE = 0.5

#: A sensor whose readings stay the same to the last digit for so long [s], above this circumferential speed [m/s], while the
#: estimated running speed or the mean of the other wheels changes by so much [m/s], is frozen (assumptions: a pulse wheel of
#: 60 pulses a turn then passes six edges; measured speeds have noise; without noise a vehicle may coast at the same speed).
FROZEN_S, FROZEN_ABOVE_MPS, FROZEN_CHANGE_MPS = 0.3, 1.0, 0.05

#: A wheel below the one speed while the vehicle runs above the other [m/s] stands. After its brake has been empty for so long
#: [s] it would turn on any rail: the sensor is dead (assumption: adhesion of 0.015 turns it by 2 m/s in that time).
STANDING_MPS, RUNNING_MPS, DEAD_S = 0.3, 2.8, 1.0

#: Noise of a sensor, standard deviation [rad/s]: beyond the first it is filtered, beyond the second the sensor is left out
#: (assumptions: what policies are trained with; 0.45 m/s at the tread, more than slips worth their price).
USUAL_NOISE, MOST_NOISE = 0.1, 1.0

#: Time constant of the measured noise [s], and how much a wheel's acceleration changes from one measurement to the next [m/s2],
#: by which a noisy speed is filtered (assumptions: a moving valve changes it by 1 to 2).
NOISE_FILTER_S, CHANGE_MPS2 = 1.0, 1.0

#: Radii are learned within this share of the nominal one (assumption: wheels of one vehicle are worn by up to 8 %).
RADIUS_TOLERANCE = 0.08

#: An axle that is not watched is first vented for so long [s], so that a wheel that has locked turns again; then it is braked
#: by this share of the least adhesion that a watched axle uses, until nothing has slid for so long [s] (assumptions).
RELEASE_S, BLIND_SHARE, CALM_S = 0.7, 0.6, 3.0

#: An axle whose brake was as good as empty for so long [s] is applied for so long [s], and for so long if it is not watched
#: (assumptions: EN 15595, venting at most 10 s; too short to lock).
TIMER_S, TIMER_REST_S, BLIND_REST_S = 10.0, 1.0, 0.3

#: Creepage [-] from which a wheel is vented at the end of a stop, and the running speed [m/s] below which the brake is left to
#: itself (assumptions: the environments' slide limit; EN 15595, no WSP below 3 to 5 km/h, the lower end).
END_CREEPAGE, END_MPS = 0.3, 0.83


class Doubts(NamedTuple):
    """What is remembered of the sensors of N vehicles with A axles, changed in place."""

    failed: np.ndarray  # (N, A) bool, not believed for the rest of the stop
    standing: np.ndarray  # (N, A) bool, stands while the vehicle runs
    raw: np.ndarray  # (N, A) as last measured [rad/s]
    same: np.ndarray  # (N, A) for how long the readings stayed the same [s]
    held_at: np.ndarray  # (N, A) running speed since which they did [m/s]
    others_at: np.ndarray  # (N, A) and mean of the other wheels [m/s]
    empty: np.ndarray  # (N, A) for how long a standing wheel's brake was empty [s]
    difference: np.ndarray  # (N, A) of the last two readings [rad/s]
    second: np.ndarray  # (N, A) difference of the last two differences [rad/s]
    variance: np.ndarray  # (N, A) of the noise [rad2/s2]
    speed: np.ndarray  # (N, A) filtered [rad/s]
    rate: np.ndarray  # (N, A) its change in an interval [rad/s]
    ratio: np.ndarray  # (N, A) radius over the nominal one [-]
    learned: np.ndarray  # (N,) readings of the radii
    blind: np.ndarray  # (N, A) for how long without a believed sensor [s]
    unbraked: np.ndarray  # (N, A) for how long the brake was as good as empty [s]
    rest: np.ndarray  # (N, A) for how long the safety timer still applies it [s]
    clean: np.ndarray  # (N, A) what the observer is given [rad/s]


class GuardConstants(NamedTuple):
    """What stays."""

    radius: float  # nominal [m]
    interval: float  # between measurements [s]
    slow: float  # share of `NOISE_FILTER_S` in an interval [-]
    timer: float  # the safety timer's time without brake [s]
    timer_rest: float  # and that for which it applies [s]


def _allocate(n: int, axles: int) -> Doubts:
    arrays = {name: np.zeros(n if name == "learned" else (n, axles)) for name in Doubts._fields}
    arrays["ratio"][:] = 1.0
    for name in ("failed", "standing"):
        arrays[name] = np.zeros((n, axles), dtype=bool)
    return Doubts(**arrays)


_doubts_of = rebuilder(_allocate(1, 1))
_guard_of = rebuilder(GuardConstants(1.0, 1.0, 1.0, 1.0, 1.0))


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
        self.doubts = _allocate(n, vehicle.axles)
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
        raw = np.array(measurement.wheel_speed, dtype=np.float64, order="C")
        _begin(raw, self._state)
        observation = self._observer.reset(measurement._replace(wheel_speed=self.doubts.clean))
        self._observer.estimate.trusted[:] = ~self.doubts.failed
        return observation

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observation (N, size)."""
        raw = np.array(measurement.wheel_speed, dtype=np.float64, order="C")
        _doubt(raw, self._state, self._given, self._observer.state, self._observer.given)
        return self._observer.observe(measurement._replace(wheel_speed=self.doubts.clean), command)

    def overrule(self, command: np.ndarray) -> np.ndarray:
        """Change valve commands (N, A), in place, where an axle is not watched or a wheel would lock at the end of a stop."""
        _overrule(command, self._state, self._given, self._observer.state, self._observer.given)
        return command


@loop
def _begin(raw: np.ndarray, state: Any) -> None:
    """Take the first readings (N, A) [rad/s]."""
    d = _doubts_of(state)
    for i in range(raw.shape[0]):
        fastest = 0.0
        for k in range(raw.shape[1]):
            if math.isfinite(raw[i, k]):
                fastest = max(fastest, raw[i, k])
        for k in range(raw.shape[1]):
            d.failed[i, k] = not (math.isfinite(raw[i, k]) and raw[i, k] >= ABSENT_SHARE * fastest)
            d.raw[i, k] = d.speed[i, k] = fastest if d.failed[i, k] else raw[i, k]
        _compare(i, d)
        for k in range(raw.shape[1]):
            d.clean[i, k] = d.ratio[i, k] * d.speed[i, k]


@loop
def _doubt(raw: np.ndarray, state: Any, given: Any, memory: Any, constants: Any) -> None:
    """Judge the readings (N, A) [rad/s] of all stops; write what the observer is to believe."""
    d, c = _doubts_of(state), _guard_of(given)
    e = memory_of(memory).estimate
    brake = constants_of(constants).estimator
    for i in range(raw.shape[0]):
        for k in range(raw.shape[1]):
            if not d.failed[i, k]:
                _judge(i, k, raw[i, k], d, c, e, brake)
        _learn(i, d, e, brake)
        for k in range(raw.shape[1]):
            e.trusted[i, k] = not d.failed[i, k]
            if d.failed[i, k]:
                e.ahead[i, k] = 0.0
                d.clean[i, k] = e.speed[i] / c.radius
            else:
                d.clean[i, k] = d.ratio[i, k] * d.speed[i, k]


@inlined
def _judge(
    i: int, k: int, reading: float, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants
) -> None:  # fmt: skip
    """Look for faults of one sensor; filter its noise."""
    if not math.isfinite(reading):
        d.failed[i, k] = True
        return
    change = reading - d.raw[i, k]
    d.failed[i, k] = abs(change) * c.radius > JUMP_MPS2 * c.interval
    d.same[i, k] = d.same[i, k] + c.interval if change == 0.0 and reading * c.radius > FROZEN_ABOVE_MPS else 0.0
    others = c.radius * _others(i, k, d)
    if d.same[i, k] == 0.0:
        d.held_at[i, k], d.others_at[i, k] = e.speed[i], others
    moved = max(abs(e.speed[i] - d.held_at[i, k]), abs(others - d.others_at[i, k]))
    d.failed[i, k] |= d.same[i, k] >= FROZEN_S - 1e-9 and moved > FROZEN_CHANGE_MPS
    second = change - d.difference[i, k]
    third = second - d.second[i, k]
    d.variance[i, k] += c.slow * (third * third / 20.0 - d.variance[i, k])  # white noise makes 20 times its variance
    d.failed[i, k] |= d.variance[i, k] > MOST_NOISE * MOST_NOISE
    d.raw[i, k], d.difference[i, k], d.second[i, k] = reading, change, second
    d.standing[i, k] = reading * c.radius < STANDING_MPS and e.speed[i] > RUNNING_MPS
    empty = d.standing[i, k] and brake.full_brake * e.pressure[i, k] < ROLLING_ADHESION
    d.empty[i, k] = d.empty[i, k] + c.interval if empty else 0.0
    d.failed[i, k] |= d.empty[i, k] >= DEAD_S
    noise = d.variance[i, k] - USUAL_NOISE * USUAL_NOISE
    if noise <= 0.0:
        d.speed[i, k], d.rate[i, k] = reading, change
        return
    _filter(i, k, reading, noise, d, c)


@inlined
def _others(i: int, k: int, d: Doubts) -> float:
    """Mean reading of the other believed sensors [rad/s], 0 without any."""
    total, sound = 0.0, 0
    for j in range(d.raw.shape[1]):
        if j != k and not d.failed[i, j]:
            total += d.raw[i, j]
            sound += 1
    return total / max(sound, 1)


@inlined
def _filter(i: int, k: int, reading: float, noise: float, d: Doubts, c: GuardConstants) -> None:
    """Follow a noisy speed by the steady filter of speed and acceleration for this noise [rad2/s2] (Kalata 1984)."""
    index = CHANGE_MPS2 / c.radius * c.interval / math.sqrt(noise)
    r = 0.25 * (4.0 + index - math.sqrt(8.0 * index + index * index))
    gain = 1.0 - r * r
    gain_rate = 2.0 * (2.0 - gain) - 4.0 * math.sqrt(1.0 - gain)
    expected = d.speed[i, k] + d.rate[i, k]
    missing = reading - expected
    d.speed[i, k] = max(expected + gain * missing, 0.0)
    d.rate[i, k] += gain_rate * missing


@inlined
def _learn(i: int, d: Doubts, e: VehicleEstimate, brake: EstimatorConstants) -> None:
    """While all wheels roll freely their circumferential speeds are equal: learn the ratios of the radii."""
    most = 0.0
    for k in range(d.raw.shape[1]):
        most = max(most, brake.full_brake * e.pressure[i, k])
    if most > ROLLING_ADHESION:
        d.learned[i] = -1.0  # over: the brake acts
    elif d.learned[i] >= 0.0:
        _compare(i, d)


@inlined
def _compare(i: int, d: Doubts) -> None:
    """Take one more reading of the ratios of the radii, from wheels that roll freely."""
    mean, sound = 0.0, 0
    for k in range(d.raw.shape[1]):
        if not d.failed[i, k]:
            mean += d.raw[i, k]
            sound += 1
    mean /= max(sound, 1)
    alike = sound > 1
    for k in range(d.raw.shape[1]):
        alike = alike and (d.failed[i, k] or abs(mean - d.raw[i, k]) <= RADIUS_TOLERANCE * d.raw[i, k])
    if not alike or mean <= 0.0:
        return
    d.learned[i] += 1.0
    for k in range(d.raw.shape[1]):
        if not d.failed[i, k]:
            d.ratio[i, k] += (mean / d.raw[i, k] - d.ratio[i, k]) / d.learned[i]


@loop
def _overrule(command: np.ndarray, state: Any, given: Any, memory: Any, constants: Any) -> None:
    """See `Guard.overrule`."""
    d, c = _doubts_of(state), _guard_of(given)
    e = memory_of(memory).estimate
    brake = constants_of(constants).estimator
    for i in range(command.shape[0]):
        fastest, used, sound, last = 0.0, 1e9, 0, -1
        for k in range(command.shape[1]):
            if not d.failed[i, k]:
                sound, last = sound + 1, k
                fastest = max(fastest, e.wheel[i, k])
                used = min(used, min(e.adhesion[i, k], e.usual_adhesion[i, k]))
        running = max(e.speed[i], fastest)
        ends = running + e.uncertainty[i] < END_MPS
        for k in range(command.shape[1]):
            if d.failed[i, k]:
                d.blind[i, k] += c.interval
                command[i, k] = _blind(i, k, sound, used, d, e, brake)
            elif running - e.wheel[i, k] > END_CREEPAGE * running:
                command[i, k] = VENTS
            if e.doubtful[i] and k == last and d.failed[i, -1]:  # in place of the last axle this one shows the speed
                released = 0.5 * e.rolling_adhesion[i, k]
                command[i, k] = VENTS if brake.full_brake * e.pressure_to_come[i, k] > released else HOLDS
            if ends or _expired(i, k, command[i, k], d, c, e, brake):
                command[i, k] = APPLIES


@inlined
def _expired(
    i: int, k: int, command: float, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants
) -> bool:  # fmt: skip
    """Return whether the safety timer applies the axle."""
    braked = command > 0.5 or brake.full_brake * e.pressure_to_come[i, k] > ROLLING_ADHESION
    d.unbraked[i, k] = 0.0 if braked else d.unbraked[i, k] + c.interval
    d.rest[i, k] = max(d.rest[i, k] - c.interval, 0.0)
    if d.unbraked[i, k] > c.timer:
        d.unbraked[i, k] = 0.0
        d.rest[i, k] = BLIND_REST_S if d.failed[i, k] else c.timer_rest
    return d.rest[i, k] > 0.0


@inlined
def _blind(i: int, k: int, sound: int, used: float, d: Doubts, e: VehicleEstimate, brake: EstimatorConstants) -> float:
    """Return the command of an axle that is not watched, `used` [-] being the least adhesion that a watched one uses."""
    if e.since_slide[i] > CALM_S or sound == 0:
        return APPLIES
    if d.blind[i, k] < RELEASE_S:
        return VENTS
    wanted, held = BLIND_SHARE * max(used, 0.0), brake.full_brake * e.pressure_to_come[i, k]
    offered = brake.full_brake * e.distributor[i]
    if wanted > held + 0.5 * brake.fill * max(offered - held, 0.0):
        return APPLIES
    return VENTS if wanted < held - 0.5 * brake.vent * held else HOLDS
