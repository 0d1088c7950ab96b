"""Which of the tried mechanisms holds best."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from trial_cases import GAIN, GRADIENT, TERM, found, trial

from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.contest import NOT_SEEN, best_of
from wsp_env.diagnosis.retest import Retested
from wsp_env.diagnosis.trials import SURE, log_odds

INLINE = ThreadPoolExecutor(1)
SCATTER = 10.0
DRAG = Variant("dragging_brake", ("torque_nm",), {"axle": 2.0, "from_start": 0.0})


def equal_terms(evidence, scatter):
    return SimpleNamespace(evidence=lambda one, enough=0.0: evidence(one), scatter=scatter)


AS_IT_IS = equal_terms(lambda one: one.evidence, SCATTER)


def held(evidence):
    """Return what a trial is about a replica of its own: its evidence there is given by name."""
    return lambda one, suspended=None: Retested(dataclasses.replace(one, evidence=evidence[one.listed.title]), None)


EVIDENCE = {"brake_gain_imbalance": 40.0, "track_gradient": 50.0, "brake torque by braking": 60.0}
THREE = [dataclasses.replace(trial(one, EVIDENCE[one.title]), fitted=f"fit of {one.title}") for one in (GAIN, GRADIENT, TERM)]


def test_what_is_refused_is_told_and_the_next_best_is_taken():
    best, rejected, _ = best_of([THREE], lambda one: one.evidence > 45.0, held(EVIDENCE), AS_IT_IS, lambda one: SURE, INLINE)
    assert best.trial.listed == GAIN
    assert list(rejected) == ["track_gradient", TERM.title]
    best, rejected, _ = best_of([THREE], lambda one: True, held(EVIDENCE), AS_IT_IS, lambda one: SURE, INLINE)
    assert best is None
    assert rejected.keys() == EVIDENCE.keys()
    assert rejected["track_gradient"] == log_odds(GRADIENT, 50.0)


def test_a_trial_counts_as_it_stands_about_a_replica_of_its_own():
    """A name that falls behind the next one there is passed by it; one of which nothing is left is refused."""
    behind = best_of([THREE], lambda one: False, held(EVIDENCE | {"track_gradient": 35.0}), AS_IT_IS, lambda one: SURE, INLINE)
    assert behind[0].trial.listed == GAIN
    assert behind[1] == {}
    nothing = best_of([THREE], lambda one: False, held(EVIDENCE | {"track_gradient": 1.0}), AS_IT_IS, lambda one: SURE, INLINE)
    assert nothing[0].trial.listed == GAIN
    assert nothing[1] == {"track_gradient": log_odds(GRADIENT, 1.0)}  # as it stands: less likely than not


def test_on_equal_terms_all_that_hold_are_compared():
    """A brake that drags had 20 nats and a lighter vehicle 46; with own variances, they have 140 and 31."""
    compared = []

    def evidence(one):
        compared.append(one.listed)
        return one.evidence

    trials = [*THREE, dataclasses.replace(THREE[0], evidence=31.0, listed=DRAG)]
    retested = held(EVIDENCE | {DRAG.title: 31.0})
    best, _, _ = best_of([trials], lambda one: False, retested, equal_terms(evidence, SCATTER), lambda one: SURE, INLINE)
    assert best.trial.listed == GRADIENT
    assert compared == [GRADIENT, GAIN, TERM, DRAG]


def test_what_explains_little_linearly_may_explain_most_about_a_replica_of_its_own():
    """A heavier wheelset had 11 nats in the search and six when it was refitted; delays have been on their own replica."""
    little = dataclasses.replace(trial(GAIN, 6.0), found=found(GAIN, 11.0))
    late = dataclasses.replace(trial(Variant("brake_delay", ("lag_s",), {"axle": 0.0}), 2.0), found=found(GAIN, 11.0))
    retested = held({GAIN.title: 662.0, GRADIENT.title: 8.0, late.listed.title: 900.0})
    best, rejected, _ = best_of([[THREE[1], little, late]], lambda one: False, retested, AS_IT_IS, lambda one: SURE, INLINE)
    assert best.trial.listed == GAIN
    assert rejected == {}


@pytest.mark.parametrize(("holds", "expected", "left"), [(True, GAIN, [GRADIENT, TERM]), (False, GRADIENT, [GAIN])])
@pytest.mark.parametrize("first_round", [True, False])
def test_suspended_trials_are_tested_again_only_if_nothing_else_holds(holds, first_round, expected, left):
    """The gradient and the term are suspended; the gain holds or does not. With own variances the gradient has 55."""
    asked, some = [], [dataclasses.replace(THREE[0], evidence=52.0), *THREE[1:]]  # as good as they are

    def retest_trial(one, suspended):
        asked.append((one.listed, suspended))
        if one.listed == GAIN:
            return Retested(one, None) if holds else None
        evidence = {GRADIENT.title: 55.0, TERM.title: 20.0}[one.listed.title] if suspended else 1.0
        return Retested(dataclasses.replace(one, evidence=evidence), None, None if suspended else "fit")

    best, rejected, _ = best_of([some], lambda one: False, retest_trial, AS_IT_IS, lambda one: SURE, INLINE, first_round)
    assert best.trial.listed == expected
    second = [listed for listed, suspended in asked if suspended]
    assert second == ([GRADIENT, TERM] if expected == GRADIENT else [])
    assert rejected.keys() == {one.title for one in left}


def test_suspended_trials_wait_for_all_batches():
    """The gradient of the first batch is suspended, and would hold with own variances; the gain of the second one holds."""
    asked = []

    def retest_trial(one, suspended):
        asked.append((one.listed, suspended))
        return Retested(one, None, "fit" if one.listed == GRADIENT and not suspended else None)

    batches = iter([[THREE[1]], [THREE[0]], [THREE[2]]])
    found = best_of(batches, lambda one: False, retest_trial, AS_IT_IS, lambda one: SURE, INLINE)
    assert found.best.trial.listed == GAIN
    assert found.trials == [THREE[1], THREE[0]]
    assert asked == [(GRADIENT, None), (GAIN, None)]
    assert list(batches) == [[THREE[2]]]  # need not be made
    batches = iter([[THREE[1]], [THREE[0]]])  # later, only one batch is made
    assert best_of(batches, lambda one: False, retest_trial, AS_IT_IS, lambda one: SURE, INLINE, False).best.trial == THREE[1]
    assert list(batches) == [[THREE[0]]]


@pytest.mark.parametrize(
    ("own", "first_round", "holds"), [(6.0, True, True), (6.0, False, False), (7.0, False, True), (2.5, True, False)]
)
def test_a_further_finding_must_be_sure_on_equal_terms_the_first_only_within_the_scatter(own, first_round, holds):
    """Beside friction by speed, a patch of 17 nats has none with own variances. 6.9 nats are sure; 20 may lose 7.2 and 10."""
    some = [dataclasses.replace(THREE[0], evidence=20.0)]
    equal, retested = equal_terms(lambda one: own, SCATTER), held(EVIDENCE | {GAIN.title: 20.0})
    best, rejected, _ = best_of([some], lambda one: False, retested, equal, lambda one: SURE, INLINE, first_round)
    assert (best is not None) == holds
    assert rejected == ({} if holds else {GAIN.title: NOT_SEEN})


@pytest.mark.parametrize(
    ("as_found", "weak", "suspended", "multiple", "expected"),
    [
        (20.0, 2.0, 12.5, 3.0, GRADIENT),
        (20.0, 2.0, 11.5, 3.0, GAIN),  # not beyond the scatter
        (20.0, 2.0, 12.5, 0.75, GAIN),  # may be too small to matter
        (20.0, 2.6, 12.5, 3.0, GAIN),
        (20.0, 8.4, 99.0, 3.0, GAIN),  # it keeps 0.64 of its evidence, and the other was as good: nothing else is asked
        (20.0, 8.2, 99.0, 3.0, GRADIENT),
        (24.0, 12.0, 99.0, 3.0, GRADIENT),  # it was distinctly better when it was found
        (24.0, 12.0, 21.9, 3.0, GAIN),
    ],
)
def test_a_finding_gives_way_to_a_suspended_trial_beyond_the_scatter(as_found, weak, suspended, multiple, expected):
    """The gradient lost 249 nats with the given variances; the gain of the next batch has 13 there and `weak` with its own.

    What holds only within the scatter there may give way, and what was distinctly worse when it was found.
    """

    def retest_trial(one, begin):
        if one.listed == GRADIENT:
            lost = dataclasses.replace(one, evidence=-249.0)
            return Retested(lost, None, "fit") if begin is None else Retested(trial(GRADIENT, suspended, multiple), None)
        return Retested(dataclasses.replace(one, evidence=13.0), None)

    own = equal_terms(lambda one: weak, SCATTER)
    batches = [[dataclasses.replace(THREE[1], evidence=as_found)], [THREE[0]]]
    best, rejected, _ = best_of(batches, lambda one: False, retest_trial, own, lambda one: SURE, INLINE)
    assert best.trial.listed == expected
    assert expected.title not in rejected


@pytest.mark.parametrize(("gain", "expected"), [(80.0, GAIN), (26.0, GRADIENT)])
def test_of_suspended_trials_one_that_explains_more_by_the_scatter_is_taken_whatever_it_lost(gain, expected):
    """A gradient of 17 nats gains by own variances what it lost; a lighter vehicle lost 182 and has 112."""

    def retest_trial(one, begin):
        lost, own = {GRADIENT.title: (5.0, 17.0), GAIN.title: (-182.0, gain)}[one.listed.title]
        evidence = lost if begin is None else own
        return Retested(dataclasses.replace(one, evidence=evidence), None, "fit" if begin is None else None)

    best, rejected, _ = best_of([THREE[:2]], lambda one: False, retest_trial, AS_IT_IS, lambda one: SURE, INLINE)
    assert best.trial.listed == expected
    assert expected.title not in rejected


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ({}, GRADIENT),
        ({GRADIENT.title: 900.0, GAIN.title: 905.0}, GRADIENT),  # as good
        ({GRADIENT.title: 900.0, GAIN.title: 1000.0}, GAIN),
        ({GAIN.title: 50.0 + SCATTER}, GRADIENT),
        ({GAIN.title: 51.0 + SCATTER}, GAIN),
        ({GRADIENT.title: 900.0, TERM.title: 1100.0}, GRADIENT),  # a term must explain more than the name's form may lose
        ({GRADIENT.title: 900.0, TERM.title: 1500.0}, TERM),
        ({GRADIENT.title: 30.0, GAIN.title: 55.0}, GRADIENT),  # hardly more than the best had with the given variances
        ({GRADIENT.title: 0.65 * 50.0 - SCATTER}, GRADIENT),  # hardly as low as scatter and form allow
        ({GRADIENT.title: 0.63 * 50.0 - SCATTER}, GAIN),  # it fails; the next one is asked
        ({GRADIENT.title: -900.0, GAIN.title: -900.0}, TERM),
        ({GRADIENT.title: -900.0, GAIN.title: -900.0, TERM.title: -900.0}, None),
    ],
)
def test_trials_are_compared_on_equal_terms(own, expected):
    """Evidence with variances of its own residuals, where it differs."""

    def evidence(one):
        return own.get(one.listed.title, one.evidence)

    def retest_trial(one, suspended):
        return Retested(one if suspended is None else dataclasses.replace(one, evidence=evidence(one)), None)

    best, rejected, _ = best_of(
        [THREE], lambda one: False, retest_trial, equal_terms(evidence, SCATTER), lambda one: SURE, INLINE
    )
    assert (best and best.trial.listed) == expected
    assert set(rejected.values()) <= {NOT_SEEN}


@pytest.mark.parametrize(
    ("multiple", "found", "lost", "evidence", "holds"),
    [
        (0.9, 20.0, 1.0, 50.0, True),
        (0.9, 20.0, 1.0, 40.0, False),
        (0.7, 20.0, 1.0, 1e4, False),
        (2.0, 10.0, 1.0, 11.0, True),  # what it kept does not count
        (2.0, 10.0, 1.0, 10.0, False),
        (4.8, 72.0, -132.0, 136.0, True),  # truth N, n008: a mass of 5 %
        (0.9, 11.0, -11.0, 15.0, False),  # truth K, m001: a drag of a sound vehicle
        (3.3, 28.0, -938.0, 59.0, False),
    ],
)
def test_what_was_suspended_must_surely_matter_and_the_mean_of_its_evidence_be_sure(multiple, found, lost, evidence, holds):
    """0.9 interests with 50 nats are ten deviations from zero: 0.752 at least. 0.75 matters; 6.9 nats are sure."""

    def retest_trial(one, suspended):
        if suspended is None:
            return Retested(dataclasses.replace(one, evidence=lost), None, "fit")
        return Retested(trial(GRADIENT, evidence, multiple), None)

    tried = dataclasses.replace(THREE[1], evidence=found)
    best, rejected, _ = best_of([[tried]], lambda one: False, retest_trial, AS_IT_IS, lambda one: SURE, INLINE)
    assert (best is not None) == holds
    assert rejected == ({} if holds else {GRADIENT.title: NOT_SEEN})


@pytest.mark.parametrize(("own", "expected"), [(14.0, GRADIENT), (27.0 + SCATTER, TERM)])
def test_a_name_that_explains_less_about_its_own_replica_is_compared_with_a_term_on_equal_terms(own, expected):
    """It had 79 nats, and has 15 about its own replica; a term has 21 and 26. It must explain more by the scatter."""
    name, term = dataclasses.replace(THREE[1], evidence=79.0), dataclasses.replace(THREE[2], evidence=21.0)
    there = held({GRADIENT.title: 15.0, TERM.title: 26.0})

    def retest_trial(one, suspended):
        return there(one) if suspended is None else Retested(one, None)

    equal = equal_terms(lambda one: own if one.listed == TERM else one.evidence, SCATTER)
    best, _, _ = best_of([[name, term]], lambda one: False, retest_trial, equal, lambda one: SURE, INLINE)
    assert best.trial.listed == expected


def test_what_was_refused_may_be_a_rival_on_equal_terms():
    """It pulls nuisances whose variances are too large without it."""

    def retest_trial(one, suspended):
        return None if one.listed == GAIN and suspended is None else Retested(one, None)

    equal = equal_terms(lambda one: {GAIN.title: 1000.0}.get(one.listed.title, one.evidence), SCATTER)
    best, rejected, _ = best_of([THREE], lambda one: False, retest_trial, equal, lambda one: SURE, INLINE)
    assert best.trial.listed == GAIN
    assert rejected == {}


@pytest.mark.parametrize(("holds", "expected"), [(True, GAIN), (False, GRADIENT)])
def test_a_rival_must_hold_itself(holds, expected):
    def retest_trial(one, suspended):
        return Retested(one, None) if suspended is None or holds else None

    equal = equal_terms(lambda one: {GAIN.title: 1000.0}.get(one.listed.title, one.evidence), SCATTER)
    best, _, _ = best_of([THREE], lambda one: False, retest_trial, equal, lambda one: SURE, INLINE)
    assert best.trial.listed == expected


def test_a_delay_is_compared_with_all_others():
    """It was found in another way: about its own replica, with own variances."""
    late = dataclasses.replace(THREE[0], listed=Variant("brake_delay", ("lag_s",), {"axle": 0.0}), evidence=900.0)
    equal = equal_terms(lambda one: {GAIN.title: 3000.0}.get(one.listed.title, one.evidence), SCATTER)
    best, _, _ = best_of(
        [[*THREE, late]], lambda one: False, held(EVIDENCE | {"brake_delay": 900.0}), equal, lambda one: SURE, INLINE
    )
    assert best.trial.listed == GAIN
