"""Least squares with nuisances against the plain augmented problem and estimates."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.gls import Projector, fit
from wsp_env.diagnosis.locate import change_points
from wsp_env.diagnosis.net import net_by_run
from wsp_env.diagnosis.search import held_out_rows
from wsp_env.diagnosis.triangular import inverse_of


def augmented_cost(columns: np.ndarray, prior: np.ndarray, y: np.ndarray) -> float:
    """Smallest sum of squares, by rows that say 0 +- 1 for every nuisance with a prior."""
    rows = np.flatnonzero(prior)
    extra = np.zeros((len(rows), columns.shape[1]))
    extra[np.arange(len(rows)), rows] = 1.0
    a, b = np.vstack([columns, extra]), np.concatenate([y, np.zeros(len(rows))])
    best = np.linalg.lstsq(a, b, rcond=None)[0]
    return float(((b - a @ best) ** 2).sum())


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 4))
def test_projection_is_the_augmented_least_squares(seed, nuisances, wanted):
    rng = np.random.default_rng(seed)
    z, x, y = rng.standard_normal((40, nuisances)), rng.standard_normal((40, wanted)), rng.standard_normal(40)
    prior = rng.random(nuisances) < 0.5
    projector = Projector.of(z, prior)
    cost = float(projector.inner(y[:, None], y[:, None])[0, 0])
    assert cost == pytest.approx(augmented_cost(z, prior, y), rel=1e-9)
    found = fit(projector.inner(x, x), projector.inner(x, y[:, None])[:, 0])
    together = augmented_cost(np.column_stack([z, x]), np.concatenate([prior, np.zeros(wanted, dtype=bool)]), y)
    assert cost - found.reduction == pytest.approx(together, rel=1e-7, abs=1e-9)
    assert projector.rest(y) == pytest.approx(y - z @ projector.amplitudes(y))


@given(st.integers(0, 10_000), st.floats(-2.0, 9.0))
def test_a_nuisance_is_taken_out_again_however_well_it_is_known(seed, power):
    """Where rounding cannot tell its variance after the rows from none, it may stay; nothing is refused.

    Just above that, rounding is some tenth of the variance (6 % at most in 6000 draws).
    """
    rng = np.random.default_rng(seed)
    z, x, y = rng.standard_normal((40, 3)), 10.0**power * rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    both, alone = (Projector.of(one, np.ones(one.shape[1], dtype=bool)) for one in (np.column_stack([z, x]), z))
    least, most = float(both.inner(y, y)[0, 0]), float(alone.inner(y, y)[0, 0])
    found = float(both.without(x).inner(y, y)[0, 0])
    assert least * (1.0 - 1e-6) <= found <= most + 0.2 * (most - least) + 1e-6 * most
    if power < 2.5:
        assert found == pytest.approx(most, rel=1e-3)


@given(st.integers(0, 10_000), st.integers(1, 8))
def test_an_inverse_by_its_factor_is_the_inverse(seed, size):
    root = np.random.default_rng(seed).standard_normal((size, size + 2))
    matrix = root @ root.T + np.eye(size)
    found = inverse_of(linalg.cho_factor(matrix, lower=True)[0])
    assert found @ matrix == pytest.approx(np.eye(size), abs=1e-9)


def test_a_column_that_the_nuisances_span_explains_nothing():
    rng = np.random.default_rng(0)
    z, y = rng.standard_normal((50, 3)), rng.standard_normal(50)
    projector = Projector.of(z, np.zeros(3, dtype=bool))
    x = z[:, :1] * 2.0
    squares = (x**2).sum(axis=0)
    assert fit(projector.inner(x, x), projector.inner(x, y[:, None])[:, 0], squares).reduction == pytest.approx(0.0, abs=1e-6)


def rows_of(run, validate, time):
    """Rows of which only run, group and time are looked at."""
    names = [field.name for field in dataclasses.fields(Rows)]
    return Rows(**dict.fromkeys(names, np.zeros(len(run))) | {"run": run, "validate": validate, "time": time})


def test_what_is_held_out_with_a_validate_group_without_one_and_in_a_single_run():
    run, time = np.repeat(np.arange(4), 30), np.tile(np.linspace(0.0, 30.0, 30), 4)
    group, none = run >= 3, np.zeros(120, dtype=bool)
    assert (held_out_rows(rows_of(run, group, time)) == group).all()
    assert set(run[held_out_rows(rows_of(run, none, time))]) == {1, 3}
    alone = held_out_rows(rows_of(np.zeros(120, dtype=int), none, time))
    assert 0.3 < alone.mean() < 0.7
    assert np.abs(np.diff(alone[:30].astype(int))).sum() >= 4  # in turns, not one half and then the other


@given(st.floats(0.0, 0.7), st.floats(0.1, 0.25), st.integers(0, 1000))
def test_change_points_are_where_a_mean_changes(start, length, seed):
    rng = np.random.default_rng(seed)
    values = rng.permutation(np.linspace(0.0, 1.0, 400))
    inside = (values > start) & (values < start + length)
    low, high, contrast, share = change_points(values, 10.0 * inside + rng.normal(0.0, 0.5, 400))
    assert (low, high) == pytest.approx((start, start + length), abs=0.02)
    assert contrast == pytest.approx(1.0 - inside.mean(), abs=0.1)
    assert share == pytest.approx(inside.mean(), abs=0.03)


def test_a_column_that_is_nothing_does_not_move():
    """What no row shows has no amplitude: rounding over nothing would be any number."""
    rng = np.random.default_rng(5)
    x, y = rng.standard_normal((50, 4)), rng.standard_normal(50)
    x[:, 2] = 0.0
    found = fit(x.T @ x, x.T @ y)
    assert found.amplitude[2] == 0.0
    others = np.delete(x, 2, axis=1)
    assert np.delete(found.amplitude, 2) == pytest.approx(np.linalg.lstsq(others, y, rcond=None)[0])


def test_what_acts_in_one_run_stays_in_it_beside_a_law_that_all_runs_share():
    """The law takes a tenth of the mean of a column from all rows."""
    run = np.repeat([0, 1, 4], 4)  # run 2 and 3 do not slide
    law = SimpleNamespace(net=lambda columns: (columns - 0.1 * columns.mean(axis=0), None))
    alone, shared, nothing = np.where(run == 1, 3.0, 0.0), np.where(run < 4, 3.0, 0.0), np.zeros(12)
    found = net_by_run(law, np.column_stack([alone, shared, nothing]), run)
    assert found[:, 0] == pytest.approx(np.where(run == 1, 2.9, 0.0))
    assert found[:, 1] == pytest.approx(shared - 0.2)
    assert not found[:, 2].any()
