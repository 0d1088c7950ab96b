"""Friction that turns the wheel: what is known of a slip before a block of time begins."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from wsp_env.diagnosis.colour import Moments, autoregression, whitening_filter
from wsp_env.diagnosis.loop import foreseen, stretches
from wsp_env.diagnosis.stops import BLOCK_S

RADIUS, INERTIA, STEP, BLOCK = 0.445, 160.0, 0.02, 8


class Rows:
    """The rows of one wheel in one run."""

    def __init__(self, slip: np.ndarray, slides: np.ndarray) -> None:
        n = len(slip)
        self.wheels, self.run, self.axle = np.ones(n, dtype=bool), np.zeros(n, dtype=int), np.zeros(n, dtype=int)
        self.slides, self.time, self.slip = slides, BLOCK_S * np.arange(n), slip

    def __len__(self) -> int:
        return len(self.slip)


def slid_stop(speed, wheel, torque, step=STEP):
    """A stop with the channels of one wheel, (T,) and (T, 1), and how fast it turns."""
    rate = np.gradient(wheel, step, axis=0)
    return Stop(step * np.arange(len(speed)), speed, wheel, rate, np.gradient(rate, step, axis=0), torque, step)


@dataclasses.dataclass(frozen=True)
class Stop:
    """The channels that are foreseen, and what they are foreseen by."""

    time: np.ndarray
    speed: np.ndarray
    wheel: np.ndarray
    wheel_rate: np.ndarray
    wheel_jerk: np.ndarray
    torque: np.ndarray
    step_s: float


def slid(slip, torque, speed=20.0):
    """A wheel of some slips (T,) whose law's friction needs torques (T,)."""
    n = len(slip)
    return slid_stop(np.full(n, speed), ((speed - slip) / RADIUS)[:, None], torque[:, None])


def turned(stop, torque, holds=0.0, block=BLOCK):
    """The stop as it is foreseen at recorded torques (T,)."""
    return foreseen(stop, torque[:, None], np.full((len(torque), 1), holds), block, RADIUS, INERTIA)


def told(stop, torque, holds=0.0, block=BLOCK):
    """The slips (T,) that are foreseen at recorded torques (T,)."""
    seen = turned(stop, torque, holds, block)
    return seen.speed - RADIUS * seen.wheel[:, 0]


def test_a_gap_parts_slides():
    slides = np.ones(40, dtype=bool)
    slides[15:17] = False
    assert [len(part) for part in stretches(Rows(np.full(40, 1.5), slides))] == [15, 23]


def test_where_the_law_holds_the_slip_is_as_it_was():
    rng = np.random.default_rng(1)
    stop = slid(rng.uniform(0.5, 3.0, 80), rng.uniform(1e3, 2e3, 80))
    seen = turned(stop, stop.torque[:, 0])
    assert_allclose([seen.wheel, seen.wheel_rate, seen.wheel_jerk], [stop.wheel, stop.wheel_rate, stop.wheel_jerk])


def test_what_friction_did_within_a_block_is_not_foreseen():
    """Friction is 100 N m less than the law's from the third block on: what that slows a wheel by is taken away."""
    law, lacks = np.full(48, 2000.0), np.where(np.arange(48) < 2 * BLOCK, 0.0, 100.0)
    slip = 1.0 + RADIUS / INERTIA * STEP * np.concatenate([[0.0], np.cumsum(lacks)[:-1]])
    seen = told(slid(slip, law), law - lacks)
    for first in (2 * BLOCK, 3 * BLOCK):  # it begins a block earlier
        assert_allclose(seen[first : first + BLOCK], slip[first - BLOCK])
    assert_allclose(seen[4 * BLOCK :], slip[4 * BLOCK :])  # by then it is known to go on


def test_where_the_creep_curve_is_steep_the_wheel_is_brought_back():
    """Torque of 100 N m too little, held by 5000 N m for each m/s: at most 0.02 m/s are foreseen."""
    slip, law = np.full(100, 1.0), np.full(100, 2000.0)
    seen = told(slid(slip, law), law + 100.0, holds=5000.0, block=50)
    assert seen.max() == pytest.approx(1.0 + 100.0 / 5000.0, rel=2e-2)
    assert (np.diff(seen) >= 0.0).all()


def test_a_wheel_that_begins_to_slide_is_left_and_none_is_foreseen_to_roll():
    slip, law = np.full(40, 1.0), np.full(40, 2000.0)
    slip[10] = 0.01  # rolls for a moment, in the second block
    seen = told(slid(slip, law), law - 3e4)
    assert_allclose(seen[:24], slip[:24])
    assert seen[24:32].max() < 1.0
    assert seen[24:32].min() == pytest.approx(0.2)  # where sliding ends, at 1 % of 20 m/s


@pytest.mark.parametrize("memory_s", [0.15, 0.5])
def test_the_slope_of_friction_over_slip_in_a_closed_loop(memory_s):
    """Friction is flat and swings by 2 % (an Ornstein-Uhlenbeck process); a device keeps the slip about 1 m/s.

    Regressed on the slip as it was, friction seems to fall, and on the wheel's rate as it was, to rise with it, whitened or
    not. On the slip that is foreseen it does not, and on the rate by a sixth at most.
    """
    slopes = np.array([_slopes(np.random.default_rng([7, i]), memory_s) for i in range(8)])
    mean, error = slopes.mean(axis=0), slopes.std(axis=0) / np.sqrt(len(slopes))
    assert mean[0] < -4.0 * error[0]  # as it was
    assert mean[2] > 4.0 * error[2]
    assert abs(mean[1]) < 3.0 * error[1]  # foreseen
    assert abs(mean[1]) < 0.5 * abs(mean[0])
    assert abs(mean[3]) < 0.2 * abs(mean[2])


def _slopes(rng, memory_s, seconds=400.0, step=0.005):
    """Slopes of friction [of its mean] over slip [m/s] and over the wheel's rate [rad/s2], each as it was and as foreseen."""
    n, adhesion, load = round(seconds / step), 0.05, 105e3
    decay = np.exp(-step / memory_s)
    swing = lfilter([0.02 * np.sqrt(1.0 - decay**2)], [1.0, -decay], rng.standard_normal(n))
    slip, torque = np.empty(n), np.empty(n)
    s, c = 1.0, adhesion * load * RADIUS
    for i in range(n):  # valves: the torque falls fast above the slip that is wanted, and rises slowly below
        slip[i], torque[i] = s, c
        s = max(s + step * RADIUS / INERTIA * (c - RADIUS * adhesion * load * (1.0 + swing[i])), 0.3)
        c += step * (-3000.0 if s > 1.1 else 900.0 if s < 0.9 else 0.0)
    law = RADIUS * adhesion * load
    block = round(BLOCK_S / step)
    stop = slid_stop(np.full(n, 20.0), ((20.0 - slip) / RADIUS)[:, None], (torque - law * swing)[:, None], step)

    def rows(values):
        return values[: n // block * block].reshape(-1, block).mean(axis=1)

    friction = rows(swing)
    friction = friction - friction.mean()
    lags = 7
    covariance = np.array([np.mean(friction[lag:] * friction[: len(friction) - lag]) for lag in range(lags)])
    white = whitening_filter(autoregression(Moments(covariance, len(friction))), [np.arange(len(friction))], len(friction))
    seen, found = turned(stop, torque, block=block), []
    for values in (slip, seen.speed - RADIUS * seen.wheel[:, 0], stop.wheel_rate[:, 0], seen.wheel_rate[:, 0]):
        own = white @ (rows(values) - rows(values).mean())
        found.append(float(own @ (white @ friction) / (own @ own)))
    return found
