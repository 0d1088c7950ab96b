"""The colour of friction's noise: series of known autocovariance, what nuisances take away, and the bias that it ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from wsp_env.diagnosis.balances import ADHESION, Rows, Whitening
from wsp_env.diagnosis.colour import Moments, autocorrelation, autoregression, moments, stretches, whitening_filter
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.variation import Group

BOUNCING = np.array([0.9, -0.6])  # swings once in seven rows

reflections = st.lists(st.floats(-0.8, 0.8), min_size=1, max_size=4)


def coefficients_of(reflection: list[float]) -> np.ndarray:
    """Any stationary autoregression has reflections below 1."""
    found = np.zeros(0)
    for one in reflection:
        found = np.append(found - one * found[::-1], one)
    return found


def series(rng: np.random.Generator, coefficients: np.ndarray, length: int) -> np.ndarray:
    """A stationary series of variance 1."""
    covariance = linalg.toeplitz(autocorrelation(coefficients, length - 1))
    return linalg.cholesky(covariance, lower=True) @ rng.standard_normal(length)


def rows_of(run: np.ndarray, axle: np.ndarray, time: np.ndarray, slides: np.ndarray) -> Rows:
    zero = np.zeros(len(run))
    return Rows(
        balance=np.full(len(run), ADHESION), slides=slides, run=run, axle=axle, segment=zero - 1, validate=zero > 0.0,
        time=time, place=zero, speed=zero + 20.0, slip=np.where(slides, 5.0, 0.0), work=zero, deceleration=zero,
    )  # fmt: skip


@given(reflections)
def test_autocorrelations_are_those_of_the_series_response(reflection):
    coefficients = coefficients_of(reflection)
    # The slowest of these dies out by 0.9997 a sample.
    response = signal.lfilter([1.0], np.concatenate([[1.0], -coefficients]), np.eye(1, 100_000)[0])
    expected = np.array([response[lag:] @ response[: len(response) - lag] for lag in range(8)])
    assert autocorrelation(coefficients, 7) == pytest.approx(expected / expected[0], abs=1e-6)


@given(reflections)
def test_an_autoregression_is_found_from_its_autocovariances(reflection):
    coefficients = coefficients_of(reflection)
    found = autoregression(Moments(3.0 * autocorrelation(coefficients, 6), 10**9))
    assert autocorrelation(found, 6) == pytest.approx(autocorrelation(coefficients, 6), abs=1e-3)


def test_white_noise_and_what_is_no_series_have_no_colour():
    rng = np.random.default_rng(0)
    found = [autoregression(Moments(np.array([1.0, *(rng.standard_normal(6) / 40.0)]), 1600)) for _ in range(200)]
    assert np.mean([len(one) > 0 for one in found]) < 0.05  # Schwarz: log(1600) = 7.4 is beyond 2.7 deviations
    assert len(autoregression(Moments(np.array([1.0, 1.2, 0.3]), 100))) == 0
    assert len(autoregression(Moments(np.zeros(7), 0))) == 0


@given(reflections, st.integers(0, 100))
@settings(deadline=None)
def test_the_filter_is_the_root_of_the_inverse_covariance(reflection, seed):
    rng = np.random.default_rng(seed)
    coefficients = coefficients_of(reflection)
    order = rng.permutation(12)
    parts = [np.sort(order[:7]), np.sort(order[7:10])]
    whole = np.eye(12)
    for part in parts:
        whole[np.ix_(part, part)] = linalg.toeplitz(autocorrelation(coefficients, len(part) - 1))
    root = whitening_filter(coefficients, parts, 12)
    assert root @ whole @ root.T == pytest.approx(np.eye(12), abs=1e-6)
    white, raw = Whitening(np.full(12, 2.0), (), root), rng.standard_normal(12)
    assert white.back(white(raw)) == pytest.approx(raw, abs=1e-6)
    assert white.plain(white(raw)) == pytest.approx(raw / 2.0, abs=1e-6)


def test_stretches_end_where_a_wheel_rolls_or_a_block_is_missing():
    axle, time = np.tile([0, 1], 8), np.repeat(np.arange(8) * 0.16, 2)
    slides = np.ones(16, dtype=bool)
    slides[6] = False  # axle 0, fourth block
    kept = np.delete(np.arange(16), 9)  # axle 1, fifth block
    found = stretches(rows_of(np.zeros(15, dtype=int), axle[kept], time[kept], slides[kept]))
    blocks = [(axle[kept][part[0]], tuple(np.round(time[kept][part] / 0.16).astype(int))) for part in found]
    assert blocks == [(0, (0, 1, 2)), (0, (4, 5, 6, 7)), (1, (0, 1, 2, 3)), (1, (5, 6, 7))]


def test_what_nuisances_took_away_is_given_back():
    """A free level and line of every stretch, and a common column, take slow parts of the noise."""
    rng = np.random.default_rng(2)
    runs, length = 60, 24
    run, time = np.repeat(np.arange(runs), length), np.tile(np.arange(length), runs) * 0.16
    y = np.concatenate([series(rng, BOUNCING, length) for _ in range(runs)])
    own = np.kron(np.eye(runs), np.column_stack([np.ones(length), np.linspace(-1.0, 1.0, length)]))
    common = np.tile(np.linspace(-1.0, 1.0, length) ** 2, runs)[:, None]
    rows = rows_of(run, np.zeros_like(run), time, np.ones(len(run), dtype=bool))
    balances = SimpleNamespace(rows=rows, stops=range(runs))
    plain, nothing = Whitening(np.ones(len(y)), ()), np.zeros((len(y), 0))
    groups = [Group("level", own, 3.0, True), Group("common", common, 1.0, True)]
    evidence = Evidence(balances, plain, groups, y, nothing)
    found = moments(evidence, Sizes(np.ones(2), np.ones(5)), stretches(rows))
    # The definition, from dense matrices.
    z = np.column_stack([3.0 * own, common])
    covariance = np.linalg.inv(np.eye(z.shape[1]) + z.T @ z)
    left = y - z @ covariance @ z.T @ y
    second = np.outer(left, left) + z @ covariance @ z.T
    expected = [
        sum(np.trace(second[i * length : (i + 1) * length, i * length : (i + 1) * length], lag) for i in range(runs)) / len(y)
        for lag in range(len(found.covariance))
    ]
    assert found.covariance == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert autoregression(found) == pytest.approx(BOUNCING, abs=0.1)


def test_friction_that_swings_and_turns_the_wheel_is_no_falling_friction():
    """Friction swings, a wheel's slip integrates brake less friction, and a regression of friction on slip finds a slope.

    Freed from what goes on from row to row it finds the true one.
    """
    rng = np.random.default_rng(3)
    runs, length, wandering = 40, 60, np.array([0.8])
    for true in (0.0, -0.3):
        x, y, parts = [], [], []
        for run in range(runs):
            noise = series(rng, wandering, length)
            brake, slip = 0.0, 0.0
            for i in range(length):
                x.append(slip)
                y.append(true * slip + noise[i])
                brake = 0.97 * brake + 0.1 * rng.standard_normal()
                slip += 0.3 * (brake - 0.5 * slip - noise[i])
            parts.append(np.arange(run * length, (run + 1) * length))
        rows, values = np.array(x), np.array(y)
        root = whitening_filter(wandering, parts, len(rows))
        freed, of = root @ rows, root @ values
        assert rows @ values / (rows @ rows) - true < -0.3
        assert abs(freed @ of / (freed @ freed) - true) < 3.0 / np.linalg.norm(freed)
