"""A slip without its sensor's noise: noise goes, what the wheel did stays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.signal import savgol_filter

from wsp_env.diagnosis.denoise import WINDOWS_S, denoised
from wsp_env.diagnosis.stops import wheel_filter

STEP_S = 0.01
TIME = np.arange(0.0, 20.0, STEP_S)
DEVIATION = 0.02  # [m/s]
SLOW = 0.5 + 0.2 * np.sin(0.3 * TIME)[:, None]
#: A protection that acts: the wheel slides away and comes back within half a second, again and again.
FAST = SLOW + 1.5 * np.maximum(np.sin(2.0 * np.pi * TIME / 0.8), 0.0)[:, None] ** 2


def recorded(slip, seed, raw_step=STEP_S):
    """Return a slip with noise, as filtered and thinned."""
    stride = round(STEP_S / raw_step)
    raw = np.repeat(slip, stride, axis=0) + np.random.default_rng(seed).normal(0.0, DEVIATION, (len(slip) * stride, 1))
    weights = wheel_filter(raw_step)
    return savgol_filter(raw, len(weights), 2, axis=0)[stride // 2 :: stride]


def cleaned(slip, deviation=DEVIATION, share=1.0, raw_step=STEP_S):
    return denoised(slip, np.full(slip.shape, share), deviation, wheel_filter(raw_step), STEP_S, raw_step)


def shortest(slip):
    return savgol_filter(slip, 2 * round(0.5 * WINDOWS_S[0] / STEP_S) + 1, 3, axis=0)


def rate_error(slip, true):
    return float(np.std(np.gradient(slip - true, STEP_S, axis=0)))


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=25)
@pytest.mark.parametrize("raw_step", [0.01, 0.002])
def test_a_wheel_that_hardly_changes_loses_most_of_the_noise_of_its_rate(raw_step, seed):
    slip = recorded(SLOW, seed, raw_step)
    assert rate_error(cleaned(slip, raw_step=raw_step), SLOW) < 0.5 * rate_error(shortest(slip), SLOW)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=25)
def test_a_wheel_under_a_protection_that_acts_keeps_what_it_does(seed):
    """It loses next to nothing: what goes is the share of noise in what changes."""
    slip = recorded(FAST, seed)
    assert rate_error(cleaned(slip), FAST) < 1.05 * rate_error(shortest(slip), FAST)


@pytest.mark.parametrize(("deviation", "share"), [(0.0, 1.0), (DEVIATION, 0.0)])
def test_without_noise_of_the_sensor_nothing_is_taken_away(deviation, share):
    slip = recorded(FAST, 3)
    assert_allclose(cleaned(slip, deviation, share), shortest(slip), atol=1e-12)


def test_noise_beyond_all_that_changes_leaves_the_longest_smoothing():
    slip = recorded(SLOW, 5)
    longest = savgol_filter(slip, 2 * round(0.5 * WINDOWS_S[-1] / STEP_S) + 1, 3, axis=0)
    assert_allclose(cleaned(slip, 1e3), longest, atol=1e-12)
