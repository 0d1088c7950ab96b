"""The decision's parts: evidence, sizes of discrepancies, the speed's noise, what compensates and what is normal."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from trial_cases import GAIN, GRADIENT, TERM, candidate, found, trial

from wsp_env.diagnosis import decide
from wsp_env.diagnosis.balances import NOISES, Whitening
from wsp_env.diagnosis.candidates import Variant, parameter_of, refined, switched, values_in, without
from wsp_env.diagnosis.convergence import largest_change
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.decide import posterior
from wsp_env.diagnosis.diagnose import _beside_their_kind, _evidence
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.search import LARGE, SEEN, SMALL, _freed, _one, _posterior, is_possible
from wsp_env.diagnosis.speed import SpeedNoise, estimate, estimate_noise
from wsp_env.diagnosis.trials import FORM, INDISTINCT, MATTERS, PRIOR, PRIOR_TERM, SURE, log_odds
from wsp_env.diagnosis.variation import Group, contrasts


class FakeRows:
    """Rows of one kind of noise and one run."""

    def __init__(self, n: int) -> None:
        self.noise, self.run = np.zeros((2, n), dtype=int)


class FakeBalances:
    """Balances of which only rows and the number of stops are asked."""

    def __init__(self, n: int) -> None:
        self.rows, self.stops = FakeRows(n), range(8)


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
    sizes = evidence.solve(30)
    assert sizes.groups[1] == pytest.approx(3.0, rel=0.35)
    assert sizes.groups[2] == 1.0
    assert sizes.noise[0] == pytest.approx(1.0, rel=0.1)


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


# --- the vehicle's speed


def made(noise: SpeedNoise, seed: int, n: int = 150) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng, time = np.random.default_rng(seed), 0.2 * np.arange(n)
    course = rng.multivariate_normal(np.zeros(n), noise.course(time, time), method="eigh") + 3.0 - 0.05 * time
    return time, course, course + rng.multivariate_normal(np.zeros(n), noise.covariance(time))


def test_coloured_noise_of_a_recorded_speed_is_recognised():
    true = SpeedNoise(0.004, 0.035, 0.6, 0.001)
    found = estimate_noise([made(true, seed)[::2] for seed in range(8)])
    assert found.coloured == pytest.approx(true.coloured, rel=0.25)
    assert found.correlation_s == pytest.approx(true.correlation_s, rel=0.5)


def test_the_estimated_speed_is_as_uncertain_as_it_says():
    noise = SpeedNoise(0.004, 0.035, 0.6, 0.001)
    errors, said = [], []
    for seed in range(40):
        time, course, recorded = made(noise, seed)
        one = estimate(noise, time, recorded)
        errors.append(np.mean((one.course - course) ** 2))
        said.append(np.mean((one.modes**2).sum(axis=1)))
        assert one.gain @ recorded == pytest.approx(one.course)
        every = estimate(noise, time, recorded, 0.0).modes
        assert (one.modes**2).sum() > 0.99 * (every**2).sum()  # what is left out of its directions is next to nothing
    assert np.mean(errors) == pytest.approx(np.mean(said), rel=0.35)
    assert np.sqrt(np.mean(errors)) < 0.6 * noise.coloured


def test_a_straight_course_is_kept():
    time = 0.2 * np.arange(80)
    one = estimate(SpeedNoise(0.01, 0.02, 0.5, 0.002), time, 4.0 - 0.3 * time)
    assert one.course == pytest.approx(4.0 - 0.3 * time, abs=1e-8)


# --- models and answers


def test_switching_on_and_off_leaves_other_terms_alone():
    model = Model(2e-4, (0.06,))
    first = switched(model, TERM, np.array([500.0]))
    second = Variant("discovered", ("coefficient_2",), {"slot_2": 3.0}, (200.0,), "vehicle force by time")
    both = switched(first, second, np.array([90.0]))
    assert values_in(both, TERM) == pytest.approx([500.0])
    assert without(both, second).choice["discovered"]["coefficient_1"] == 500.0
    assert without(without(both, second), TERM).choice == {}
    assert without(switched(model, GAIN, np.array([0.1])), GAIN).choice == {}


def test_sizes_are_clipped_into_their_bounds_and_places_become_free():
    high = switched(Model(2e-4, (0.06,)), GAIN, np.array([1e9])).choice["brake_gain_imbalance"]
    assert high["gain"] < 1e9
    assert high["axle"] == 2.0
    patch = Variant("adhesion_patch", ("change",), {"start_m": 100.0, "length_m": 30.0})
    assert set(refined(patch).sizes) >= {"change"}


def test_belief_is_shared_with_what_explains_nearly_as_much():
    best = trial(GRADIENT, 40.0)
    alone = posterior(best, [best], [found(GRADIENT, 40.0), found(GAIN, 2.0)])
    shared = posterior(best, [best], [found(GRADIENT, 40.0), found(GAIN, 39.5)])
    assert alone[0] == ("track_gradient",)
    assert alone[1] > 0.95
    assert shared[0] == ("track_gradient", "brake_gain_imbalance")
    assert 0.5 <= shared[1] < 0.7


@pytest.mark.parametrize(
    ("accepted_at", "before", "after", "compensates"),
    [(2.0, 2.0, 2.2, False), (2.0, 2.0, 20.0, True), (0.1, 2.0, 2.2, False), (0.3, 0.3, 1.2, False), (0.3, 0.3, 1.4, True)],
)
def test_what_makes_another_grow_compensates_it(monkeypatch, accepted_at, before, after, compensates):
    """Against the other's size in a fit of the same weights without the one that is tried, not as it was accepted in others.

    A memory of 0.3 interests, hidden by a wrong radius, may grow to 1.275: 1.7 times what matters.
    """
    with_it, without_it = Model(1e-4, (0.06,)), Model(2e-4, (0.06,))
    accepted = decide.Accepted(trial(GRADIENT, 40.0, multiple=accepted_at), ("track_gradient",), 1.0)
    new = dataclasses.replace(trial(GAIN, 30.0), fitted=Fitted(with_it, (), (), (), 0.0), null_model=without_it)
    screen = type("Seen", (), {"whitening": None})()
    sizes = {with_it.tau: after, without_it.tau: before}
    monkeypatch.setattr(decide, "net_effect", lambda _, model, *__: StopChange(0.01 * sizes[model.tau], 0.0))
    assert decide._compensates(None, new, [accepted], screen) == compensates
    assert not decide._compensates(None, new, [], screen)


@pytest.mark.parametrize(("gained", "holds"), [(11.0, True), (9.0, True), (-30.0, True), (30.0, False)])
def test_an_earlier_name_gives_way_to_a_rival_that_explains_distinctly_more_beside_a_later_one(monkeypatch, gained, holds):
    """A drag that came first as it did the work of two; beside the second of them the first explains more than the drag."""
    drag = Variant("dragging_brake", ("torque_nm",), {"axle": 2.0, "from_start": 0.0})
    bare = Model(2e-4, (0.06,))
    both = switched(switched(bare, drag, np.array([300.0])), GRADIENT, np.array([0.003]))
    costs = {drag.title: 100.0, GAIN.title: 100.0 - 2.0 * gained, None: 200.0}

    def refit(_, model, variants, __):
        titles = [one.title for one in variants if one is not GRADIENT]
        values = tuple(values_in(model, one) for one in variants)
        return Fitted(model, tuple(variants), values, (np.eye(1),) * len(values), costs[titles[0] if titles else None])

    def own(_, __, one):
        return decide.Retested(one, "its own") if holds else None

    monkeypatch.setattr(decide, "refit", refit)
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "net_effect", lambda *_: StopChange(0.02, 0.0))
    monkeypatch.setattr(decide, "retest", own)
    monkeypatch.setattr(decide, "Side", lambda *_: None)
    monkeypatch.setattr(decide, "ReplicaNoise", lambda *_: SimpleNamespace(noise=None))
    rival = dataclasses.replace(trial(GAIN, 40.0), fitted=Fitted(switched(bare, GAIN, np.array([0.06])), (GAIN,), (), (), 0.0))
    first = decide.Accepted(trial(drag, 50.0), (drag.name,), 0.9, (rival,))
    later = decide.Accepted(trial(GRADIENT, 40.0), (GRADIENT.name,), 1.0)
    replica, fitted, accepted = decide._exchanged(
        "before", refit(None, both, [drag, GRADIENT], None), [first, later], SimpleNamespace(whitening=None)
    )
    gives_way = gained > INDISTINCT and holds
    assert [one.name for one in accepted] == (["track_gradient", GAIN.name] if gives_way else [drag.name, "track_gradient"])
    assert replica == ("its own" if gives_way else "before")
    assert (GAIN.name in fitted.model.choice, drag.name in fitted.model.choice) == (gives_way, not gives_way)


@pytest.mark.parametrize(("here", "without"), [(2.0, 200.0), (200.0, 2.0), (200.0, 200.0)])
def test_what_is_no_longer_sure_beside_a_later_name_is_taken_back(monkeypatch, here, without):
    """The first of two reduces the squares by so much about the model of both, and about the model without it."""
    whole = Fitted(Model(2e-4, (0.06,)), (GRADIENT, GAIN), (), (), 50.0)

    def side(less):
        return SimpleNamespace(replica="rest", compare=lambda _, variant, __: (less * (variant is GRADIENT), 0.0))

    monkeypatch.setattr(decide, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 50.0))
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "Side", lambda *_: side(here))
    monkeypatch.setattr(decide, "ReplicaNoise", lambda *_: SimpleNamespace(noise=None))
    monkeypatch.setattr(decide, "own_side", lambda _, fitted, __: (side(without), fitted))
    first, last = (decide.Accepted(trial(one, 40.0), (one.name,), 1.0) for one in (GRADIENT, GAIN))
    accepted, fitted = decide._backward_elimination(None, [first, last], whole, SimpleNamespace(whitening=None))
    lost = min(here, without) < 10.0
    assert [one.name for one in accepted] == (["brake_gain_imbalance"] if lost else ["track_gradient", "brake_gain_imbalance"])
    assert fitted.variants == ((GAIN,) if lost else (GRADIENT, GAIN))


def test_a_size_at_the_end_of_what_it_may_be_is_no_finding():
    high = parameter_of("brake_gain_imbalance", "gain").high
    for value, expected in ((0.1, False), (high, True)):
        model = switched(Model(2e-4, (0.06,)), GAIN, np.array([value]))
        assert decide.at_bound(GAIN, model) == expected


@pytest.mark.parametrize(("edge_m", "expected"), [(20.0, False), (100.0, True), (0.5, False)])
def test_a_shape_at_its_upper_end_is_no_finding_and_at_its_lower_end_a_simple_one(edge_m, expected):
    patch = Variant("adhesion_patch", ("change", "edge_m"), {"start_m": 300.0, "length_m": 60.0})
    assert decide.at_bound(patch, switched(Model(2e-4, (0.06,)), patch, np.array([-0.2, edge_m]))) == expected


def test_nothing_is_said_of_what_cannot_be():
    """A brake that pushes, say: its evidence is no number, which JSON does not have either."""
    told = _evidence((found(GRADIENT, 4.0), found(GAIN, -np.inf), found(TERM, -1.0)))
    assert [one.name for one in told] == ["track_gradient", "brake torque by braking"]


def test_only_what_matters_is_missing():
    kept = [decide.Accepted(trial(GRADIENT, 40.0, multiple), ("track_gradient",), 1.0) for multiple in (0.5, MATTERS, 3.0)]
    outcome = decide.Outcome(None, None, tuple(kept), None, None, None)
    assert [one.trial.size.multiple for one in outcome.missing] == pytest.approx([MATTERS, 3.0])


def test_there_is_a_noise_for_every_balance():
    evidence = evidence_of(np.zeros((10, 0)), np.ones(10), [Group("g", np.ones((10, 1)), 1.0)])
    assert len(evidence.solve(1).noise) == len(NOISES)


# --- curves


@pytest.mark.parametrize(
    ("unexplained", "size", "holds_not"),
    [(True, 0.0, []), (False, 0.0, []), (False, 0.5, []), (False, 2.0, ["track_gradient"])],
)
def test_curves_are_tried_once_and_only_where_what_is_left_matters(unexplained, size, holds_not, monkeypatch):
    """Or where something has evidence and matters, but does not hold: with curves it is asked again, and told."""
    searched: list[list[str]] = []

    def screened(replica, model, tried, pool, accepted=(), noise_parameters=None):
        searched.append([one.title for one in tried])
        return SimpleNamespace(found=(), second={}, noise_parameters=None, noise=None)

    rejected = [dataclasses.replace(trial(GRADIENT, 40.0), size=StopChange(0.01 * size, 0.0))] if size else []
    monkeypatch.setattr(decide, "screen", screened)
    monkeypatch.setattr(decide, "terms", lambda replica, accepted=(): [TERM])
    monkeypatch.setattr(decide, "curves", lambda replica, accepted=(): [dataclasses.replace(TERM, family="a curve")])
    monkeypatch.setattr(decide, "Side", lambda *_: None)
    monkeypatch.setattr(decide, "structured", lambda replica, seen, weights: SimpleNamespace(unexplained=unexplained))
    monkeypatch.setattr(decide, "weights_of", lambda replica, seen: None)
    monkeypatch.setattr(decide, "FormErrorThreshold", lambda *said: lambda one: SURE)
    monkeypatch.setattr(decide, "trials_of", lambda *said: [rejected])
    monkeypatch.setattr(decide, "_is_rejected", lambda *said: True)
    replica = SimpleNamespace(baseline=Model(2e-4, (0.06,)), rows=[])
    outcome = decide.select(replica, [GRADIENT], ThreadPoolExecutor(1))
    with_curves = [["track_gradient", "a curve"]] if unexplained or holds_not else []
    assert searched == [["track_gradient", TERM.family], *with_curves]
    assert not outcome.accepted
    assert [one.listed.title for one in outcome.rejected] == holds_not


@pytest.mark.parametrize("left", [1.0, 6.8])
def test_what_the_runs_leave_no_evidence_of_was_not_seen(left, monkeypatch):
    """Refused for what the parts of the recordings leave of it, as it is not sure: 6.8 nats are 94.6 %."""
    one = dataclasses.replace(trial(GRADIENT, 40.0), size=StopChange(0.02, 0.0))
    screened = SimpleNamespace(found=(), second={}, noise_parameters=None, noise=None)
    monkeypatch.setattr(decide, "screen", lambda *_, **__: screened)
    for name in ("terms", "curves"):
        monkeypatch.setattr(decide, name, lambda *_: [])
    monkeypatch.setattr(decide, "Side", lambda *_: None)
    monkeypatch.setattr(decide, "structured", lambda *_: SimpleNamespace(unexplained=False))
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "FormErrorThreshold", lambda *_: lambda _: SURE)
    monkeypatch.setattr(decide, "trials_of", lambda *_: [[one]])
    monkeypatch.setattr(decide, "_is_rejected", lambda *_: False)
    monkeypatch.setattr(decide, "retest", lambda *_: decide.Retested(dataclasses.replace(one, evidence=left), None))
    outcome = decide.select(SimpleNamespace(baseline=Model(2e-4, (0.06,)), rows=[]), [GRADIENT], ThreadPoolExecutor(1))
    assert outcome.rejected == ()


def test_a_move_is_counted_in_the_deviations_that_the_size_has_afterwards():
    """Of all free parameters the one that moves furthest counts: here 3 N over a deviation of 2 N."""
    model = Model(2e-4, (0.05,))
    before = Fitted(model, (GAIN, GRADIENT), (np.array([0.1]), np.array([4.0])), (np.eye(1), np.eye(1)), 0.0)
    after = dataclasses.replace(before, values=(np.array([0.6]), np.array([7.0])), covariance=(np.eye(1), 4.0 * np.eye(1)))
    assert largest_change(before, after) == pytest.approx(1.5)
    assert largest_change(before, before) == 0.0


def test_a_damaged_run_is_one_beside_others_of_its_kind():
    """An inertia of 40 % that all sliding runs show had left out each of them, and then no wheel slid."""
    slides = np.array([True, True, True, False, False, False])
    missing = _beside_their_kind(np.array([90.0, 80.0, 100.0, 1.0, 1.1, 0.9]), slides)
    assert missing.max() < 2.0
    damaged = _beside_their_kind(np.array([1.0, 90.0, 1.2, 1.0, 1.1, 0.9]), slides)
    assert damaged.argmax() == 1
    assert damaged[1] > 50.0
    few = np.array([True, False, False, False])
    assert _beside_their_kind(np.array([90.0, 1.0, 1.1, 0.9]), few)[0] == 0.0  # nothing to compare it with
