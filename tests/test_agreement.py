"""Whether runs agree on a mechanism's size: with what they were made of, and with Student's t."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from wsp_env.diagnosis import agreement as module
from wsp_env.diagnosis.agreement import AGREED, Agreement, agreement
from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.gls import Projector


def test_runs_that_agree_are_evidence_and_runs_that_do_not_are_none():
    same = Agreement(np.array([0.9, 1.1, 1.0, 1.05, 0.95]), np.full(5, 0.2))
    other = Agreement(np.array([4.0, -2.0, 1.0, 3.0, -1.0]), np.full(5, 0.2))
    assert same.evidence > AGREED > other.evidence


@given(st.integers(3, 12), st.integers(0, 1000))
def test_with_equal_shares_it_is_the_likelihood_ratio_of_a_t_test(runs, seed):
    multiples = 1.0 + np.random.default_rng(seed).standard_normal(runs)
    t = stats.ttest_1samp(multiples, 0.0).statistic
    found = Agreement(multiples, np.full(runs, 1.0 / runs))
    assert found.several == pytest.approx(runs)
    assert found.evidence == pytest.approx(0.5 * runs * np.log1p(t**2 / (runs - 1)))


def test_one_run_that_says_all_tells_no_scatter():
    assert Agreement(np.array([1.0, 3.0]), np.array([0.97, 0.03])).evidence == np.inf


@pytest.mark.parametrize(("sizes", "agrees"), [((1.0,) * 6, True), ((5.0, -3.0, 6.0, -4.0, 5.0, -3.0), False)])
def test_every_run_gives_its_own_size(monkeypatch, sizes, agrees):
    """Six runs of an effect x that is larger or smaller by run; a nuisance takes a part that x does not have."""
    rng = np.random.default_rng(3)
    runs, each = len(sizes), 200
    run = np.repeat(np.arange(runs), each)
    x, nuisance = rng.standard_normal((2, runs * each))
    y = np.array(sizes)[run] * x + nuisance + 0.05 * rng.standard_normal(len(x))
    weights = Weights(
        Whitening(np.ones(len(x)), ()), np.ones(len(x)), Projector(nuisance[:, None] * 10.0, np.ones(1, dtype=bool))
    )

    class Replica:
        axles = 4
        rows = type("Rows", (), {"run": run, "axle": np.zeros(len(x), dtype=int)})

        @staticmethod
        def raw(off: bool) -> np.ndarray:
            return y if off else y - x

    monkeypatch.setattr(module, "without", lambda model, variant: True)
    monkeypatch.setattr(module, "law_columns", lambda replica, model, base: np.ones((len(base), 1)))
    found = agreement(Replica(), False, None, weights)
    assert found.multiples == pytest.approx(np.array(sizes), rel=0.03, abs=0.05)
    assert found.shares == pytest.approx(np.full(runs, 1.0 / runs), abs=0.05)
    assert (found.evidence > AGREED) == agrees
