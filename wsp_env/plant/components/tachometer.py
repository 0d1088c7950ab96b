"""Wheel-speed sensors: on each axle a pulse wheel read by counting edges and timing the last one, with noise."""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined, kernel
from wsp_env.parameters.vehicle import Tachometer
from wsp_env.plant.mechanisms import Active
from wsp_env.plant.slots import reading, reading_factor

# SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): a good hash of a counter. The noise of a stop is a function of its key (drawn
# from the environment's own generator) and of the time, so it does not depend on the batch that the stop is computed in.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


class TachometerConstants(NamedTuple):
    """The sensor as compiled code takes it."""

    pulse_angle: float  # between two edges [rad]


class TachometerState(NamedTuple):
    """The sensors of N vehicles with A axles, all (N, A)."""

    angle: np.ndarray  # turned by the wheel [rad]
    edge_angle: np.ndarray  # of the last counted pulse edge [rad]
    edge_time: np.ndarray  # of that edge [s]
    counted: np.ndarray  # speed from the pulses [rad/s]
    filtered: np.ndarray  # the same as the sensor gives it, with the mechanisms on it [rad/s]
    measured: np.ndarray  # the same with the sensor's noise [rad/s]


def constants(tachometer: Tachometer) -> TachometerConstants:
    """Return a sensor as compiled code takes it."""
    return TachometerConstants(2.0 * math.pi / tachometer.pulses_per_turn)


def allocate(n: int, axles: int) -> TachometerState:
    """Return the sensors of n vehicles at rest."""
    return TachometerState(*(np.zeros((n, axles)) for _ in TachometerState._fields))


def begin(i: int, wheel_speed: np.ndarray, state: TachometerState) -> None:
    """Begin a stop of vehicle i, whose wheels turn with `wheel_speed` (A,) [rad/s]."""
    for array in (state.angle, state.edge_angle, state.edge_time):
        array[i] = 0.0
    for array in (state.counted, state.filtered, state.measured):
        array[i] = wheel_speed


@kernel
def uniform(key: np.uint64, counter: int) -> float:
    """Return number `counter` of the stream `key`, uniform in (0, 1)."""
    z = np.uint64(key) + np.uint64(counter + 1) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    z = z ^ (z >> np.uint64(31))
    return (float(z >> np.uint64(11)) + 0.5) / 9007199254740992.0  # 2 ** 53


@kernel
def normal(key: np.uint64, counter: int) -> float:
    """Return number `counter` of the stream `key`, normal with mean 0 and deviation 1 (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(uniform(key, 2 * counter)))
    return radius * math.cos(2.0 * math.pi * uniform(key, 2 * counter + 1))


@inlined
def read(
    i: int, k: int, speed: float, radius: float, now: float, interval: float, noise: float, state: TachometerState,
    t: TachometerConstants, active: Active,
) -> None:  # fmt: skip
    """Read the sensor of axle k, whose wheel turns with `speed` [rad/s], at the end of a control interval.

    New edges since the last reading: their number over the time they took. None: what the next edge could at most mean.
    """
    angle = state.angle[i, k]
    edge = math.floor(angle / t.pulse_angle + 1e-12) * t.pulse_angle
    passed = edge - state.edge_angle[i, k]
    if passed > 0.5 * t.pulse_angle:
        beyond = angle - edge
        since = min(beyond / speed, interval) if speed * interval > beyond else interval
        moment = now - since
        clean = passed / max(moment - state.edge_time[i, k], 1e-9)
        state.edge_angle[i, k] = edge
        state.edge_time[i, k] = moment
    else:
        clean = min(state.counted[i, k], t.pulse_angle / max(now - state.edge_time[i, k], 1e-9))
    last = state.counted[i, k]
    state.counted[i, k] = clean
    factor = reading_factor(active, k, radius * clean, now)
    clean = reading(active, factor * clean, state.filtered[i, k], factor * last, interval)
    state.filtered[i, k] = clean
    state.measured[i, k] = max(clean + (noise if clean > 0.0 else 0.0), 0.0)
