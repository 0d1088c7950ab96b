"""Mechanisms on trial: where refits begin, whose merit counts, weights and forms; replicas that settle."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import GAIN, GRADIENT, INERTIA, MEMORY, TERM, found, trial, unfreed

from wsp_env.diagnosis import convergence, form_errors, trials
from wsp_env.diagnosis.candidates import Variant, switched, values_in
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.trials import FORM
from wsp_env.plant.mechanisms.terms import Feature


@pytest.fixture(autouse=True)
def no_small_mechanisms(monkeypatch):
    monkeypatch.setattr(trials, "freed", unfreed)


@pytest.mark.parametrize(("own", "expected"), [(0.0, 0.0), (12.0, 12.0)])
def test_what_those_before_explain_better_is_no_merit_of_the_next(monkeypatch, own, expected):
    """A fit in which an accepted gain is at its right size costs 80 less, whatever is tried beside it, which adds 2 own."""

    def refit(_, model, variants, __):
        # The gain finds its way from a start that holds something else beside it, or from its right size.
        right = "track_gradient" in model.choice or values_in(model, GAIN)[0] == 0.1
        model = switched(model, GAIN, np.array([0.1 if right else 0.05]))
        cost = 100.0 - 80.0 * right - 2.0 * own * ("track_gradient" in model.choice)
        return Fitted(model, tuple(variants), (), (), cost)

    monkeypatch.setattr(trials, "refit", refit)
    monkeypatch.setattr(trials, "cost", lambda *_: 0.0)
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    seen = dataclasses.replace(found(GRADIENT, 5.0), reduction=10.0)
    screen = SimpleNamespace(found=[seen], second={}, whitening=None)
    before = Fitted(switched(Model(2e-4, (0.06,)), GAIN, np.array([0.05])), (GAIN,), (), (), 0.0)
    ((one,),) = trials.trials_of(None, screen, before, None)
    assert one.reduction == pytest.approx(2.0 * expected)
    assert one.evidence == pytest.approx(5.0 + expected - 5.0)


@pytest.mark.parametrize(
    ("variant", "multiple", "tried"),
    [(INERTIA, -0.61, True), (INERTIA, 0.54, True), (INERTIA, 0.2, False), (GRADIENT, -0.61, False)],
)
def test_another_inertia_that_the_search_does_not_find_is_tried_if_its_interval_excludes_zero(
    monkeypatch, variant, multiple, tried
):
    """Beside a gain that the search finds; a deviation of 0.18: 0.3 at 90 %."""
    monkeypatch.setattr(trials, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 0.0))
    monkeypatch.setattr(trials, "cost", lambda *_: 0.0)
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    unseen = dataclasses.replace(found(variant, 0.2), multiple=np.array([multiple]), deviation=np.array([0.18]))
    screen = SimpleNamespace(found=[found(GAIN, 30.0), unseen], second={}, whitening=None)
    start = Fitted(Model(2e-4, (0.06,)), (), (), (), 0.0)
    (batch,) = trials.trials_of(None, screen, start, None)
    assert [one.listed for one in batch] == [GAIN, *([variant] if tried else [])]


@pytest.mark.parametrize("accepted", [(), (GRADIENT,)])
def test_a_memory_of_which_the_search_finds_nothing_is_tried_beside_what_it_finds(monkeypatch, accepted):
    """In each round, but only once: it comes with the first batch, and not alone."""
    monkeypatch.setattr(trials, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 0.0))
    monkeypatch.setattr(trials, "cost", lambda *_: 0.0)
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    unseen = found(MEMORY, -1.0)
    start = Fitted(Model(2e-4, (0.06,)), accepted, (), (), 0.0)
    (batch,) = trials.trials_of(
        None, SimpleNamespace(found=[found(GAIN, 30.0), unseen], second={}, whitening=None), start, None
    )
    assert [one.listed for one in batch] == [GAIN, MEMORY]
    assert list(trials.trials_of(None, SimpleNamespace(found=[unseen], second={}, whitening=None), start, None)) == []


@pytest.mark.parametrize(("best", "amplitude"), [(2.0, 1.0), (0.25, 1.0), (0.1, 1.0), (0.05, 20.0), (5.0, 0.2)])
def test_a_refit_begins_where_the_way_to_the_linear_step_leaves_least(monkeypatch, best, amplitude):
    """Residuals bend: the linear step of a wheel that is turned by a per cent leads beyond what can be fitted.

    The search's own step is on the way, whatever the linear one is beside it.
    """
    step = float(-GRADIENT.moves()[0] * amplitude)
    begun = []

    def refit(_, model, variants, __):
        begun.append(values_in(model, GRADIENT)[0] / step if "track_gradient" in model.choice else None)
        return Fitted(model, tuple(variants), (), (), 0.0 if variants else 100.0)

    monkeypatch.setattr(trials, "refit", refit)
    monkeypatch.setattr(trials, "cost", lambda _, model, __: abs(np.log(values_in(model, GRADIENT)[0] / step / best)))
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    stepped = dataclasses.replace(found(GRADIENT, 5.0), amplitude=np.array([amplitude]))
    screen = SimpleNamespace(found=[stepped], second={}, whitening=None)
    list(trials.trials_of(None, screen, Fitted(Model(2e-4, (0.06,)), (), (), (), 100.0), None))
    assert begun[1] == pytest.approx(best)


def test_names_come_first_and_further_terms_only_when_they_are_asked_for(monkeypatch):
    """Delays take no place of another; they are tried with the first."""
    names = [found(Variant(name, GRADIENT.sizes, {}), 20.0) for name in ("sanding", "vehicle_mass", "pad_friction")]
    unnamed = [
        found(Variant("discovered", ("coefficient_1",), {"slot_1": 0.0, "feature_1": float(i)}, (100.0,), f"by {i}"), 60.0 - i)
        for i in range(trials.REFITTED + 2)
    ]
    delays = [
        found(Variant(name, ("lag_s",), {}), evidence) for name, evidence in (("brake_delay", 70.0), ("wheel_speed_lag", -9.0))
    ]
    refitted = []
    monkeypatch.setattr(trials, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 100.0))
    best_fit = SimpleNamespace(fitted=SimpleNamespace(model=None), variant=None, null_model=None, reduction=9.0)
    monkeypatch.setattr(trials, "_fit_on_replica", lambda *said: refitted.append(said[-1].name) or best_fit)
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    monkeypatch.setattr(trials, "refined", lambda variant: variant)
    screen = SimpleNamespace(found=[*names, *unnamed, *delays], second={}, whitening=None)
    some = trials.trials_of(None, screen, Fitted(Model(2e-4, (0.06,)), (), (), (), 100.0), None)
    first = {one.name for one in (*names, *unnamed[: trials.REFITTED], *delays)}
    assert {one.listed.title for one in next(some)} == first
    assert len(refitted) == len(first)
    assert {one.listed.title for one in next(some)} == {one.name for one in unnamed[trials.REFITTED :]}
    assert next(some, None) is None


def test_terms_that_differ_only_in_their_axles_do_not_keep_others_from_a_trial(monkeypatch):
    """Six groups of axles with one feature have more than a gain and another term; the best of the six is tried."""

    def term(axles, feature):
        codes = {"slot_1": 0.0, "feature_1": feature, "axles_1": axles}
        return Variant("discovered", ("coefficient_1",), codes, (100.0,), f"torque of {axles} by {feature}")

    groups = [found(term(float(axles), 27.0), 200.0 + axles) for axles in range(6)]
    others = [found(GAIN, 90.0), found(term(0.0, 11.0), 80.0), found(GRADIENT, 70.0)]
    monkeypatch.setattr(trials, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 100.0))
    monkeypatch.setattr(trials, "cost", lambda *_: 0.0)
    monkeypatch.setattr(trials, "net_effect", lambda *_: StopChange(0.02, 0.0))
    screen = SimpleNamespace(found=[*groups, *others], second={}, whitening=None)
    accepted = Fitted(Model(2e-4, (0.06,)), (GAIN,), (), (), 100.0)
    (tried,) = trials.trials_of(None, screen, accepted, None)
    assert {one.listed.title for one in tried} == {groups[5].name, *(one.name for one in others)}


@pytest.mark.parametrize(("late", "expected"), [(-30.0, 90.0), (40.0, 50.0), (120.0, -30.0)])
def test_of_a_term_that_follows_the_torque_only_what_no_late_brake_explains_counts(late, expected):
    play = Variant("discovered", ("coefficient_1",), {"slot_1": 0.0, "feature_1": float(Feature.TORQUE_PLAY)}, (100.0,), "play")
    fading = Variant(
        "discovered", ("coefficient_1",), {"slot_1": 0.0, "feature_1": float(Feature.TORQUE_SETTLING)}, (100.0,), "f"
    )
    delay = Variant("brake_delay", ("lag_s",), {"axle": 0.0})
    lag = Variant("wheel_speed_lag", ("lag_s",), {})  # of a sensor: that is no late brake
    tried = [trial(play, 90.0), trial(fading, 80.0), trial(delay, late), trial(lag, 500.0)]
    explained = trials._evidence_of_late_brakes(tried, 0.0)
    assert trials._evidence_of_late_brakes(tried, 200.0) == 200.0  # of an earlier batch
    found = {one.listed.title: one for one in trials._beyond_delays(tried, explained)}
    assert found["play"].evidence == expected
    assert found["play"].evidence + found["play"].penalty == 90.0
    assert [found[name].evidence for name in ("f", "brake_delay", "wheel_speed_lag")] == [80.0, late, 500.0]


def test_a_form_at_its_end_is_left_for_one_that_is_not(monkeypatch):
    """A patch whose edges would be as long as they may be, though it fits best, is taken as it was searched."""
    patch = Variant("adhesion_patch", ("change",), {"start_m": 300.0, "length_m": 60.0, "edge_m": 1.0}, (-0.3,))

    def refit(_, model, variants, __):
        wide = bool(variants) and "edge_m" in variants[-1].sizes
        if wide:
            model = switched(model, variants[-1], np.array([-0.2, 300.0, 60.0, 100.0]))
        return Fitted(model, tuple(variants), (), (), 60.0 if wide else 80.0 if variants else 100.0)

    monkeypatch.setattr(trials, "refit", refit)
    monkeypatch.setattr(trials, "cost", lambda *_: 0.0)
    one = dataclasses.replace(found(patch, 5.0), reduction=20.0)
    start = Fitted(Model(2e-4, (0.06,)), (), (), (), 100.0)
    tried = trials._fit_on_replica(None, start, None, one)
    assert tried.variant.sizes == ("change",)
    assert tried.reduction == pytest.approx(20.0)


def test_a_term_s_form_may_miss_more_than_a_name_s():
    assert trials.form_of(TERM) > trials.form_of(GRADIENT) == FORM


@pytest.mark.parametrize(("factor", "way", "made"), [(0.0, 8.0, 2), (0.4, 8.0, 4), (0.95, 80.0, 8)])
def test_replicas_are_made_until_sizes_settle(monkeypatch, factor, way, made):
    """Each refit goes a share of the rest of the way, in deviations."""
    replicas = []

    def refit(_, model, variants, __):
        values = way * (1.0 - factor ** len(replicas))
        return Fitted(model, tuple(variants), (np.array([values]),), (np.eye(1),), 0.0)

    monkeypatch.setattr(convergence, "replica_of", lambda *_: replicas.append(1) or SimpleNamespace(rows=range(100)))
    monkeypatch.setattr(convergence, "refit", refit)
    first = Fitted(Model(2e-4, (0.06,)), (GRADIENT,), (np.zeros(1),), (np.eye(1),), 0.0)
    _, fitted = convergence.converge(None, first, None)
    assert len(replicas) == made
    assert fitted.values[0][0] == pytest.approx(way * (1.0 - factor**made))


def test_where_a_replica_fits_worse_half_of_the_way_is_gone(monkeypatch):
    """A refit always asks for as much again; about replicas beyond a size the model fits worse."""

    class About(float):
        """The replica about a size."""

        rows = range(1000)

    far, cost = 0.011, 1000.0

    def refit(replica, model, variants, _):
        rise = model.choice[GRADIENT.name]["rise"]
        end = rise + 0.004 if variants else rise
        worse = 1e6 * max(replica - far, 0.0)
        return Fitted(
            switched(model, GRADIENT, np.array([end])), tuple(variants), (np.array([end]),), (1e-8 * np.eye(1),), cost + worse
        )

    monkeypatch.setattr(convergence, "replica_of", lambda _, model, __: About(model.choice[GRADIENT.name]["rise"]))
    monkeypatch.setattr(convergence, "refit", refit)
    begin = Fitted(
        switched(Model(2e-4, (0.06,)), GRADIENT, np.array([0.008])),
        (GRADIENT,),
        (np.array([0.008]),),
        (1e-8 * np.eye(1),),
        cost,
    )
    replica, fitted = convergence.converge(None, begin, None)
    assert far - 0.001 < replica <= far + 3.0 * np.sqrt(2.0 * cost) / 1e6
    assert fitted.values[0][0] == replica  # what the replica is about, not what a refit asks for beyond
    assert fitted.cost < cost + 3.0 * np.sqrt(2.0 * cost)


@pytest.mark.parametrize("truth", [0.0098, 0.0152, 0.031])
def test_what_a_refit_has_lost_begins_at_the_share_that_fits_best_about_its_own_replica(monkeypatch, truth):
    """A gradient that the straight line puts at 20 per mille; the fit about a replica goes from there to a valley beside it."""

    def refit(replica, model, variants, _):
        rise = model.choice[GRADIENT.name]["rise"]
        near = abs(replica - truth) < 0.003
        end = (truth if near else rise + 0.01) if variants else rise
        cost = 100.0 + 1e6 * abs(end - truth)
        return Fitted(switched(model, GRADIENT, np.array([end])), tuple(variants), (np.array([end]),), (np.eye(1),), cost)

    monkeypatch.setattr(convergence, "replica_of", lambda _, model, __: model.choice[GRADIENT.name]["rise"])
    monkeypatch.setattr(convergence, "refit", refit)
    ran = Fitted(switched(Model(2e-4, (0.06,)), GRADIENT, np.array([0.02])), (GRADIENT,), (), (), 5000.0)
    fitted = convergence.rescaled(None, ran, GRADIENT, None, (0.5, 0.75, 1.25, 1.5))
    assert fitted.values[0][0] == pytest.approx(truth)
    assert fitted.cost == pytest.approx(100.0)


def test_a_share_of_a_size_leaves_where_it_acts():
    patch = Variant("adhesion_patch", ("change", "start_m", "length_m"), {})
    assert convergence._scaled(patch, np.array([-0.4, 300.0, 60.0]), 0.5) == pytest.approx([-0.2, 300.0, 60.0])
    slope = Variant("initial_slope", ("factor",), {})
    assert convergence._scaled(slope, np.array([0.4]), 1.5) == pytest.approx([0.1])


@pytest.mark.parametrize("alike", [0.0, 0.6, 1.0])
def test_the_form_of_what_was_accepted_lends_evidence_to_what_looks_like_it(monkeypatch, alike):
    """A gain of 1000 nats whose form may miss 20 % lends 108 to what looks like it bent, nothing to what is at right angles."""
    rng = np.random.default_rng(1)
    bend, further, law, weak = np.linalg.qr(rng.standard_normal((300, 4)))[0].T
    effect = np.full(300, 1.0)
    for one in (bend, further, law, weak):  # as seen beside the law, the forms are at right angles to the effect
        one -= one.mean()
    bend, further, law, weak = np.linalg.qr(np.column_stack([bend, further, law, weak]))[0].T
    another = alike * bend + np.sqrt(1.0 - alike**2) * further + 5.0 * law  # mu_cd takes the last part
    rows = {"off": another, "on": np.zeros(300), "accepted": np.zeros(300), "without": effect}
    monkeypatch.setattr(form_errors, "law_columns", lambda *_: law[:, None])
    monkeypatch.setattr(form_errors, "segment_columns", lambda *_: np.zeros((300, 0)))
    monkeypatch.setattr(form_errors, "shapes", lambda _: np.column_stack([7.0 * bend + 0.5, 0.007 * weak]))
    monkeypatch.setattr(form_errors, "without", lambda model, _: "off" if model == "on" else "without")
    replica = SimpleNamespace(raw=rows.get)
    screen = SimpleNamespace(whitening=lambda columns: columns)
    trial = SimpleNamespace(fitted=SimpleNamespace(model="on"), variant=GRADIENT, reduction=1e4)
    least = form_errors.FormErrorThreshold(replica, "accepted", [(GAIN, 1000.0)], screen)
    assert least(trial) == pytest.approx(max(trials.SURE, (1.645 * FORM) ** 2 * 1000.0 * alike**2), rel=1e-6)
    trial.reduction = 80.0  # of its own it can take no more than what looks like the form
    assert least(trial) == pytest.approx(max(trials.SURE, 40.0 * alike**2), rel=1e-6)
    rows["off"] = weak  # where the form hardly acts it leaves little
    assert least(trial) == trials.SURE
    assert form_errors.FormErrorThreshold(replica, "accepted", [], screen)(trial) == trials.SURE


@pytest.mark.parametrize(("shrinks", "rests"), [(0.2, True), (0.7, True), (0.95, False), (1.0, False)])
def test_a_size_that_moves_on_from_replica_to_replica_does_not_hold(shrinks, rests, monkeypatch):
    """Each replica moves it by so much of the move before: where the moves hardly shrink it has no end."""
    at = {"size": 0.0, "move": 30.0}

    def refit(replica, model, variants, weights):
        at["size"], at["move"] = at["size"] + at["move"], shrinks * at["move"]
        return Fitted(model, tuple(variants), (np.array([at["size"]]),), (np.eye(1),), 100.0)

    monkeypatch.setattr(convergence, "replica_of", lambda *_: SimpleNamespace(rows=range(100)))
    monkeypatch.setattr(convergence, "refit", refit)
    begin = Fitted(Model(2e-4, (0.06,)), (GAIN,), (np.zeros(1),), (np.eye(1),), 100.0)
    _, fitted = convergence.converge(None, begin, None)
    assert np.isfinite(fitted.cost) == rests
