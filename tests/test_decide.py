"""The decision's parts: what gives way, what compensates, what is a finding and what is normal."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import GAIN, GRADIENT, TERM, found, trial, unfreed

from wsp_env.diagnosis import accepted, decide, exchange
from wsp_env.diagnosis.accepted import Accepted, posterior
from wsp_env.diagnosis.candidates import Variant, parameter_of, refined, switched, values_in, without
from wsp_env.diagnosis.convergence import largest_change
from wsp_env.diagnosis.diagnose import _beside_their_kind, _evidence
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.retest import Step
from wsp_env.diagnosis.trials import INDISTINCT, MATTERS, SURE


@pytest.fixture(autouse=True)
def no_small_mechanisms(monkeypatch):
    monkeypatch.setattr(decide, "freed", unfreed)


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
    ("accepted_at", "before", "after", "cost"),
    [
        (2.0, 2.0, 4.0, np.log(2.0)),
        (2.0, 2.0, 40.0, np.log(20.0)),
        (0.1, 2.0, 1.9, 0.0),
        (0.3, 0.3, 0.75, 0.0),
        (0.3, 0.3, 1.5, np.log(2.0)),
    ],
)
def test_what_had_hidden_a_part_of_another_costs_the_odds_of_that_coincidence(monkeypatch, accepted_at, before, after, cost):
    """Against the other's size in a fit of the same weights without the one that is tried, not as it was accepted in others.

    A stronger brake had hidden two fifths of a mass. A memory of 0.3 interests, hidden by a wrong radius, may grow to 0.75,
    which is what matters.
    """
    with_it, without_it = Model(1e-4, (0.06,)), Model(2e-4, (0.06,))
    earlier = Accepted(trial(GRADIENT, 40.0, multiple=accepted_at), ("track_gradient",), 1.0)
    new = dataclasses.replace(trial(GAIN, 30.0), fitted=Fitted(with_it, (), (), (), 0.0), null_model=without_it)
    screen = type("Seen", (), {"whitening": None})()
    sizes = {with_it.tau: after, without_it.tau: before}
    monkeypatch.setattr(decide, "net_effect", lambda _, model, *__: StopChange(0.01 * sizes[model.tau], 0.0))
    assert decide._coincidence(None, [earlier], screen, new) == pytest.approx(cost)
    assert decide._coincidence(None, [], screen, new) == 0.0


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
        return exchange.Retested(one, SimpleNamespace(replica="its own")) if holds else None

    for name, value in (("refit", refit), ("retest", own), ("about_itself", lambda *given, without=None: given[-1])):
        monkeypatch.setattr(exchange, name, value)
    for name in ("weights_of", "Side", "ReplicaNoise"):
        monkeypatch.setattr(exchange, name, lambda *_, **__: None)
    monkeypatch.setattr(accepted, "net_effect", lambda *_: StopChange(0.02, 0.0))
    rival = dataclasses.replace(trial(GAIN, 40.0), fitted=Fitted(switched(bare, GAIN, np.array([0.06])), (GAIN,), (), (), 0.0))
    first = Accepted(trial(drag, 50.0), (drag.name,), 0.9, (rival,))
    later = Accepted(trial(GRADIENT, 40.0), (GRADIENT.name,), 1.0)
    before = SimpleNamespace(recorded=None)
    replica, fitted, kept = exchange.exchanged(
        before, refit(None, both, [drag, GRADIENT], None), [first, later], SimpleNamespace(whitening=None)
    )
    gives_way = gained > INDISTINCT and holds
    assert [one.name for one in kept] == (["track_gradient", GAIN.name] if gives_way else [drag.name, "track_gradient"])
    assert replica == ("its own" if gives_way else before)
    assert (GAIN.name in fitted.model.choice, drag.name in fitted.model.choice) == (gives_way, not gives_way)


@pytest.mark.parametrize(
    ("here", "without", "worse", "lost"),
    [
        (2.0, 200.0, False, True),
        (200.0, 2.0, False, True),
        (200.0, 200.0, False, False),
        (1800.0, -180.0, True, False),  # a memory of the contaminant layer, without which the later name fits far worse
        (-180.0, 1800.0, False, True),
    ],
)
def test_what_is_no_longer_sure_beside_a_later_name_is_taken_back(monkeypatch, here, without, worse, lost):
    """The first of two reduces the squares by so much about the model of both, and about the model without it.

    The side without it counts alone only where that model does not fit distinctly worse, each about itself.
    """
    whole = Fitted(Model(2e-4, (0.06,)), (GRADIENT, GAIN), (), (), 50.0)

    def side(less):
        return SimpleNamespace(replica="rest", compare=lambda _, variant, __: (less * (variant is GRADIENT), 0.0))

    monkeypatch.setattr(decide, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 50.0))
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "Side", lambda *_: side(here))
    monkeypatch.setattr(decide, "ReplicaNoise", lambda *_, **__: None)
    monkeypatch.setattr(
        decide, "begun", lambda _, fitted, *__: Step(None, fitted, dataclasses.replace(fitted, cost=5000.0 if worse else 50.0))
    )
    monkeypatch.setattr(decide, "own_side", lambda step, _: (side(without), step.fitted))
    first, last = (Accepted(trial(one, 40.0), (one.name,), 1.0) for one in (GRADIENT, GAIN))
    accepted, fitted = decide._backward_elimination(
        SimpleNamespace(recorded=None, rows=range(50)), [first, last], whole, SimpleNamespace(whitening=None)
    )
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
    kept = [Accepted(trial(GRADIENT, 40.0, multiple), ("track_gradient",), 1.0) for multiple in (0.5, MATTERS, 3.0)]
    outcome = decide.Outcome(None, None, tuple(kept), None, None, None)
    assert [one.trial.size.multiple for one in outcome.missing] == pytest.approx([MATTERS, 3.0])


@pytest.mark.parametrize(("evidence", "multiple", "expected"), [(40.0, 2.0, True), (40.0, 0.5, False), (5.0, 2.0, False)])
def test_beside_a_small_finding_the_search_goes_on_if_it_promises_one_that_matters(evidence, multiple, expected):
    """A false memory of 0.3 interests stood before sand of 2.2, which the search about it still found."""
    seen = SimpleNamespace(
        found=(found(GRADIENT, 1.0), dataclasses.replace(found(GAIN, evidence), multiple=np.array([multiple])))
    )
    assert decide._promises(seen) is expected


# --- curves


@pytest.mark.parametrize(
    ("unexplained", "size", "holds_not"),
    [(True, 0.0, []), (False, 0.0, []), (False, 0.5, []), (False, 2.0, ["track_gradient"])],
)
def test_curves_are_tried_once_and_only_where_what_is_left_matters(unexplained, size, holds_not, monkeypatch):
    """Or where something has evidence and matters, but does not hold: with curves it is asked again, and told."""
    searched: list[list[str]] = []

    def screened(replica, model, tried, accepted=(), noise_parameters=None):
        searched.append([one.title for one in tried])
        return SimpleNamespace(found=(), second={}, noise_parameters=None, noise=None)

    rejected = [dataclasses.replace(trial(GRADIENT, 40.0), size=StopChange(0.01 * size, 0.0))] if size else []
    monkeypatch.setattr(decide, "screen", screened)
    monkeypatch.setattr(decide, "terms", lambda replica, accepted=(): [TERM])
    monkeypatch.setattr(decide, "curves", lambda replica, accepted=(): [dataclasses.replace(TERM, family="a curve")])
    monkeypatch.setattr(decide, "Side", lambda *_: None)
    monkeypatch.setattr(decide, "ReplicaNoise", lambda *_, **__: None)
    monkeypatch.setattr(decide, "structured", lambda replica, seen, weights: SimpleNamespace(unexplained=unexplained))
    monkeypatch.setattr(decide, "weights_of", lambda replica, seen: None)
    monkeypatch.setattr(decide, "FormErrorThreshold", lambda *said: lambda one: SURE)
    monkeypatch.setattr(decide, "trials_of", lambda *said: [rejected])
    monkeypatch.setattr(decide, "_ends_at_bound", lambda *said: True)
    replica = SimpleNamespace(baseline=Model(2e-4, (0.06,)), rows=[], recorded=None)
    outcome = decide.select(replica, [GRADIENT])
    with_curves = [["track_gradient", "a curve"]] if unexplained or holds_not else []
    assert searched == [["track_gradient", TERM.family], *with_curves]
    assert not outcome.accepted
    assert [one.listed.title for one in outcome.rejected] == holds_not


@pytest.mark.parametrize("unexplained", [True, False])
def test_curves_are_also_tried_beside_what_is_too_small_to_matter(unexplained, monkeypatch):
    """Late wheel speeds within a sample came first in what a lubricator's spray left."""
    searched: list[list[str]] = []

    def screened(replica, model, tried, accepted=(), noise_parameters=None):
        searched.append([one.title for one in tried])
        return SimpleNamespace(found=(), second={}, noise_parameters=None, noise=None)

    fitted = Fitted(switched(Model(2e-4, (0.06,)), GAIN, np.array([0.01])), (GAIN,), (), (), 1.0)
    small = dataclasses.replace(trial(GAIN, 40.0, multiple=0.2), fitted=fitted)
    own = SimpleNamespace(noise_parameters=None, replica=None)
    contests = iter([(decide.Retested(small, own), {}, [small])])
    monkeypatch.setattr(decide, "screen", screened)
    monkeypatch.setattr(decide, "terms", lambda *_: [])
    monkeypatch.setattr(decide, "curves", lambda *_: [dataclasses.replace(TERM, family="a curve")])
    monkeypatch.setattr(decide, "structured", lambda *_: SimpleNamespace(unexplained=unexplained))
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "FormErrorThreshold", lambda *_: lambda _: SURE)
    monkeypatch.setattr(decide, "trials_of", lambda *_: [])
    monkeypatch.setattr(decide, "best_of", lambda *_: next(contests, (None, {}, [])))
    monkeypatch.setattr(decide, "_forward_step", lambda accepted, *_: (replica, fitted, accepted))
    replica = SimpleNamespace(baseline=Model(2e-4, (0.06,)), rows=[], recorded=None)
    outcome = decide.select(replica, [GRADIENT, GAIN])
    assert searched == [[GRADIENT.name, GAIN.name], [GRADIENT.name], *([[GRADIENT.name, "a curve"]] if unexplained else [])]
    assert [one.name for one in outcome.accepted] == [GAIN.name]
    assert outcome.missing == ()


@pytest.mark.parametrize("left", [1.0, 6.8])
def test_what_the_runs_leave_no_evidence_of_was_not_seen(left, monkeypatch):
    """Refused for what the parts of the recordings leave of it, as it is not sure: 6.8 nats are 94.6 %."""
    one = dataclasses.replace(trial(GRADIENT, 40.0), size=StopChange(0.02, 0.0))
    screened = SimpleNamespace(found=(), second={}, noise_parameters=None, noise=None)
    monkeypatch.setattr(decide, "screen", lambda *_, **__: screened)
    for name in ("terms", "curves"):
        monkeypatch.setattr(decide, name, lambda *_: [])
    monkeypatch.setattr(decide, "Side", lambda *_: None)
    monkeypatch.setattr(decide, "ReplicaNoise", lambda *_, **__: None)
    monkeypatch.setattr(decide, "structured", lambda *_: SimpleNamespace(unexplained=False))
    monkeypatch.setattr(decide, "weights_of", lambda *_: None)
    monkeypatch.setattr(decide, "FormErrorThreshold", lambda *_: lambda _: SURE)
    monkeypatch.setattr(decide, "trials_of", lambda *_: [[one]])
    monkeypatch.setattr(decide, "_ends_at_bound", lambda *_: False)
    fit = SimpleNamespace(fitted=SimpleNamespace(cost=1.0))
    monkeypatch.setattr(decide, "about_itself", lambda *given, without: SimpleNamespace(trial=given[-1], step=fit))
    monkeypatch.setattr(decide, "retest", lambda *_: decide.Retested(dataclasses.replace(one, evidence=left), None))
    outcome = decide.select(SimpleNamespace(baseline=Model(2e-4, (0.06,)), rows=[], recorded=None), [GRADIENT])
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
