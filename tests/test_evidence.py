"""What a candidate's evidence is, and how large discrepancies and noise are by the recordings' own scatter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import norm
from trial_cases import GRADIENT, TERM, candidate

from wsp_env.diagnosis import covariance
from wsp_env.diagnosis.arrow import combined
from wsp_env.diagnosis.balances import NOISES, Whitening
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.search import LARGE, SEEN, SMALL, _freed, _one, _posterior, is_possible
from wsp_env.diagnosis.trials import FORM, MATTERS, PRIOR, PRIOR_TERM, SURE, log_odds
from wsp_env.diagnosis.variation import Group, contrasts


class FakeRows:
    """Rows of some kinds of noise and runs; by default of one."""

    def __init__(self, n: int, noise: np.ndarray | int = 0, run: np.ndarray | int = 0) -> None:
        self.noise, self.run = (np.broadcast_to(one, n) for one in (noise, run))


class FakeBalances:
    """Balances of which only rows and the number of stops are asked."""

    def __init__(self, n: int, noise: np.ndarray | int = 0, run: np.ndarray | int = 0) -> None:
        self.rows, self.stops = FakeRows(n, noise, run), range(8)


def evidence_of(columns: np.ndarray, y: np.ndarray, groups: list[Group]) -> Evidence:
    whitening = Whitening(np.ones(len(y)), ())
    return Evidence(FakeBalances(len(y)), whitening, groups, y, columns, last=True)


# --- evidence


@pytest.mark.parametrize(("centre", "spread"), [(0.0, 0.1), (1.0, 0.2), (-3.0, 0.4), (0.3, 0.01)])
def test_evidence_is_the_ratio_of_the_two_likelihoods(centre, spread):
    """For one size: the density of its estimate with a wide and with a narrow prior."""
    one = _one(candidate(), np.array([centre]), np.array([[spread**2]]), 1)
    expected = norm.logpdf(centre, 0.0, np.hypot(spread, LARGE)) - norm.logpdf(centre, 0.0, np.hypot(spread, SMALL))
    assert one.evidence == pytest.approx(expected, abs=1e-9)


def test_variants_cost_their_logarithm_and_nothing_small_is_evidence():
    one, many = (_one(candidate(), np.array([2.0]), np.array([[0.01]]), count) for count in (1, 20))
    assert one.evidence - many.evidence == pytest.approx(np.log(20.0))
    # What is as small as sound vehicles are speaks against a large size, however surely it is measured.
    assert _one(candidate(), np.array([SMALL]), np.array([[1e-8]]), 1).evidence < 0.0


@given(st.integers(0, 10_000), st.integers(1, 3))
@settings(deadline=None, max_examples=50)
def test_the_likelihood_is_what_is_left_of_a_posterior_without_its_prior(seed, k):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((k, k + 2))
    spread, centre = root @ root.T, rng.standard_normal(k)
    precision = np.linalg.inv(spread) + np.eye(k) / SMALL**2
    covariance = np.linalg.inv(precision)
    mean = covariance @ np.linalg.solve(spread, centre)
    again, wide = _freed(mean / SMALL, covariance / SMALL**2, SMALL)
    assert again == pytest.approx(centre, rel=1e-5, abs=1e-6)
    assert wide == pytest.approx(spread, rel=1e-5, abs=1e-6)


def test_a_brake_never_pushes():
    brake = Variant("non_adhesive_brake", ("force_n",), {})
    move = float(brake.moves()[0])
    assert is_possible(candidate(brake), np.array([-1.0 * np.sign(move)]))
    assert not is_possible(candidate(brake), np.array([1.0 * np.sign(move)]))
    assert is_possible(candidate(GRADIENT), np.array([1.0]))
    assert is_possible(candidate(GRADIENT), np.array([-1.0]))


def test_a_name_needs_less_evidence_than_a_term_and_a_sure_one_is_ninety_five_in_a_hundred():
    assert log_odds(GRADIENT, 10.0) - log_odds(TERM, 10.0) == pytest.approx(PRIOR - PRIOR_TERM)
    assert 1.0 / (1.0 + np.exp(-SURE)) == pytest.approx(0.95)
    assert pytest.approx(SURE - PRIOR) == SEEN
    assert pytest.approx(1.0 / (1.0 + 1.645 * FORM), abs=0.01) == MATTERS


# --- discrepancies


def test_a_size_is_at_most_what_does_not_matter():
    """Levels of 60 runs that scatter by three deviations are a finding, not a nuisance, if two would matter."""
    rng = np.random.default_rng(1)
    level = np.kron(np.eye(60), np.ones((20, 1)))
    y = level @ (3.0 * rng.standard_normal(60)) + rng.standard_normal(len(level))
    for most, expected in ((2.0, 2.0), (9.0, 3.0)):
        groups = [Group("run", level, 1.0, most=most), Group("last", level[:, :1], 0.5)]
        evidence = evidence_of(np.zeros((len(y), 0)), y, groups)
        assert evidence.solve().groups[0] == pytest.approx(expected, rel=0.25)


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=10)
def test_sizes_are_learned_from_disagreement_and_fixed_ones_stay(seed):
    """Levels of 60 runs that scatter by three deviations; a common level is free."""
    rng = np.random.default_rng(seed)
    runs, each = 60, 20
    level = np.kron(np.eye(runs), np.ones((each, 1)))
    y = 5.0 + level @ (3.0 * rng.standard_normal(runs)) + rng.standard_normal(runs * each)
    common = Group("common", np.ones((runs * each, 1)), np.inf, True)
    evidence = evidence_of(
        np.zeros((len(y), 0)), y, [common, Group("run", level, 1.0), Group("fixed", level[:, :1], 0.5, True)]
    )
    sizes = evidence.solve()
    assert sizes.groups[1] == pytest.approx(3.0, rel=0.35)
    assert sizes.groups[2] == 1.0
    assert sizes.noise[0] == pytest.approx(1.0, rel=0.1)


@given(st.floats(0.0, 0.9), st.floats(-3.0, 3.0))
def test_longer_steps_reach_the_end_of_a_linear_iteration_in_three(ratio, far):
    """Each step of the iteration alone leaves a share of the distance; a step is at most three times as long."""
    longer, left = covariance._Longer(), np.array([far, 0.0])
    for _ in range(3):
        left = left + longer.step((ratio - 1.0) * left)
    assert abs(left[0]) <= abs(far) * ratio * max(1.0 - covariance._LONGEST * (1.0 - ratio), 0.0) ** 2 + 1e-9
    assert left[1] == 0.0


def test_sizes_that_replace_each_other_are_found_sooner_with_longer_steps(monkeypatch):
    """Levels of runs, and levels that grow with time: as similar as they are, one size shrinks slowly as the other grows."""
    plain, exact, steps = [], [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        level, tilted = (np.kron(np.eye(60), np.linspace(1.0 - by, 1.0 + by, 20)[:, None]) for by in (0.0, 0.1))
        y = tilted @ (3.0 * rng.standard_normal(60)) + rng.standard_normal(len(level))
        evidence = evidence_of(np.zeros((len(y), 0)), y, [Group("level", level, 1.0), Group("tilted", tilted, 1.0)])
        for converged, longest, found in ((1e-6, 1.0, exact), (0.05, 1.0, plain), (0.05, 3.0, steps)):
            made = []
            with monkeypatch.context() as patch:
                patch.setattr(covariance, "_CONVERGED", converged)
                patch.setattr(covariance, "_ITERATIONS", 200)
                patch.setattr(covariance, "_LONGEST", longest)
                patch.setattr(covariance, "combined", lambda *all, made=made: made.append(1) or combined(*all))
                found.append((*np.log(evidence.solve().groups), len(made)))
    plain, exact, steps = np.array(plain), np.array(exact), np.array(steps)
    assert steps[:, -1].sum() < 0.8 * plain[:, -1].sum()
    assert abs(steps - exact)[:, :-1].max() < abs(plain - exact)[:, :-1].max()


def test_there_is_a_noise_for_every_balance():
    evidence = evidence_of(np.zeros((10, 0)), np.ones(10), [Group("g", np.ones((10, 1)), 1.0)])
    assert len(evidence.solve().noise) == len(NOISES)


N, RUNS, KINDS = 60, 3, np.arange(60) % 2


def several(seed: int) -> tuple[Evidence, list[Group], np.ndarray, np.ndarray]:
    """Return an evidence of three runs and two kinds of rows, its groups, the rows and the run of each."""
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(RUNS), N // RUNS)
    levels = (run[:, None] == np.arange(RUNS)) * rng.standard_normal((N, 1))
    groups = [
        Group("common", rng.standard_normal((N, 2)), 0.7, True),
        Group("run", np.column_stack([levels, rng.standard_normal((N, 4))]), 0.8),
        Group("other", rng.standard_normal((N, 6)), 0.5),
    ]
    y = sum(group.columns @ rng.standard_normal(group.columns.shape[1]) for group in groups)
    y = y + rng.standard_normal(N) * np.array([0.8, 1.7])[KINDS]
    return Evidence(FakeBalances(N, KINDS, run), Whitening(np.ones(N), ()), groups, y), groups, y, run


def minus_log_posterior(logs: np.ndarray, groups: list[Group], y: np.ndarray) -> float:
    """Twice that of the sizes of the free groups and of two kinds of noise, from the covariance of the rows itself."""
    sizes = np.exp(logs)
    factors = dict(zip([group.name for group in groups if not group.fixed], sizes, strict=False))
    covariance = np.diag(sizes[-2:][KINDS] ** 2)
    for group in groups:
        covariance += (group.expected * factors.get(group.name, 1.0)) ** 2 * group.columns @ group.columns.T
    prior = 4.0 * np.sum(sizes**-2 + 2.0 * logs)
    return float(y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1] + prior)


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=10)
def test_sizes_are_the_likeliest(seed):
    """From any beginning: nowhere near is a likelier set of sizes. The prior is that of four observations."""
    evidence, groups, y, _ = several(seed)
    for start in (None, Sizes(np.array([1.0, 4.0, 0.2]), np.full(5, 2.0))):
        found = evidence.solve(start)
        best = np.log([*found.groups[1:], *found.noise[:2]])
        least = minimize(minus_log_posterior, best, (groups, y), "BFGS")
        assert minus_log_posterior(best, groups, y) - least.fun < 0.1


def test_other_rows_beside_the_same_nuisances_need_only_their_own_products():
    evidence, groups, _, run = several(3)
    other = np.random.default_rng(1).standard_normal(N)
    anew = Evidence(FakeBalances(N, KINDS, run), Whitening(np.ones(N), ()), groups, other).solve()
    again = evidence.about(other).solve()
    assert again.groups == pytest.approx(anew.groups)
    assert again.noise == pytest.approx(anew.noise)
    assert evidence.solve().groups != pytest.approx(anew.groups)  # which stays as it was


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=10)
def test_the_projector_off_some_nuisances_is_that_of_their_columns(seed):
    evidence, groups, _, run = several(seed)
    rng = np.random.default_rng(seed)
    sizes = Sizes(rng.uniform(0.5, 2.0, len(groups)), rng.uniform(0.5, 2.0, 5))
    kept = rng.random(evidence.nuisances) < 0.7
    noise = sizes.noise[KINDS, None]
    columns = np.column_stack([g.columns * g.expected * size for g, size in zip(groups, sizes.groups, strict=True)]) / noise
    expected = Projector.of(columns[:, kept], np.ones(kept.sum(), dtype=bool), run)
    found = evidence.projector(sizes, kept)
    rows = rng.standard_normal((N, 2))
    assert found.rest(rows) == pytest.approx(expected.rest(rows))
    assert found.inner(rows, rows) == pytest.approx(expected.inner(rows, rows))
    assert found.amplitudes(rows) == pytest.approx(expected.amplitudes(rows))
    assert found.logdet == pytest.approx(expected.logdet)


def test_what_is_said_of_a_column_alone_is_generalised_least_squares():
    rng = np.random.default_rng(1)
    z, x, y = rng.standard_normal((30, 4)), rng.standard_normal((30, 2)), rng.standard_normal(30)
    mean, covariance, alone = _posterior(evidence_of(x, y, [Group("g", z, 0.7, True)]), Sizes(np.ones(1), np.ones(5)))
    weight = np.linalg.inv(np.eye(30) + 0.49 * z @ z.T)
    centre, spread = alone(slice(0, 2))
    assert spread == pytest.approx(np.linalg.inv(x.T @ weight @ x), rel=1e-6)
    assert centre == pytest.approx(spread @ x.T @ weight @ y, rel=1e-6)
    assert covariance == pytest.approx(np.linalg.inv(np.eye(4) + 0.49 * z.T @ z))
    assert mean == pytest.approx(0.7 * covariance @ z.T @ y)


def test_a_common_slope_gains_only_what_runs_that_scatter_leave_it():
    """The same mean slope, common or a mechanism's: with runs that agree it is evidence, with runs that scatter it is none."""
    rng = np.random.default_rng(2)
    runs, each = 8, 50
    x = np.tile(np.linspace(0.0, 1.0, each), runs)
    of_run = np.kron(np.eye(runs), np.ones((each, 1))) * x[:, None]
    gains = []
    for scatter in (0.0, 2.0):
        slopes = rng.standard_normal(runs)
        slopes = 1.0 + scatter * (slopes - slopes.mean())
        y = of_run @ slopes + 0.3 * rng.standard_normal(runs * each)
        differs = of_run @ contrasts(runs)
        groups = [Group("slope", x[:, None], 0.1, True, "slope of a run"), Group("slope of a run", differs, 0.1)]
        evidence = evidence_of(x[:, None], y, groups)
        _, _, alone = _posterior(evidence, evidence.solve())
        gains.append(_one(candidate(), *alone(slice(0, 1)), 1).evidence)
    assert gains[0] > 5.0
    assert gains[1] < 2.0
