"""Matrices in which most columns concern one run alone, against the same matrices without blocks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsp_env.diagnosis.arrow import Arrow, ByRun, Eliminated, Order, combined
from wsp_env.diagnosis.gls import Projector

NUISANCES, SIDES = 9, 3


def columns_of(seed: int, runs: int = 3, each: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (n, 12) and runs (n,): two of each run alone, three common ones, three right-hand sides; in any order."""
    rng = np.random.default_rng(seed)
    run = rng.permutation(np.repeat(np.arange(runs), each))
    columns = rng.standard_normal((len(run), NUISANCES + SIDES))
    for one in range(runs):
        columns[run != one, 2 * one : 2 * one + 2] = 0.0
    columns[:, :NUISANCES] = columns[:, rng.permutation(NUISANCES)]
    return columns, run


def dense(order: Order, arrow: Arrow) -> np.ndarray:
    """Return the whole matrix in the order of the columns."""
    size = sum(map(len, order.own)) + len(order.common)
    whole = np.zeros((size, size))
    for mine, own, cross in zip(order.own, arrow.own, arrow.cross, strict=True):
        whole[np.ix_(mine, mine)] = own
        whole[np.ix_(mine, order.common)] = cross
        whole[np.ix_(order.common, mine)] = cross.T
    whole[np.ix_(order.common, order.common)] = arrow.common
    return whole


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=30)
def test_blocks_hold_all_inner_products(seed):
    columns, run = columns_of(seed)
    by_run = ByRun.of(columns[:, :-1], run).beside(columns[:, -1:])
    order = by_run.order(SIDES)
    assert [len(mine) for mine in order.own] == [2, 2, 2]
    assert dense(order, Arrow.of(by_run.parts(order), len(order.common))) == pytest.approx(columns.T @ columns)
    assert by_run.squares() == pytest.approx((columns**2).sum(axis=0))


@pytest.mark.parametrize("runs", [(0, 1, 2), (0, 2), ()])
def test_rows_and_runs_may_be_left_out(runs):
    columns, run = columns_of(2)
    keep = (np.arange(len(run)) % 3 > 0) & np.isin(run, runs)
    kept = ByRun.of(columns, run).kept(keep)
    order = kept.order(SIDES)
    assert dense(order, Arrow.of(kept.parts(order), len(order.common))) == pytest.approx(columns[keep].T @ columns[keep])


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=30)
def test_a_projector_is_that_of_the_whole_matrix_with_priors_and_without(seed):
    columns, run = columns_of(seed)
    prior = np.arange(columns.shape[1]) % 3 > 0
    projector = Projector.of(columns, prior, run)
    normal = columns.T @ columns + np.diag(np.where(prior, 1.0, 1e-9))
    y = np.random.default_rng(seed).standard_normal((len(columns), 3))
    best = np.linalg.solve(normal, columns.T @ y)
    assert projector.amplitudes(y) == pytest.approx(best, rel=1e-5, abs=1e-6)
    assert projector.amplitudes(y[:, 0]) == pytest.approx(best[:, 0], rel=1e-5, abs=1e-6)
    assert projector.inner(y, y[:, :2]) == pytest.approx(y.T @ (y - columns @ best)[:, :2], rel=1e-5, abs=1e-5)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_further_columns_beside_a_projector_are_as_if_they_had_been_in_it(seed):
    columns, run = columns_of(seed)
    prior = np.ones(columns.shape[1], dtype=bool)
    whole = Projector.of(columns, prior, run)
    bordered = Projector.of(columns[:, :-2], prior[:-2], run).beside(columns[:, -2:])
    y = np.random.default_rng(seed).standard_normal((len(columns), 3))
    assert bordered.logdet == pytest.approx(whole.logdet)
    assert bordered.inner(y, y[:, :2]) == pytest.approx(whole.inner(y, y[:, :2]))
    for one in (y, y[:, 0]):
        assert bordered.rest(one) == pytest.approx(whole.rest(one))
        assert bordered.amplitudes(one) == pytest.approx(whole.amplitudes(one))


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_columns_that_leave_a_projector_are_as_if_they_had_not_been_in_it(seed):
    columns, run = columns_of(seed)
    prior = np.ones(columns.shape[1], dtype=bool)
    left = Projector.of(columns, prior, run).without(columns[:, -2:])
    expected = Projector.of(columns[:, :-2], prior[:-2], run)
    y = np.random.default_rng(seed).standard_normal((len(columns), 3))
    assert left.logdet == pytest.approx(expected.logdet)
    assert left.inner(y, y[:, :2]) == pytest.approx(expected.inner(y, y[:, :2]))
    for one in (y, y[:, 0]):
        assert left.rest(one) == pytest.approx(expected.rest(one))
        found = left.amplitudes(one)
        assert found[:-4] == pytest.approx(expected.amplitudes(one))
        assert found[-4:-2] == pytest.approx(-found[-2:])


def test_the_last_columns_stay_whole_even_if_they_concern_one_run():
    columns, run = columns_of(1)
    columns[run != 0, -SIDES:] = 0.0
    order = ByRun.of(columns, run).order(SIDES)
    assert set(range(NUISANCES, NUISANCES + SIDES)) <= set(order.common)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=30)
def test_solution_inverse_and_rest_are_those_of_the_whole_matrix(seed):
    columns, run = columns_of(seed)
    by_run = ByRun.of(columns, run)
    order = by_run.order(SIDES)
    own = [np.full(len(mine), 0.5 + i) for i, mine in enumerate(order.own)]
    common = np.append(np.full(len(order.common) - SIDES, 1.7), np.ones(SIDES))
    every_second = np.arange(len(run)) % 2 == 0
    half = [Arrow.of(by_run.parts(order), len(order.common), keep) for keep in (every_second, ~every_second)]
    arrow = combined(half, np.array([2.0, 0.25])).scaled(own, common)
    whole = dense(order, arrow)
    solved = Eliminated(arrow, len(order.common) - SIDES)

    nuisances = np.arange(NUISANCES)
    normal = whole[:NUISANCES, :NUISANCES] + np.eye(NUISANCES)
    inverse = np.linalg.inv(normal)
    units, unit = solved.solution(len(order.common) - 1)
    expected = inverse @ whole[:NUISANCES, -1]
    for mine, one in zip((*order.own, order.common[:-SIDES]), (*units, unit), strict=True):
        assert one == pytest.approx(expected[mine], abs=1e-10)

    found = solved.inverse()
    c = order.common[:-SIDES]
    for mine, block, cross in zip(order.own, found.own, found.cross, strict=True):
        assert block == pytest.approx(inverse[np.ix_(mine, mine)], abs=1e-10)
        assert cross == pytest.approx(inverse[np.ix_(mine, c)], abs=1e-10)
    assert found.common == pytest.approx(inverse[np.ix_(c, c)], abs=1e-10)

    sides = np.arange(NUISANCES, NUISANCES + SIDES)
    across = whole[np.ix_(nuisances, sides)]
    left = whole[np.ix_(sides, sides)] - across.T @ inverse @ across
    k = len(c)
    mixed = solved.rest[:k, k:]
    assert solved.rest[k:, k:] - mixed.T @ found.common @ mixed == pytest.approx(left, abs=1e-9)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=20)
def test_inner_is_the_sum_over_all_entries(seed):
    columns, run = columns_of(seed)
    by_run = ByRun.of(columns, run)
    order = by_run.order(SIDES)
    one, other = (Arrow.of(every.parts(order), len(order.common)) for every in (by_run, ByRun.of(columns**3, run)))
    assert one.inner(other) == pytest.approx(np.sum(dense(order, one) * dense(order, other)))
