"""The variation of sound vehicles, tracks and recorders, which is no effect: its kinds and sizes, and one stop's draw of it.

Sizes are assumptions. All variation of a campaign together moves the length of a stop by less than `MOST_LENGTH` and its mean
slip by less than `MOST_SLIP_MPS`; a stop that moves more is drawn anew, up to six times.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from experiments.other_truth.records import Array, Sound

MOST_LENGTH, MOST_SLIP_MPS = 0.004, 0.05
GRID_S = 0.02  # between values of what varies in time
VARIED_S, TRACK_M = 180.0, 5000  # beyond these the last value stays


class Kind(NamedTuple):
    """Size of one kind of sound variation, and what it is a size of."""

    size: float
    of: str
    acts_on: str  # the stop itself, or its record


SOUND = {
    "pad_wander": Kind(0.003, "deviation of an axle's torque, over 4 s", "stop"),
    "rail_roughness": Kind(0.012, "deviation of mu_cd along the track, over some 8 m", "stop"),
    "axle_friction": Kind(0.009, "of mu_cd between axles, up to 1.7 times", "stop"),
    "wheel_bounce": Kind(0.012, "deviation of the wheel load, over 0.15 s", "stop"),
    "axle_loads": Kind(0.006, "of the static load between axles, up to 1.7 times", "stop"),
    "wind_gusts": Kind(70.0, "N, deviation, over 3 s", "stop"),
    "valve_scatter": Kind(0.06, "of fill and vent rates between axles, up to 1.7 times", "stop"),
    "track_waves": Kind(1.0e-4, "of gradient, three waves of 80 to 200 m", "stop"),
    "pressure_ripple": Kind(0.0025, "of the distributor pressure, at 0.1 to 0.4 Hz", "stop"),
    "radius_unlike": Kind(2.0e-4, "of the radius between axles, up to 1.7 times", "stop"),
    "tooth_eccentricity": Kind(0.0012, "of the wheel speed, once a turn, up to 1.7 times", "record"),
    "radar_spray": Kind(0.025, "m/s, deviation, over 0.15 s, with bursts of 0.08 m/s", "record"),
    "pressure_drift": Kind(0.003, "of pressure or torque over a stop, up to 1.5 times", "record"),
    "torque_gain": Kind(0.002, "deviation of pressure or torque from stop to stop", "record"),
    "time_jitter": Kind(0.06, "deviation, of the sample time", "record"),
    "coarse_counts": Kind(0.02, "rad/s a count, and 0.01 m/s", "record"),
}


def generator(seed: int) -> np.random.RandomState:
    """Return a generator whose numbers no later version of numpy changes."""
    return np.random.RandomState(seed % 2**32)


def wander(random: np.random.RandomState, length: int, deviation: float, steps: float) -> Array:
    """Return noise of first order (length,) that is correlated over some steps."""
    white = random.standard_normal(length + 1)[:length]
    keep = math.exp(-1.0 / steps)
    white[1:] *= math.sqrt(1.0 - keep * keep)
    noise: Array = deviation * lfilter([1.0], [1.0, -keep], white)
    return noise


def draw_sound(seed: int, stop: int, axles: int, kinds: list[str]) -> Sound:
    """Draw the variation of a stop of the campaign with a seed; kinds that are not named have no size."""
    size = {kind: SOUND[kind].size if kind in kinds else 0.0 for kind in SOUND}
    random = generator(seed * 1009 + stop)
    length = round(VARIED_S / GRID_S)
    gusts = wander(random, length, size["wind_gusts"], 3.0 / GRID_S)
    pads, bounce = np.zeros((axles, length)), np.zeros((axles, length))
    for j in range(axles):
        pads[j] = wander(random, length, size["pad_wander"], 4.0 / GRID_S)
        bounce[j] = wander(random, length, size["wheel_bounce"], 0.15 / GRID_S)
    scatter = np.random.default_rng((seed, 7, stop))
    frequency = scatter.uniform(0.1, 0.4)
    ripple = size["pressure_ripple"] * np.sin(2 * np.pi * frequency * GRID_S * np.arange(length) + scatter.uniform(0, 6))
    # The same axles and the same track for all stops.
    fixed = np.random.default_rng((seed, 5))
    between = fixed.uniform(-1.7, 1.7, (5, axles))
    between[:3] -= between[:3].mean(axis=1, keepdims=True)
    friction, loads, radius, valves, teeth = (
        size[kind] * values
        for kind, values in zip(
            ("axle_friction", "axle_loads", "radius_unlike", "valve_scatter", "tooth_eccentricity"), between, strict=True
        )
    )
    roughness, gradient = wander(generator(seed * 1009 + 500), TRACK_M, size["rail_roughness"], 8.0), np.zeros(TRACK_M)
    for _ in range(3):
        wave = fixed.uniform(80, 200)
        gradient += size["track_waves"] * np.sin(2 * np.pi * np.arange(float(TRACK_M)) / wave + fixed.uniform(0, 6))
    return Sound(friction, loads, radius, valves, teeth, gusts, ripple, pads, bounce, roughness, gradient)
