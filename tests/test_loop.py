"""Friction that turns the wheel: what is known of a slip before a block of time begins."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from wsp_env.diagnosis.colour import Moments, autoregression, whitening_filter
from wsp_env.diagnosis.loop import predicted, prompt_gain, stretches
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
    return both_turned(stop, torque, holds, block)[1]


def both_turned(stop, torque, holds=0.0, block=BLOCK):
    """The same under the torques that were to be expected, then under the recorded ones."""
    holding, inertia = np.full((len(torque), 1), holds), np.array([INERTIA])
    return predicted(stop, sliding(stop), torque[:, None], holding, block, RADIUS, inertia)


def sliding(stop):
    """Where (T, 1) the wheel slides: above 1 % of 20 m/s."""
    return stop.speed[:, None] - RADIUS * stop.wheel > 0.2


def told(stop, torque, holds=0.0, block=BLOCK):
    """The slips (T,) that are foreseen at recorded torques (T,)."""
    seen = turned(stop, torque, holds, block)
    return seen.speed - RADIUS * seen.wheel[:, 0]


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_a_wheel_that_is_heavier_is_turned_less_by_the_same_torque(share):
    n = 10 * BLOCK
    stop = slid(np.full(n, 4.0), np.full(n, 3000.0))
    torque = np.full(n, 3000.0)
    torque[6 * BLOCK :] += 400.0

    def moved(inertia):
        seen = predicted(stop, sliding(stop), torque[:, None], np.zeros((n, 1)), BLOCK, RADIUS, np.array([inertia]))[1]
        return seen.wheel - stop.wheel

    assert np.abs(moved(INERTIA)).max() > 0.1
    assert_allclose(moved(share * INERTIA), moved(INERTIA) / share, atol=1e-9)


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


def test_where_friction_falls_steeply_the_wheel_locks_and_no_motion_grows_beyond_all_limits():
    """A motion that grows e-fold within a millisecond: within a block, by a factor of 10^69."""
    slip, law = np.full(100, 1.0), np.full(100, 2000.0)
    stop = slid(slip, law)
    seen = turned(stop, law + 100.0, holds=-1000.0 * INERTIA / RADIUS)
    assert (seen.wheel >= 0.0).all()
    assert np.abs(seen.wheel_rate).max() <= np.abs(stop.wheel_rate).max() + 2.0 * stop.speed[0] / (RADIUS * STEP)
    assert np.isfinite(seen.wheel_jerk).all()


def test_a_wheel_that_begins_to_slide_is_left_and_none_is_foreseen_to_roll():
    slip, law = np.full(40, 1.0), np.full(40, 2000.0)
    slip[10] = 0.01  # rolls for a moment, in the second block
    seen = told(slid(slip, law), law - 3e4)
    assert_allclose(seen[:24], slip[:24])
    assert seen[24:32].max() < 1.0
    assert seen[24:32].min() == pytest.approx(0.2)  # where sliding ends, at 1 % of 20 m/s


def test_a_wheel_at_the_knee_of_its_curve_is_foreseen_too_and_no_slower_than_it_ever_slides():
    """At 0.1 m/s, half of what sliding begins at by its slip alone."""
    slip, law = np.full(40, 0.1), np.full(40, 2000.0)
    slip[35] = 0.08
    stop = slid(slip, law)
    flat, none = np.ones((40, 1), dtype=bool), np.zeros((40, 1), dtype=bool)
    foreseen, left = (
        predicted(stop, slides, law[:, None] - 3e4, np.zeros((40, 1)), BLOCK, RADIUS, np.array([INERTIA]))[1]
        for slides in (flat, none)
    )
    assert_allclose(left.wheel, stop.wheel)
    assert (foreseen.speed - RADIUS * foreseen.wheel[:, 0])[8:].min() == pytest.approx(0.08)


def test_a_torque_that_stays_is_what_was_to_be_expected():
    law = np.full(80, 2000.0)
    stop = slid(np.full(80, 1.0), law)
    expected, recorded = both_turned(stop, law)
    for seen in (expected, recorded):
        assert_allclose([seen.wheel, seen.wheel_rate], [stop.wheel, stop.wheel_rate])
    assert_allclose(expected.torque, stop.torque)


def test_under_the_torques_that_were_to_be_expected_the_law_holds():
    """Friction is flat, so that the law's torque on the wheel is the same at the slip that is foreseen as at that which was."""
    rng = np.random.default_rng(3)
    torque = 2000.0 + np.cumsum(rng.normal(0.0, 40.0, 400))
    stop = slid(rng.uniform(1.0, 1.5, 400), torque - rng.normal(0.0, 30.0, 400))
    expected, recorded = both_turned(stop, torque)
    assert_allclose(expected.torque + INERTIA * expected.wheel_rate, stop.torque + INERTIA * stop.wheel_rate)
    assert_allclose(recorded.torque, stop.torque)
    assert np.abs(expected.wheel - recorded.wheel).max() > 1e-3  # under other torques the wheel turns otherwise


def test_of_a_torque_that_goes_on_the_course_is_expected_and_of_one_that_jumps_it_is_not():
    n = 60 * BLOCK
    swings = 2000.0 + 300.0 * np.sin(2.0 * np.pi * STEP * np.arange(n) / 4.0)
    jumps = np.where(np.arange(n) < 31 * BLOCK, 2000.0, 2600.0)
    missed = []
    for torque in (swings, jumps):
        seen = both_turned(slid(np.full(n, 1.0), torque), torque)[0]
        missed.append(np.abs(seen.torque[:, 0] - torque).reshape(60, BLOCK).max(axis=1))
    stays = 300.0 * 2.0 * np.pi / 4.0 * 2 * BLOCK * STEP  # what would be missed at most, did one expect it to stay
    assert missed[0][3:].max() < 0.2 * stays
    assert missed[1][31:33].min() > 0.9 * 600.0  # in both blocks that are foreseen without it
    assert np.delete(missed[1], [31, 32]).max() < 0.1 * 600.0


@pytest.mark.parametrize("memory_s", [0.15, 0.5])
def test_the_slope_of_friction_over_slip_in_a_closed_loop(memory_s):
    """Friction is flat and swings by 2 % (an Ornstein-Uhlenbeck process); a device keeps the slip about 1 m/s.

    Regressed on the slip as it was, friction seems to fall, and on the wheel's rate as it was, to rise with it, whitened or
    not. On the slip that is foreseen under the expected torque it does not, and on the rate by a tenth at most.
    """
    slopes = np.array([_slopes(np.random.default_rng([7, i]), memory_s) for i in range(8)])
    mean, error = slopes.mean(axis=0), slopes.std(axis=0) / np.sqrt(len(slopes))
    assert mean[0] < -4.0 * error[0]  # as it was
    assert mean[2] > 4.0 * error[2]
    assert abs(mean[1]) < 3.0 * error[1]  # foreseen
    assert abs(mean[1]) < 0.5 * abs(mean[0])
    assert abs(mean[3]) < 0.1 * abs(mean[2])


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
    (seen, _), found = both_turned(stop, torque, block=block), []
    for values in (slip, seen.speed - RADIUS * seen.wheel[:, 0], stop.wheel_rate[:, 0], seen.wheel_rate[:, 0]):
        own = white @ (rows(values) - rows(values).mean())
        found.append(float(own @ (white @ friction) / (own @ own)))
    return found


def test_the_likelihood_of_the_motion_tells_the_law_that_made_it():
    """Friction fluctuates from block to block on a rising curve, and the wheel follows it.

    That friction does not depend on the slip at once leaves smaller residuals, and is wrong.
    """
    rng, steps = np.random.default_rng(2), 160
    step, inertia, radius, stiffness, brake = 0.16 / steps, 750.0, 0.6, 40e3, 6e3  # [s], [kg m2], [m], [N s/m], [N m]
    slip, forces, slips = brake / radius / stiffness, [], []
    for friction in 1.0 + 0.05 * rng.standard_normal(400):
        course = np.empty((steps, 2))
        for i in range(steps):
            force = friction * stiffness * slip
            course[i] = force, slip
            slip += step * radius / inertia * (brake - radius * force)
        force, mean = course.mean(axis=0)
        forces.append(force)
        slips.append(mean)
    law = np.array(forces) - stiffness * np.array(slips)
    slow = np.array(forces) - brake / radius
    assert slow.std() < 0.9 * law.std()
    gain = prompt_gain(np.array([radius * stiffness]), 0.16, radius, np.array([inertia]))[0]
    assert np.log(slow.std()) > np.log(law.std()) - np.log(gain) + 0.05


def test_a_wheel_that_follows_its_friction_has_the_gain_of_its_own_equation():
    damping, inertia, radius, block_s = 9e3, 750.0, 0.6, 0.16
    time = (np.arange(1000) + 0.5) * block_s / 1000
    less_slip = (radius * radius / inertia * 1.0 * time).mean()  # by 1 N more
    expected = 1.0 + damping / radius * less_slip
    assert prompt_gain(np.array([damping]), block_s, radius, np.array([inertia]))[0] == pytest.approx(expected)
    assert prompt_gain(np.array([0.0]), block_s, radius, np.array([inertia]))[0] == 1.0
    assert prompt_gain(np.array([-1e6]), block_s, radius, np.array([inertia]))[0] == 0.1
