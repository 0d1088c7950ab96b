"""Which of the tried mechanisms holds best."""

import dataclasses
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from trial_cases import GAIN, GRADIENT, INERTIA, MEMORY, TERM, found, trial

import wsp_env.diagnosis.contest
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.contest import best_of
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.retest import AboutItself, Retested, Step
from wsp_env.diagnosis.trials import SURE, log_odds

NULL = Model(2e-4, (0.06,))
EVIDENCE = {"brake_gain_imbalance": 40.0, "track_gradient": 50.0, "brake torque by braking": 60.0}
THREE = [trial(one, EVIDENCE[one.title]) for one in (GAIN, GRADIENT, TERM)]


class Compared(Retested):
    """One of which it is known by how much it exceeds others [nats], and what it leaves about itself."""

    more: ClassVar[dict[tuple[str, str], float]] = {}
    squares: ClassVar[dict[str, float]] = {}
    scatter = 44.7  # of a thousand rows

    @property
    def deviance(self):
        return self.squares.get(self.trial.listed.title, 1000.0)

    def exceeds(self, other):
        return self.more[self.trial.listed.title, other.trial.listed.title]


def contest(batches, evidence=None, rejects=lambda one: False, first_round=True, asked=None, squares=None):
    """Ask for the best, where the evidence from both sides is given by title; None: it is cancelled by nuisances.

    About its own replica each leaves `squares` by title, or as many as the others.
    """

    def about(one):
        cost = (squares or {}).get(one.listed.title, 1000.0)
        return AboutItself(one, Step(SimpleNamespace(rows=range(1000)), None, Fitted(NULL, (), (), (), cost)))

    Compared.squares = squares or {}

    def retest(here, own):
        assert here == "here"
        one = own.trial
        if asked is not None:
            asked.append(one.listed)
        value = (EVIDENCE | (evidence or {}))[one.listed.title]
        return None if value is None else Compared(dataclasses.replace(one, evidence=value), None)

    return best_of(batches, rejects, about, lambda: "here", retest, lambda one: SURE, first_round)


def test_what_is_refused_is_told_and_the_next_best_is_taken():
    best, rejected, _ = contest([THREE], rejects=lambda one: one.evidence > 45.0)
    assert best.trial.listed == GAIN
    assert list(rejected) == ["track_gradient", TERM.title]
    best, rejected, _ = contest([THREE], rejects=lambda one: True)
    assert best is None
    assert rejected.keys() == EVIDENCE.keys()
    assert rejected["track_gradient"] == log_odds(GRADIENT, 50.0)


@pytest.mark.parametrize(
    ("evidence", "expected", "refused"),
    [
        ({}, GRADIENT, []),
        ({GRADIENT.title: 35.0}, GAIN, []),
        ({GRADIENT.title: 1.0}, GAIN, [GRADIENT]),
        ({GRADIENT.title: None}, GAIN, [GRADIENT]),
        ({TERM.title: 90.0}, TERM, []),  # a term must explain more than the form of a name may lose: 0.64 of 90
        ({TERM.title: 75.0}, GRADIENT, []),
        ({GRADIENT.title: 1.0, GAIN.title: 1.0, TERM.title: 1.0}, None, [GAIN, GRADIENT, TERM]),
    ],
)
def test_trials_count_with_the_evidence_from_both_sides(evidence, expected, refused):
    best, rejected, trials = contest([THREE], evidence)
    assert (best and best.trial.listed) == expected
    assert list(rejected) == [one.title for one in refused]
    known = {one.listed.title: one.evidence for one in trials}
    assert known == {name: value if value is not None else EVIDENCE[name] for name, value in (EVIDENCE | evidence).items()}


@pytest.mark.parametrize(
    ("one", "found", "evidence", "tested"),
    [
        (TERM, 40.0, 38.8, False),  # it must replace a name, whose form may lose 36 %
        (TERM, 40.0, 39.2, True),
        (GAIN, 2.0, 12.4, False),  # the linear search said little of it, and the refit not enough
        (GAIN, 2.0, 12.6, True),
        (GAIN, 40.0, 1.0, True),  # a name of which the search said more
    ],
)
def test_what_explains_far_less_than_another_is_not_tested(one, found, evidence, tested):
    """Beside a gradient of 50 nats: both sides may have four times the evidence of one for a name, twice for a term."""
    weak = dataclasses.replace(trial(one, evidence), found=trial(one, found).found)
    asked = []
    _, rejected, _ = contest([[THREE[1], weak]], asked=asked)
    assert rejected == {}
    assert asked == [GRADIENT, *([one] if tested else [])]


@pytest.mark.parametrize(("deviation", "tested"), [(0.5, True), (0.7, False)])
def test_another_inertia_is_tested_though_it_explains_little_if_the_search_excludes_zero(deviation, tested):
    """Beside a gradient of 50 nats; one smallest effect of interest, with its deviation."""
    weak = trial(INERTIA, 0.3)
    weak = dataclasses.replace(weak, found=dataclasses.replace(weak.found, deviation=np.array([deviation])))
    asked = []
    contest([[THREE[1], weak]], {INERTIA.title: 40.0}, asked=asked)
    assert asked == [GRADIENT, *([INERTIA] if tested else [])]


def test_a_memory_is_tested_though_it_explains_nothing():
    """Its effect is nonlinear: about a replica without it, a refit may find it to be none."""
    asked = []
    contest([[THREE[1], trial(MEMORY, -5.0)]], {MEMORY.title: 40.0}, asked=asked)
    assert asked == [GRADIENT, MEMORY]


@pytest.mark.parametrize(("name", "tested"), [(76.0, True), (78.0, False)])
def test_a_term_that_cannot_replace_the_best_name_is_not_tested(name, tested):
    """Here 60 nats: 120 at most from both sides, of which the form of the name may lose 36 %."""
    asked = []
    best, _, trials = contest([THREE], {GRADIENT.title: name}, asked=asked)
    assert best.trial.listed == GRADIENT
    assert asked == [GAIN, GRADIENT, *([TERM] if tested else [])]
    assert {one.listed.title for one in trials} == EVIDENCE.keys()


@pytest.mark.parametrize(("here", "squares", "tested"), [(60.0, 600.0, True), (49.0, 600.0, False), (60.0, 990.0, False)])
def test_a_term_that_explains_more_here_than_the_name_and_fits_distinctly_better_is_tested(here, squares, tested):
    """The name has 50 nats here and 200 from both sides, too many for twice the evidence of the term."""
    asked, two = [], [THREE[1], trial(TERM, here)]
    contest([two], {GRADIENT.title: 200.0}, asked=asked, squares={TERM.title: squares})
    assert asked == [GRADIENT, *([TERM] if tested else [])]


@pytest.mark.parametrize(("first_round", "expected"), [(True, GAIN), (False, None)])
def test_the_next_batch_is_tried_if_nothing_holds_in_the_first_round(first_round, expected):
    batches = iter([[THREE[1]], [THREE[0]], [THREE[2]]])
    best, _, trials = contest(batches, {GRADIENT.title: 1.0}, first_round=first_round)
    assert (best and best.trial.listed) == expected
    assert [one.listed for one in trials] == ([GRADIENT, GAIN] if first_round else [GRADIENT])
    assert len(list(batches)) == (1 if first_round else 2)  # need not be made


@pytest.mark.parametrize("at_a_time", [1, 2])
@pytest.mark.parametrize(
    ("squares", "evidence", "tested", "refused"),
    [
        (1130.0, 170.0, [GRADIENT, GAIN], []),  # sums of 1000 squares scatter by 45
        (1140.0, 170.0, [GRADIENT], [GAIN]),
        (1140.0, 150.0, [GRADIENT, GAIN], []),  # the gain explains 40 nats here, and may have four times that from both sides
        (1140.0, None, [GRADIENT, GAIN], [GRADIENT]),  # what does not hold replaces nothing
    ],
)
def test_what_fits_distinctly_worse_about_itself_and_cannot_explain_as_much_as_what_holds_does_not_count(
    monkeypatch, squares, evidence, tested, refused, at_a_time
):
    """It is not tested after what holds; tested beside it, it is left out."""
    monkeypatch.setattr(wsp_env.diagnosis.contest, "_AT_A_TIME", at_a_time)
    asked = []
    _, rejected, _ = contest([THREE[:2]], {GRADIENT.title: evidence}, asked=asked, squares={GAIN.title: squares})
    assert asked == (tested if at_a_time == 1 else [GRADIENT, GAIN])
    assert list(rejected) == [one.title for one in refused]


@pytest.mark.parametrize(("here", "tested"), [(41.0, True), (39.0, False)])
def test_a_name_that_explains_more_here_than_one_that_holds_may_gain_as_much(monkeypatch, here, tested):
    """The gain has 40 nats here and 250 from both sides; the other name fits worse about itself."""
    monkeypatch.setattr(wsp_env.diagnosis.contest, "_AT_A_TIME", 1)
    asked, two = [], [THREE[0], trial(GRADIENT, here)]
    contest([two], {GAIN.title: 250.0}, asked=asked, squares={GRADIENT.title: 1140.0})
    assert asked == [GAIN, *([GRADIENT] if tested else [])]


@pytest.mark.parametrize(("evidence", "tested"), [(170.0, [GRADIENT]), (None, [GRADIENT, GAIN])])
def test_what_the_first_will_beat_as_it_is_here_waits_for_it(evidence, tested):
    """The gain explains 40 nats here, four times that is less than the gradient's 165; it is tested if that does not hold."""
    asked, two = [], [THREE[0], trial(GRADIENT, 165.0)]
    contest([two], {GRADIENT.title: evidence}, asked=asked, squares={GAIN.title: 1140.0})
    assert asked == tested


@pytest.mark.parametrize(
    ("squares", "more", "expected", "left"),
    [
        (900.0, 6.0, GAIN, 34.0),
        (900.0, -6.0, GRADIENT, 40.0),  # it has less evidence than that anyway
        (900.0, -30.0, GRADIENT, 20.0),
        (1000.0, None, GRADIENT, 40.0),  # fits no better: they are not compared
    ],
)
def test_a_name_with_less_evidence_that_fits_better_about_itself_is_compared_with_the_first(
    monkeypatch, squares, more, expected, left
):
    """The worse of the two has by so much less evidence than the better, which has 40 nats or 50."""
    monkeypatch.setattr(Compared, "more", {(GAIN.title, GRADIENT.title): more})
    best, _, trials = contest([THREE[:2]], squares={GAIN.title: squares})
    assert best.trial.listed == expected
    assert best.trial.evidence == EVIDENCE[expected.title]
    (other,) = [one for one in trials if one.listed != expected]
    assert other.evidence == left


@pytest.mark.parametrize(("squares", "expected", "left"), [(600.0, GAIN, 40.0 - 200.0), (950.0, TERM, 90.0)])
def test_a_term_that_fits_distinctly_worse_about_itself_than_a_name_is_behind_it(squares, expected, left):
    """Another inertia looks like noise, of which the replicas of others do not know: a term explains more of the rest."""
    best, _, trials = contest([THREE], {TERM.title: 90.0, GRADIENT.title: 1.0}, squares={GAIN.title: squares})
    assert best.trial.listed == expected
    assert next(one.evidence for one in [*trials, best.trial] if one.listed == TERM) == left


@pytest.mark.parametrize(
    ("squares", "expected"),
    [(950.0, GRADIENT), (955.0, GRADIENT), (600.0, TERM)],  # 25 nats of the term's 60 are less than a form error allows
)
def test_a_term_precedes_a_name_that_fits_distinctly_worse_about_itself(squares, expected):
    best, _, _ = contest([THREE], {TERM.title: 60.0}, squares={TERM.title: squares})
    assert best.trial.listed == expected


def test_fit_and_evidence_to_beat_are_those_of_one_name(monkeypatch):
    """The gain fits better than the mass and may explain less, the gradient explains far more and fits as well."""
    mass = Variant("vehicle_mass", ("change",), {})
    asked = []
    evidence = {mass.title: 15.0, GRADIENT.title: 70.0}
    monkeypatch.setattr(Compared, "more", {(GAIN.title, GRADIENT.title): -5.0})
    contest(
        [[*THREE[:2], trial(mass, 15.0)]], evidence, asked=asked,
        squares={GAIN.title: 1000.0, GRADIENT.title: 1060.0, mass.title: 1180.0},
    )  # fmt: skip
    assert asked == [GAIN, GRADIENT, mass]


@pytest.mark.parametrize(("evidence", "tested"), [(30.4, True), (3.0, False)])
def test_a_delay_is_tested_however_much_another_explains_here(evidence, tested):
    """A lag of the wheel speeds of 30 nats beside a false late brake of 249, which does not hold."""
    late, lag = (Variant(name, ("lag_s",), {}) for name in ("brake_delay", "wheel_speed_lag"))
    asked = []
    said = {late.title: 0.0, lag.title: 387.0, GAIN.title: 0.0}
    others = [dataclasses.replace(trial(one, 30.4), found=found(one, -1.0)) for one in (GAIN,)]
    mine = dataclasses.replace(trial(lag, evidence), found=found(lag, -1.0))
    best = contest([[trial(late, 249.0), mine, *others]], said, asked=asked).best
    assert asked == ([late, lag] if tested else [late])
    assert (best.trial.listed if best else None) == (lag if tested else None)
