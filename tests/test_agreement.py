"""What parts leave of an evidence: with what they were made of, with generalised least squares, with Student's t."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from wsp_env.diagnosis import agreement as module
from wsp_env.diagnosis.agreement import PRIOR_DEGREES, Agreement, agreement
from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.weights import Weights

RUNS, EACH, SIZE_OF_NUISANCE = 6, 200, 10.0


class Replica:
    """Six runs, of some rows of which wheels slide, whose residual is y with a mechanism off, y - x with it on."""

    stops = range(RUNS)

    def __init__(self, y: np.ndarray, x: np.ndarray, slides: np.ndarray) -> None:
        self.y, self.x = y, x
        self.rows = type("Rows", (), {"run": np.repeat(np.arange(RUNS), EACH), "slides": slides})

    def raw(self, off: bool) -> np.ndarray:
        return self.y if off else self.y - self.x


@pytest.fixture
def asked(monkeypatch):
    """What is said of an effect x in a residual y, beside a nuisance; of the law nothing is free."""
    monkeypatch.setattr(module, "without", lambda model, variant: True)
    monkeypatch.setattr(module, "law_columns", lambda replica, model, base: np.zeros((len(base), 1 + RUNS)))

    def ask(y: np.ndarray, x: np.ndarray, nuisance: np.ndarray, form: float = 0.0, slides: object = False) -> Agreement:
        one = Replica(y, x, np.broadcast_to(slides, len(x)))
        projector = Projector.of(nuisance[:, None] * SIZE_OF_NUISANCE, np.ones(1, dtype=bool), one.rows.run)
        return agreement(one, False, None, Weights(Whitening(np.ones(len(x)), ()), np.ones(len(x)), projector), form)

    return ask


def scattered(runs: int, missed: float) -> np.ndarray:
    """Multiples (runs,) about 1 whose squares sum up to that."""
    course = np.arange(runs) - 0.5 * (runs - 1.0)
    return 1.0 + course * np.sqrt(missed / (course @ course))


@given(st.integers(2, 12), st.floats(0.0, 400.0), st.floats(0.0, 50.0))
def test_with_the_unknown_factor_integrated_out_it_is_the_ratio_of_the_two_likelihoods(runs, evidence, missed):
    """Of a size free and of none, with an inverse chi-square belief about the factor, by quadrature."""
    found = Agreement(scattered(runs, missed), np.eye(runs))
    log_factor = np.linspace(-10.0, 15.0, 2001)
    belief = stats.invgamma(PRIOR_DEGREES / 2.0, scale=PRIOR_DEGREES / 2.0).logpdf(np.exp(log_factor)) + log_factor

    def likelihood(squares: float) -> float:
        """Of one more observation, of the common size, beside the runs' contrasts."""
        value = belief - 0.5 * runs * log_factor - 0.5 * squares / np.exp(log_factor)
        return float(value.max() + np.log(integrate.trapezoid(np.exp(value - value.max()), log_factor)))

    expected = likelihood(missed) - likelihood(missed + 2.0 * evidence)
    assert found.student_evidence(evidence) == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_many_runs_that_agree_leave_the_evidence_and_runs_that_do_not_take_it():
    many = Agreement(1.0 + np.tile([-0.1, 0.1], 500), 0.01 * np.eye(1000))
    assert many.student_evidence(20.0) == pytest.approx(20.0, rel=0.03)
    disagree = Agreement(np.array([-1.2, 1.3, 6.2, -4.1, 0.7]), np.eye(5) / 17.0)
    assert disagree.student_evidence(50.0) < 2.0


def test_what_all_runs_are_wrong_about_alike_is_no_disagreement():
    """Sizes that err together, by what runs share, with a covariance that says so."""
    shared = np.array([1.5, 1.5, 1.5, 1.5])
    assert Agreement(shared, 0.01 * np.eye(4) + 0.25).chi_square == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("sizes", [(1.0,) * 6, (5.0, -3.0, 6.0, -4.0, 5.0, -3.0)])
def test_every_run_gives_its_own_size(asked, sizes):
    """An effect x that is larger or smaller by run; a nuisance takes a part that x does not have."""
    rng = np.random.default_rng(3)
    run = np.repeat(np.arange(RUNS), EACH)
    x, nuisance = rng.standard_normal((2, len(run)))
    y = np.array(sizes)[run] * x + nuisance + rng.standard_normal(len(run))
    found = asked(y, x, nuisance)
    assert found.multiples == pytest.approx(np.array(sizes), abs=4.0 / np.sqrt(EACH))
    assert (found.chi_square > 10.0 * RUNS) == (sizes[1] < 0.0)


def test_the_sizes_of_the_runs_are_generalised_least_squares(asked):
    """One size for each run and one nuisance for all of them, with its prior, against the dense matrices."""
    rng = np.random.default_rng(4)
    x, nuisance, y = rng.standard_normal((3, RUNS * EACH))
    x += nuisance  # which the nuisance may stand in for
    found = asked(y, x, nuisance, form=0.1)
    own = x[:, None] * (np.repeat(np.arange(RUNS), EACH)[:, None] == np.arange(RUNS))
    every = np.column_stack([own, nuisance])
    inverse = np.linalg.inv(every.T @ every + np.diag([0.0] * RUNS + [SIZE_OF_NUISANCE**-2]))
    assert found.multiples == pytest.approx((inverse @ every.T @ y)[:RUNS], rel=1e-6, abs=1e-9)
    assert found.covariance == pytest.approx(inverse[:RUNS, :RUNS] + 0.01 * np.eye(RUNS), rel=1e-6, abs=1e-12)


def test_a_shared_nuisance_that_no_run_knows_by_itself_makes_no_disagreement(asked):
    """Each run sees x and the nuisance nearly alike; by itself it would take for x what the nuisance does."""
    rng = np.random.default_rng(6)
    x = rng.standard_normal(RUNS * EACH)
    nuisance = 0.1 * x + 0.02 * rng.standard_normal(RUNS * EACH)
    y = x + 2.0 * SIZE_OF_NUISANCE * nuisance + rng.standard_normal(RUNS * EACH)
    found = asked(y, x, nuisance)
    assert np.mean(found.multiples) == pytest.approx(1.0, abs=2.5 * np.sqrt(np.mean(found.covariance)))
    assert found.chi_square < stats.chi2(RUNS - 1).ppf(0.99)


def test_a_run_that_says_nothing_is_not_asked(asked):
    rng = np.random.default_rng(5)
    x, nuisance, y = rng.standard_normal((3, RUNS * EACH))
    x[: 3 * EACH] *= 1e-3
    assert len(asked(y, x, nuisance).multiples) == RUNS - 3


def test_what_is_seen_in_slides_alone_and_should_be_seen_beside_them_has_no_evidence(asked):
    """The runs agree, in each of which a mechanism would be seen in both halves: friction that swings looks like it in one."""
    rng = np.random.default_rng(7)
    slides = np.arange(RUNS * EACH) % 2 == 1
    x, nuisance, noise = rng.standard_normal((3, RUNS * EACH))
    everywhere = asked(x + noise, x, nuisance, slides=slides)
    in_slides = asked(x * np.where(slides, 2.0, 0.0) + noise, x, nuisance, slides=slides)
    assert len(everywhere.multiples) == len(in_slides.multiples) == 2 * RUNS
    assert everywhere.student_evidence(30.0) > 10.0 * in_slides.student_evidence(30.0)


def half_width(parts, deviation, change, form):
    low, high = parts.interval(1.0, deviation, change, form)
    assert high - 1.0 == pytest.approx(1.0 - low)
    return high - 1.0


def test_an_interval_is_students_and_as_wide_as_the_parts_scatter():
    deviation = 0.3
    many = Agreement(scattered(400, 399.0), np.eye(400))  # as they should
    assert half_width(many, deviation, 2.0, 0.0) == pytest.approx(1.645 * deviation, rel=0.01)
    few = Agreement(scattered(5, 64.0), np.eye(5))
    factor = np.sqrt((PRIOR_DEGREES + 64.0) / (PRIOR_DEGREES + 4.0))
    assert half_width(few, deviation, 2.0, 0.0) == pytest.approx(stats.t(PRIOR_DEGREES + 4.0).ppf(0.95) * factor * deviation)
    assert half_width(Agreement(np.ones(0), np.zeros((0, 0))), deviation, 2.0, 0.0) > 1.645 * deviation  # nobody was asked


@given(st.floats(0.5, 2.0), st.floats(1e-3, 3.0), st.floats(1e-3, 1.0), st.floats(1e-3, 1.0))
def test_an_interval_holds_what_the_parts_say_together(common, change, deviation, form):
    parts = Agreement(np.full(8, common), np.eye(8))
    half = half_width(parts, deviation, change, form)
    assert half >= abs((common - 1.0) * change) * 1.645
    assert half >= half_width(parts, deviation, change, 0.0) >= half_width(parts, deviation, 0.0, 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_surely_there_has_no_interval_about_nothing(sign):
    """The recordings tell at 10 deviations that it is there, though a size that bends with a shape is known at 0.5 only."""
    parts, value = Agreement(scattered(8, 7.0), np.eye(8)), 0.5 * sign
    low, high = parts.interval(value, 1.0, value, 0.0, absent=0.05)
    bent = parts.interval(value, 1.0, value, 0.0)
    assert bent[0] < 0.0 < bent[1]
    assert low * high > 0.0
    assert max(abs(low), abs(high)) == pytest.approx(max(abs(bent[0]), abs(bent[1])))
