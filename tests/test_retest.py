"""Whether what was tried holds from both sides: about the replica without it, and about a replica of its own."""

import dataclasses
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from trial_cases import BENT, GAIN, GRADIENT, PLAIN, TERM, trial, unfreed

from wsp_env.diagnosis import retest
from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.candidates import Variant, switched, values_in
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.noise import Noise
from wsp_env.diagnosis.trials import PRIOR, SURE
from wsp_env.diagnosis.variation import Group
from wsp_env.diagnosis.weights import Weights


class Rows(NamedTuple):
    """Speeds of a hundred rows."""

    speed: np.ndarray = np.array([20.0])

    def __len__(self) -> int:
        return 100


#: What is asked of a replica and of a screen.
ROWS = Rows()
HERE = SimpleNamespace(name="here", recorded=None, sample_s=0.01, rows=ROWS)
SEEN = SimpleNamespace(whitening=None)
NULL = Model(2e-4, (0.06,))
ON = switched(NULL, GRADIENT, np.array([0.002]))
PENALTY = 3.0


@pytest.fixture(autouse=True)
def no_small_mechanisms(monkeypatch):
    monkeypatch.setattr(retest, "freed", unfreed)


@pytest.fixture
def ask(monkeypatch):
    """What is said of a gradient that reduces the squares by so much on both sides."""

    def asked(
        here: float, own: float, shift: float = 0.0, left: float = 20.0, interval: tuple[float, float] = (0.001, 0.003),
        itself: float = 100.0, worse: bool = False, again: float = -np.inf,
    ) -> retest.Retested | None:  # fmt: skip
        fitted = Fitted(ON, (GRADIENT,), (np.array([0.002]),), (np.eye(1),), 100.0)
        one = dataclasses.replace(trial(GRADIENT, 30.0), fitted=fitted, reduction=6.0, penalty=PENALTY)
        fitted = dataclasses.replace(fitted, cost=itself)

        def side(name, less):
            replica = SimpleNamespace(name=name, recorded=None, sample_s=0.01, rows=ROWS)
            return SimpleNamespace(
                replica=replica, weights=PLAIN, compare=lambda *_: (less, shift), noise_parameters=name,
                fits_worse=lambda other: worse,
            )  # fmt: skip

        monkeypatch.setattr(retest, "own_side", lambda step, seen: (side("own", own), step.fitted))
        monkeypatch.setattr(retest, "estimates", lambda *_: {"rise": Estimate(0.002, "-", interval)})
        monkeypatch.setattr(retest, "net_effect", lambda *_: StopChange(0.04, 0.0))
        monkeypatch.setattr(retest, "agreement", lambda *_: SimpleNamespace(student_evidence=lambda evidence: left))
        return retest.retest(SEEN, side("here", here), retest.AboutItself(one, retest.Step(HERE, fitted, fitted), again))

    return asked


@pytest.mark.parametrize(
    ("here", "own", "reduction"),
    [
        (60.0, 80.0, 70.0),
        (80.0, 60.0, 70.0),
        (10.0, 8600.0, 4305.0),  # a memory hardly shows about a replica without it
        (5.9, 133.4, 5.9),  # a false lag of 11 ms: 3 nats here do not pay for its variants
        (133.4, 5.9, 5.9),
        (60.0, -400.0, -400.0),
    ],
)
def test_evidence_is_the_mean_of_both_sides_if_neither_speaks_against_it(ask, here, own, reduction):
    """Three nats are the price of its variants."""
    held = ask(here, own)
    assert held.trial.reduction == reduction
    assert held.trial.evidence == 0.5 * reduction - PENALTY
    if here > 2.0 * PENALTY:  # else its own side is not made
        assert held.trial.size == StopChange(0.04, 0.0)
        assert held.own.noise_parameters == "own"


@pytest.mark.parametrize(("itself", "reduction"), [(63.0, 4300.5), (65.0, 1.0)])
def test_a_side_that_speaks_against_a_better_fit_does_not_count_alone(ask, itself, reduction):
    """A memory that does not show about a replica without it. Without it 106 squares are left there; they scatter by 14."""
    assert ask(1.0, 8600.0, itself=itself).trial.reduction == reduction
    assert ask(8600.0, 1.0, itself=itself).trial.reduction == 1.0  # not needed about itself
    # A false memory of 0.7 m: with weights of its own it leaves a larger deviance than the law.
    assert ask(1.0, 8600.0, itself=itself, worse=True).trial.reduction == 1.0


def test_what_fits_worse_about_itself_than_nothing_has_no_evidence_from_both_sides(ask):
    """A false delay: each side extrapolates in its favour."""
    assert ask(540.0, 1386.0, worse=True, itself=110.0).trial.evidence == -PENALTY
    # Deviances with noise of their own do not refuse what fits as well with the same weights: a coupler's force.
    assert ask(498.0, 4240.0, worse=True, itself=100.0).trial.reduction == 2369.0


@pytest.mark.parametrize(("again", "holds"), [(-np.inf, False), (106.0, False), (118.0, True)])
def test_what_fits_as_well_as_the_law_about_a_replica_made_again_counts(ask, again, holds):
    """The weights of a round shift the law: made again, it leaves more than the 106 squares about its first replica."""
    assert (ask(60.0, 80.0, worse=True, itself=117.0, again=again).trial.evidence == 70.0 / 2.0 - PENALTY) == holds


@pytest.mark.parametrize(("deviance", "worse"), [(17670.0, False), (17951.0, True)])
def test_a_model_fits_worse_if_its_deviance_about_itself_is_larger(side, deviance, worse):
    """By less than such a sum of squares scatters, 125 of 7800 rows: both are of the same recordings."""
    replica = SimpleNamespace(rows=range(7800), recorded=None)

    def known(value):
        return retest.Weighted(Fitted(NULL, (), (), (), 0.0), None, value)

    own, here = (retest.Side(replica, SEEN, PLAIN, None, known=known(value)) for value in (deviance, 17704.0))
    assert own.fits_worse(here) == worse
    assert here.fits_worse(own) != worse


@pytest.mark.parametrize(("about_mine", "about_others", "exceeds"), [(30.0, -10.0, 3.0), (30.0, -50.0, -7.0)])
def test_two_names_are_compared_about_both_replicas(about_mine, about_others, exceeds):
    """By the mean of both; `about_*`: by how much the other leaves a larger deviance there. It costs 2 nats less."""
    fits = [Fitted(NULL, (one,), (), (), 0.0) for one in (GRADIENT, GAIN)]
    mine = dataclasses.replace(trial(GRADIENT, 30.0), fitted=fits[0], penalty=PENALTY)
    other = dataclasses.replace(trial(GAIN, 30.0), fitted=fits[1], penalty=PENALTY - 2.0)

    def side(less):
        deviance = {GRADIENT.title: 1000.0, GAIN.title: 1000.0 + less}
        return SimpleNamespace(fit=lambda model, variants: SimpleNamespace(deviance=deviance[variants[0].title]))

    first, second = retest.Retested(mine, side(about_mine)), retest.Retested(other, side(about_others))
    assert first.exceeds(second) == pytest.approx(exceeds)
    assert second.exceeds(first) == pytest.approx(-exceeds)


@pytest.mark.parametrize(
    ("variant", "moved", "begins", "ends", "begun"),
    [
        (GRADIENT, 2.0, 90.0, 80.0, "step"),  # the refit had lost it
        (GRADIENT, 2.0, 90.0, 120.0, "refit"),
        (GRADIENT, 2.0, 110.0, 80.0, "refit"),  # what begins worse is not followed
        (GRADIENT, 0.5, 90.0, 80.0, "refit"),  # the step leads back to the same place
        (TERM, 2.0, 90.0, 80.0, "refit"),  # a term is linear
    ],
)
def test_what_a_refit_has_lost_is_sought_from_the_linear_step(monkeypatch, variant, moved, begins, ends, begun):
    """Of both beginnings that one counts about whose replica less is left; `moved`: deviations between them."""
    at = {"refit": 0.002, "step": 0.002 + moved}
    fits = {name: Fitted(ON, (GRADIENT,), (np.array([value]),), (np.eye(1),), begins) for name, value in at.items()}
    monkeypatch.setattr(retest, "rescaled", lambda *_: fits["step"])
    monkeypatch.setattr(retest, "_linear", lambda one: one.fitted)

    def steps(_, fitted, weights, seen):
        return retest.Step(HERE, fitted, dataclasses.replace(fitted, cost=100.0 if fitted is fits["refit"] else ends))

    monkeypatch.setattr(retest, "begun", steps)
    one = dataclasses.replace(trial(variant, 30.0), fitted=fits["refit"])
    assert retest.about_itself(None, PLAIN, SEEN, one).step.begin is fits[begun]


@pytest.mark.parametrize(("interval", "holds"), [((1e-6, 0.004), True), ((-1e-6, 0.004), False)])
def test_a_name_whose_own_interval_leaves_it_open_does_not_hold(ask, interval, holds):
    assert ask(60.0, 80.0, interval=interval).trial.evidence == (32.0 if holds else -PENALTY)


@pytest.mark.parametrize(("itself", "tested"), [(190.0, True), (195.0, False), (300.0, False)])
def test_what_fits_far_worse_about_itself_with_the_same_weights_is_not_tested(ask, itself, tested):
    """The law leaves 106; such sums scatter by 15."""
    answer = ask(60.0, 80.0, itself=itself)
    assert (answer.own.replica.name == "own") == tested
    assert (answer.trial.evidence == -PENALTY) == (not tested)


@pytest.mark.parametrize(("within", "multiple", "matters"), [(False, 1.0, True), (True, 1.0, False), (False, 0.7, False)])
def test_a_delay_that_may_be_within_a_sample_holds_and_is_no_finding(ask, monkeypatch, within, multiple, matters):
    monkeypatch.setattr(retest, "within_a_sample", lambda *_: within)
    answer = ask(60.0, 80.0).trial
    assert answer.evidence == 70.0 / 2.0 - PENALTY
    assert dataclasses.replace(answer, size=StopChange(0.01 * multiple, 0.0)).matters == matters


def test_what_shifts_nuisances_or_is_not_alike_in_the_runs_does_not_hold(ask):
    assert ask(60.0, 80.0, shift=5.0**2) is None
    assert ask(60.0, 80.0, shift=3.0**2).trial.evidence == 32.0
    left = SURE - PRIOR - 0.1
    assert ask(60.0, 80.0, left=left).trial.evidence == left  # which is no longer sure
    assert ask(60.0, 80.0, left=SURE - PRIOR + 0.1).trial.evidence == 32.0


@pytest.fixture
def side(monkeypatch):
    """Make sides whose fits cost what is said: without the gradient 100, with it so much at rest and with bent forms."""
    asked: list[Model] = []

    def made(plain: float = 60.0, bent: float = 60.0, **said: object) -> retest.Side:
        def refit(_, model, variants, weights):
            cost = 100.0 if GRADIENT not in variants else bent if weights is BENT else plain
            assert (GRADIENT.name in model.choice) == (GRADIENT in variants)
            return Fitted(model, tuple(variants), (), (), cost - 1e3 * values_in(model, GRADIENT)[0] * (GRADIENT in variants))

        def noise(model):
            asked.append(model)
            return SimpleNamespace(weights=lambda: PLAIN)

        monkeypatch.setattr(retest, "refit", refit)
        bends = [Group("form", np.ones((1, 2)), 0.2, True)]
        monkeypatch.setattr(retest, "forms", lambda _, __, variants, ___: bends if list(variants) == [GAIN] else [])
        monkeypatch.setattr(retest.Side, "_nuisance_chi_square", lambda *_: 0.0)
        one = retest.Side(HERE, SEEN, PLAIN, SimpleNamespace(about=noise), **said)
        one.asked = asked
        return one

    return made


@pytest.mark.parametrize(("plain", "bent", "expected"), [(60.0, 60.0, 42.0), (60.0, 95.0, 7.0), (95.0, 60.0, 7.0)])
def test_beside_others_it_must_be_missing_whether_their_forms_bend_or_not(side, plain, bent, expected):
    both = switched(switched(NULL, GAIN, np.array([0.1])), GRADIENT, np.array([0.002]))
    assert side(plain, bent).compare([both], GRADIENT, (GAIN, GRADIENT))[0] == expected
    assert side(plain, bent).compare([ON], GRADIENT, (GRADIENT,))[0] == 102.0 - plain


def test_the_best_of_several_beginnings_counts_and_each_model_has_sizes_of_its_own(side):
    """Estimated beside the same nuisances. The model without the mechanism is fitted once for all."""
    further = switched(NULL, GRADIENT, np.array([0.01]))
    here = side(without=(NULL, ()))
    assert here.compare([ON, further], GRADIENT, (GRADIENT,))[0] == 50.0
    assert here.compare([ON], GRADIENT, (GRADIENT,))[0] == 42.0
    assert here.asked == [NULL, ON, further, ON]


@pytest.mark.parametrize(("model", "variants", "expected"), [(ON, (GRADIENT,), 110.0 - 70.0), (NULL, (), 70.0 - 58.0)])
def test_what_was_fitted_before_is_not_fitted_again(side, model, variants, expected):
    """The model about which a replica was made, with the mechanism or without it; the other one at 100 or 58."""
    known = retest.Weighted(Fitted(model, variants, (), (), 70.0), None, 70.0)
    assert side(known=known).compare([ON], GRADIENT, (GRADIENT,))[0] == pytest.approx(min(expected, 30.0))


@pytest.mark.parametrize(("amplitude", "expected"), [(2.5, -0.125), (0.1, -0.05), (-0.1, 0.05)])
def test_the_linear_step_keeps_the_place(amplitude, expected):
    """A patch's size is that of the search, at least its step of 0.05; where it lies, that of the refit."""
    listed = Variant("adhesion_patch", ("change",), {"start_m": 100.0, "length_m": 50.0}, (0.05,))
    free = Variant("adhesion_patch", ("change", "start_m"), {"length_m": 50.0})
    fitted = Fitted(switched(Model(2e-4, (0.06,)), free, np.array([-0.01, 117.0])), (free,), (), (), 100.0)
    one = dataclasses.replace(trial(listed, 30.0), variant=free, fitted=fitted)
    one = dataclasses.replace(one, found=dataclasses.replace(one.found, amplitude=np.array([amplitude])))
    begun = retest._linear(one)
    assert values_in(begun.model, free) == pytest.approx([expected, 117.0])
    assert begun.variants == fitted.variants


@pytest.mark.parametrize("slope", [0.5, -1.1])
@pytest.mark.parametrize("of_sizes", [0.0041, 0.0035, 0.008])
def test_sizes_are_estimated_on_replicas_that_have_converged(monkeypatch, slope, of_sizes):
    """Each fit leaves a share of its distance from where it tends to: 0.0035 with the sizes of the search, then elsewhere.

    Fits that jump over it and back would never end; the step back is halved.
    """
    deviation = 0.0008
    begin = Fitted(NULL, (GRADIENT,), (np.array([0.0]),), (np.eye(1) * deviation**2,), 100.0)
    known = Noise(("about a replica",), None, np.array([0.5]), None)
    estimated = []

    def noise(own, _, like):
        assert like is None or (like.groups, like.colour) == ((), known.colour)  # the colour is estimated once
        estimated.append(own)
        return SimpleNamespace(weights=lambda: of_sizes, noise=known)

    def refit(own, model, variants, tends_to):
        value = tends_to + slope * (values_in(model, GRADIENT) - tends_to)
        return dataclasses.replace(begin, model=switched(model, GRADIENT, value), values=(value,))

    monkeypatch.setattr(retest, "replica_of", lambda _, model, __: SimpleNamespace(model=model, recorded=None, rows=ROWS))
    monkeypatch.setattr(retest, "ReplicaNoise", noise)
    monkeypatch.setattr(retest, "refit", refit)
    own, fitted, _ = retest.converge_reweighted(retest.begun(None, begin, 0.0035, SEEN), SEEN)
    assert own == estimated[-1]
    assert values_in(own.model, GRADIENT) == pytest.approx(of_sizes, abs=2.0 * deviation)
    assert fitted.values[0] == pytest.approx(of_sizes, abs=2.0 * deviation)
    assert len(estimated) <= 2


@pytest.mark.parametrize(("cancels", "expected"), [(False, False), (True, True)])
def test_what_shifts_a_nuisance_is_no_finding(monkeypatch, cancels, expected):
    """A nuisance of deviation 1 is the mechanism's own effect: it stood in for it, or is needed to cancel it."""
    effect = np.random.default_rng(2).standard_normal(50)
    projector = Projector.of(effect[:, None], np.ones(1, dtype=bool))
    weights = Weights(Whitening(np.ones(50), ()), np.ones(50), projector)
    sizes = {True: 0.0, False: 9.0}  # of the recordings' effect

    class Replica:
        def raw(self, model: Model, beside: Model | None = None) -> np.ndarray:
            return effect * (sizes[cancels] - 9.0 * ("track_gradient" in model.choice))

    monkeypatch.setattr(retest, "refit", lambda _, model, variants, __: Fitted(model, tuple(variants), (), (), 0.0))
    like = SimpleNamespace(about=lambda model: SimpleNamespace(weights=lambda: weights))
    shift = retest.Side(Replica(), SEEN, weights, like).compare([ON], GRADIENT, (GRADIENT,))[1]
    assert (shift > retest.NUISANCE_SHIFT**2) == expected


@pytest.mark.parametrize(
    ("costs", "made"), [((100.0, 90.0, 80.0, 75.0), 4), ((100.0, 140.0, 130.0, 143.0), 3), ((100.0, 143.0), 1)]
)
def test_replicas_are_made_until_one_fits_the_recordings_worse(monkeypatch, costs, made):
    """Sums of 100 squares scatter by 14."""
    left = iter(costs)

    def refit(own, model, variants, weights):
        value = values_in(model, GRADIENT) + 0.002  # two deviations
        return Fitted(switched(model, GRADIENT, value), (GRADIENT,), (value,), (1e-6 * np.eye(1),), next(left))

    monkeypatch.setattr(retest, "replica_of", lambda _, model, __: SimpleNamespace(model=model, rows=ROWS))
    monkeypatch.setattr(retest, "refit", refit)
    begin = Fitted(NULL, (GRADIENT,), (np.zeros(1),), (np.eye(1),), 0.0)
    step = retest.begun(None, begin, PLAIN, SEEN)
    assert step.fitted.cost == costs[made - 1]
    assert step.begin.values[0] == pytest.approx(0.002 * (made - 1))
    assert values_in(step.replica.model, GRADIENT) == pytest.approx(step.begin.values[0])
