"""Wheel-speed sensors: a pulse wheel read by counting edges and timing the last one, with noise."""

import math

import numpy as np

from wsp_env.compiled import inlined, kernel
from wsp_env.plant.mechanisms import clock_offset, wheel_speed_lag
from wsp_env.plant.state import Conditions, Constants, State

# SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): a good hash of a counter. The noise of a stop is a function of its key (drawn
# from the environment's own generator) and of the time, so it does not depend on the batch that the stop is computed in.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


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
def read_tachometers(i: int, state: State, c: Conditions, p: Constants) -> None:
    """Update the measured wheel speeds [rad/s] and the recorded speed [m/s] of vehicle i.

    New edges since the last reading: their number over the time they took. None: what the next edge could at most mean.
    """
    axles = state.wheel_speed.shape[1]
    state.recorded_speed[i] = clock_offset.recorded(p.mechanisms.clock_offset, state.speed[i], -state.deceleration[i])
    now = state.time[i]
    interval = p.substep * p.substeps
    step = round(now / interval)
    for k in range(axles):
        angle = state.angle[i, k]
        edge = math.floor(angle / p.pulse_angle + 1e-12) * p.pulse_angle
        passed = edge - state.edge_angle[i, k]
        speed = state.wheel_speed[i, k]
        if passed > 0.5 * p.pulse_angle:
            beyond = angle - edge
            since = min(beyond / speed, interval) if speed * interval > beyond else interval
            moment = now - since
            clean = passed / max(moment - state.edge_time[i, k], 1e-9)
            state.edge_angle[i, k] = edge
            state.edge_time[i, k] = moment
        else:
            clean = min(state.counted[i, k], p.pulse_angle / max(now - state.edge_time[i, k], 1e-9))
        last = state.counted[i, k]
        state.counted[i, k] = clean
        clean = wheel_speed_lag.reading(p.mechanisms.wheel_speed_lag, state.filtered[i, k], last, clean, interval)
        state.filtered[i, k] = clean
        noise = c.noise[i] * normal(c.key[i], step * axles + k) if clean > 0.0 and c.noise[i] > 0.0 else 0.0
        state.measured[i, k] = max(clean + noise, 0.0)
