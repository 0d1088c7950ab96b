"""The search of terms: its algebra against plain least squares, planted terms, noise that nothing is in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from wsp_env.diagnosis.grams import Runs
from wsp_env.diagnosis.terms import Reduction, Term, search

RUNS, ROWS = 12, 30
CLUSTER = np.repeat(np.arange(RUNS), ROWS)
HELD = CLUSTER % 2 == 1
NONE = np.zeros((RUNS * ROWS, 0)), np.zeros(0, dtype=bool)


def augmented(columns: np.ndarray, prior: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Best amplitudes, by rows that say 0 +- 1 for every column with a prior."""
    extra = np.eye(columns.shape[1])[prior]
    return np.linalg.lstsq(np.vstack([columns, extra]), np.concatenate([y, np.zeros(len(extra))]), rcond=None)[0]


def candidates(rng: np.random.Generator, count: int, walk: bool = False) -> list[Term]:
    """Terms of rows that are alike in no two runs."""
    steps = rng.standard_normal((RUNS, ROWS, count))
    x = steps.cumsum(axis=1) / np.sqrt(ROWS / 2.0) if walk else steps
    return [Term(f"term {i}", x[:, :, i].reshape(-1, 1)) for i in range(count)]


def walking_noise(rng: np.random.Generator) -> np.ndarray:
    """Noise (n,) that wanders within each run: neighbours are nearly equal."""
    return rng.standard_normal((RUNS, ROWS)).cumsum(axis=1).ravel()


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.integers(0, 3), st.integers(1, 3))
def test_reductions_are_those_of_plain_least_squares(seed, common, width):
    """Each run is predicted from the others; its own nuisance is fitted in it, with its prior."""
    rng = np.random.default_rng(seed)
    runs, rows = 5, 9
    cluster = np.repeat(np.arange(runs), rows)
    n = runs * rows
    own = (cluster[:, None] == np.arange(runs)) * 0.7
    shared, x, y = rng.standard_normal((n, common)), rng.standard_normal((n, width)), rng.standard_normal(n)
    priors = rng.random(common) < 0.5
    nuisances = np.column_stack([own, shared]), np.concatenate([np.ones(runs, dtype=bool), priors])
    held = cluster >= 3
    data = Runs(y, [x], nuisances, cluster, held)
    tune, on_held = data.predicted([], [0])

    def cost(run: int, without: np.ndarray, columns: np.ndarray, prior: np.ndarray) -> float:
        """Sum of squares of a run, predicted from others, with its own level fitted to what is left."""
        train = without & ~held
        level = own[np.ix_(train, np.unique(cluster[train]))]
        every, flags = np.column_stack([columns[train], level]), np.concatenate([prior, np.ones(level.shape[1], dtype=bool)])
        amplitude = augmented(every, flags, y[train])[: columns.shape[1]]
        rest = y[cluster == run] - columns[cluster == run] @ amplitude
        mine = own[cluster == run][:, run : run + 1]
        best = augmented(mine, np.ones(1, dtype=bool), rest)
        return float(((rest - mine @ best) ** 2).sum() + (best**2).sum())

    with_term, flags = np.column_stack([shared, x]), np.concatenate([priors, np.zeros(width, dtype=bool)])
    for run in range(runs):
        expected = cost(run, cluster != run, shared, priors) - cost(run, cluster != run, with_term, flags)
        found = tune[0, run] if run < 3 else on_held[0, run - 3]
        assert found == pytest.approx(expected, rel=1e-5, abs=1e-6)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 10_000), st.floats(2.0, 4.0))  # of a noise of 1: sure in six runs that scatter
def test_a_planted_term_is_found_off_the_nuisances(seed, size):
    rng = np.random.default_rng(seed)
    terms = candidates(rng, 20)
    levels = CLUSTER[:, None] == np.arange(RUNS)
    trend = rng.standard_normal((RUNS * ROWS, 1))
    nuisances = np.column_stack([levels, trend]), np.zeros(RUNS + 1, dtype=bool)
    offsets = levels @ (10.0 * rng.standard_normal(RUNS))
    y = size * terms[7].columns[:, 0] + offsets + 5.0 * trend[:, 0] + rng.standard_normal(RUNS * ROWS)
    found = search(y, terms, nuisances, CLUSTER, HELD, most=1)
    assert [one.term.name for one in found.chosen] == ["term 7"]
    one = found.chosen[0]
    # Noise and columns have deviation 1: the amplitude's is one over the root of the rows to tune on.
    assert abs(one.amplitude[0] - size) < 6.0 / np.sqrt((~HELD).sum())
    assert 0.0 < one.removed < 1.0
    assert one.alternatives == ()


def test_the_covariance_of_a_planted_term_is_that_of_its_scatter():
    levels = (CLUSTER[:, None] == np.arange(RUNS)).astype(float), np.zeros(RUNS, dtype=bool)
    beyond = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        terms = candidates(rng, 5)
        y = 2.0 * terms[3].columns[:, 0] + rng.standard_normal(RUNS * ROWS)
        one = search(y, terms, levels, CLUSTER, HELD, most=1).chosen[0]
        beyond.append(abs(one.amplitude[0] - 2.0) > stats.t.ppf(0.9, RUNS // 2 - 1) * np.sqrt(one.covariance[0, 0]))
    # One in five is expected beyond; binomial bounds at 99.9 % on either side.
    low, high = stats.binom.interval(0.998, len(beyond), 0.2)
    assert low <= sum(beyond) <= high


def test_two_planted_terms_are_found_and_fitted_together():
    rng = np.random.default_rng(3)
    terms = candidates(rng, 30)
    # Not orthogonal: the first one's amplitude is wrong until the second is there.
    terms[4] = Term("term 4", terms[4].columns + 0.7 * terms[11].columns)
    pair = Term("pair", np.column_stack([terms[11].columns, rng.standard_normal(RUNS * ROWS)]))
    terms.append(pair)
    y = 2.0 * terms[4].columns[:, 0] + pair.columns @ [1.0, -1.5] + 0.5 * rng.standard_normal(RUNS * ROWS)
    found = search(y, terms, NONE, CLUSTER, HELD)
    amplitudes = {one.term.name: one.amplitude for one in found.chosen}
    assert set(amplitudes) == {"term 4", "pair"}
    assert amplitudes["term 4"] == pytest.approx([2.0], abs=0.15)
    assert amplitudes["pair"] == pytest.approx([1.0, -1.5], abs=0.15)


@pytest.mark.parametrize("walk", [pytest.param(False, marks=pytest.mark.long), True], ids=["white", "wandering within a run"])
def test_noise_is_taken_for_a_term_as_rarely_as_the_level_says(walk):
    """Thirty candidates in each; of sixty tries at 5 %, eight or more come by chance once in a hundred."""
    alarms = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        y = walking_noise(rng) if walk else rng.standard_normal(RUNS * ROWS)
        found = search(y, candidates(rng, 30, walk), NONE, CLUSTER, HELD, most=1)
        alarms += len(found.chosen)
    assert alarms <= 7


def test_what_the_nuisances_span_is_no_term():
    rng = np.random.default_rng(5)
    trend, own = rng.standard_normal((RUNS * ROWS, 1)), (CLUSTER[:, None] == np.arange(RUNS)).astype(float)
    nuisances = np.column_stack([trend, own]), np.zeros(RUNS + 1, dtype=bool)
    terms = [Term("trend", 2.0 * trend), Term("level", np.ones((RUNS * ROWS, 1)))]
    y = 3.0 * trend[:, 0] + 4.0 + 0.01 * rng.standard_normal(RUNS * ROWS)
    found = search(y, terms, nuisances, CLUSTER, HELD)
    assert found.chosen == ()


def test_what_the_held_out_runs_do_not_have_is_refused_and_named():
    rng = np.random.default_rng(6)
    terms = candidates(rng, 10)
    y = np.where(HELD, 0.0, 2.0 * terms[2].columns[:, 0]) + rng.standard_normal(RUNS * ROWS)
    found = search(y, terms, NONE, CLUSTER, HELD)
    assert found.chosen == ()
    assert found.refused is not None
    assert found.refused.term.name == "term 2"
    assert "held-out" in found.why


def test_an_effect_that_matters_too_little_is_passed_over():
    rng = np.random.default_rng(7)
    terms = candidates(rng, 10)
    y = 0.5 * terms[1].columns[:, 0] + 0.1 * rng.standard_normal(RUNS * ROWS)

    def rms_over(interest: float):
        return lambda effect: float(np.sqrt(np.mean(effect**2)) / interest)

    assert [one.term.name for one in search(y, terms, NONE, CLUSTER, HELD, rms_over(0.4)).chosen] == ["term 1"]
    assert search(y, terms, NONE, CLUSTER, HELD, rms_over(0.6)).chosen == ()


def test_of_terms_that_cannot_be_told_apart_the_plainest_is_taken():
    rng = np.random.default_rng(8)
    v = rng.standard_normal(RUNS * ROWS)
    bent, plain = np.tanh(v / 0.05)[:, None], np.sign(v)[:, None]
    terms = [Term("tanh(v / 0.05)", bent, 1), Term("sign(v)", plain), Term("v", v[:, None])]
    y = 3.0 * bent[:, 0] + 0.1 * rng.standard_normal(RUNS * ROWS)
    interest = 0.1 * np.sqrt(np.mean(y**2))
    found = search(y, terms, NONE, CLUSTER, HELD, lambda effect: float(np.sqrt(np.mean(effect**2)) / interest), most=1)
    assert found.chosen[0].term.name == "sign(v)"
    assert found.chosen[0].alternatives == ("tanh(v / 0.05)",)
    # Where every difference matters, they can be told apart.
    assert search(y, terms, NONE, CLUSTER, HELD, most=1).chosen[0].term.name == "tanh(v / 0.05)"


def test_the_order_of_rows_does_not_matter():
    rng = np.random.default_rng(9)
    terms = candidates(rng, 8)
    y = terms[3].columns[:, 0] + rng.standard_normal(RUNS * ROWS)
    order = rng.permutation(len(y))
    mixed = [Term(one.name, one.columns[order]) for one in terms]
    first = search(y, terms, NONE, CLUSTER, HELD, most=1).chosen[0]
    second = search(y[order], mixed, NONE, CLUSTER[order], HELD[order], most=1).chosen[0]
    assert second.amplitude == pytest.approx(first.amplitude)
    assert second.covariance == pytest.approx(first.covariance)
    assert second.reduction_held_out.total == pytest.approx(first.reduction_held_out.total)


def test_a_run_is_held_out_or_not():
    half = np.array([True, False, False, False])
    with pytest.raises(ValueError, match="either held out or not"):
        search(np.zeros(4), [], (np.zeros((4, 0)), np.zeros(0, dtype=bool)), np.zeros(4, dtype=int), half)


def test_one_run_says_nothing_for_sure():
    assert not Reduction(100.0, np.inf, 1).sure()
    assert Reduction(100.0, 10.0, 5).sure()
    assert not Reduction(10.0, 10.0, 5).sure()
