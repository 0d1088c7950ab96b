"""What runs leave of an evidence: with what they were made of, with generalised least squares, with Student's t."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from wsp_env.diagnosis import agreement as module
from wsp_env.diagnosis.agreement import BELIEVED, Agreement, agreement
from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.gls import Projector

RUNS, EACH, SIZE_OF_NUISANCE = 6, 200, 10.0


class Replica:
    """Six runs whose residual is y with a mechanism off, y - x with it on."""

    stops = range(RUNS)

    def __init__(self, y: np.ndarray, x: np.ndarray) -> None:
        self.y, self.x = y, x
        self.rows = type("Rows", (), {"run": np.repeat(np.arange(RUNS), EACH)})

    def raw(self, off: bool) -> np.ndarray:
        return self.y if off else self.y - self.x


@pytest.fixture
def asked(monkeypatch):
    """What is said of an effect x in a residual y, beside a nuisance; of the law nothing is free."""
    monkeypatch.setattr(module, "without", lambda model, variant: True)
    monkeypatch.setattr(module, "law_columns", lambda replica, model, base: np.zeros((len(base), 1 + RUNS)))

    def ask(y: np.ndarray, x: np.ndarray, nuisance: np.ndarray) -> Agreement:
        one = Replica(y, x)
        projector = Projector(nuisance[:, None] * SIZE_OF_NUISANCE, np.ones(1, dtype=bool), one.rows.run)
        return agreement(one, False, None, Weights(Whitening(np.ones(len(x)), ()), np.ones(len(x)), projector))

    return ask


@given(st.integers(2, 12), st.floats(0.0, 400.0), st.floats(0.0, 50.0))
def test_with_the_unknown_factor_integrated_out_it_is_the_ratio_of_the_two_likelihoods(runs, evidence, missed):
    """Of a size free and of none, with an inverse chi-square belief about the factor, by quadrature."""
    found = Agreement(1.0 + np.full(runs, np.sqrt(missed / runs)), np.ones(runs), np.full(runs, 1.0 / runs))
    log_factor = np.linspace(-10.0, 15.0, 2001)
    belief = stats.invgamma(BELIEVED / 2.0, scale=BELIEVED / 2.0).logpdf(np.exp(log_factor)) + log_factor

    def likelihood(squares: float) -> float:
        """Of one more observation, of the common size, beside those of the runs."""
        value = belief - 0.5 * (runs + 1) * log_factor - 0.5 * squares / np.exp(log_factor)
        return float(value.max() + np.log(integrate.trapezoid(np.exp(value - value.max()), log_factor)))

    expected = likelihood(missed) - likelihood(missed + 2.0 * evidence)
    assert found.left_of(evidence) == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_many_runs_that_agree_leave_the_evidence_and_runs_that_do_not_take_it():
    many = Agreement(np.full(10_000, 1.0) + np.tile([-0.1, 0.1], 5000), np.full(10_000, 100.0), np.full(10_000, 1e-4))
    assert many.left_of(20.0) == pytest.approx(20.0, rel=0.01)
    scattered = Agreement(np.array([-1.2, 1.3, 6.2, -4.1, 0.7]), np.full(5, 17.0), np.full(5, 0.2))
    assert scattered.left_of(50.0) < 2.0


def test_a_run_counts_as_much_as_it_weighs_in_the_common_size():
    """The variance of a weighted mean of runs whose errors have factors of their own, over that without these."""
    variance, factor = np.array([1.0, 2.0, 20.0]), np.array([1.0, 1.0, 9.0])
    weight = (1.0 / variance) / (1.0 / variance).sum()
    rng = np.random.default_rng(2)
    runs = 1.0 + rng.standard_normal((20_000, 3)) * np.sqrt(variance * factor)
    expected = 3.0 * np.var(runs @ weight) * (1.0 / variance).sum()
    # About the common size as it is, of which an estimate would take a part.
    assert np.mean([Agreement(one, 1.0 / variance, weight).missed for one in runs]) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("sizes", [(1.0,) * 6, (5.0, -3.0, 6.0, -4.0, 5.0, -3.0)])
def test_every_run_gives_its_own_size(asked, sizes):
    """An effect x that is larger or smaller by run; a nuisance takes a part that x does not have."""
    rng = np.random.default_rng(3)
    run = np.repeat(np.arange(RUNS), EACH)
    x, nuisance = rng.standard_normal((2, len(run)))
    y = np.array(sizes)[run] * x + nuisance + rng.standard_normal(len(run))
    found = asked(y, x, nuisance)
    assert found.multiples == pytest.approx(np.array(sizes), abs=4.0 / np.sqrt(EACH))
    assert (found.misses.mean() > 10.0) == (sizes[1] < 0.0)


def test_a_run_alone_is_generalised_least_squares(asked):
    """What a run says does not depend on the others, whose nuisance is another draw there."""
    rng = np.random.default_rng(4)
    x, nuisance, y = rng.standard_normal((3, RUNS * EACH))
    x += nuisance  # which the nuisance may stand in for
    found = asked(y, x, nuisance)
    for run in range(RUNS):
        mine = slice(run * EACH, (run + 1) * EACH)
        weight = np.linalg.inv(np.eye(EACH) + SIZE_OF_NUISANCE**2 * np.outer(nuisance[mine], nuisance[mine]))
        information = float(x[mine] @ weight @ x[mine])
        assert found.information[run] == pytest.approx(information, rel=1e-9)
        assert found.multiples[run] == pytest.approx(float(x[mine] @ weight @ y[mine]) / information, rel=1e-6, abs=1e-9)


def test_a_run_that_says_nothing_is_not_asked(asked):
    rng = np.random.default_rng(5)
    x, nuisance, y = rng.standard_normal((3, RUNS * EACH))
    x[: 3 * EACH] *= 1e-3
    assert len(asked(y, x, nuisance).multiples) == RUNS - 3
