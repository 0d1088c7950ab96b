"""Whether what was tried holds about a replica of its own."""

import dataclasses
import functools
from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import BENT, GAIN, GRADIENT, PLAIN, trial

from wsp_env.diagnosis import retest
from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.candidates import Variant, switched, values_in
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.trials import PRIOR, SURE

#: What is asked of a replica and of a screen.
REPLICA, SEEN = SimpleNamespace(recorded=None, sample_s=0.01), SimpleNamespace(whitening=None)


@pytest.fixture
def own(monkeypatch):
    """What is said of a gradient about a replica of its own: it cost 100 before, and costs 100 without it there."""
    on = switched(Model(2e-4, (0.06,)), GRADIENT, np.array([0.002]))
    one = dataclasses.replace(trial(GRADIENT, 30.0), fitted=Fitted(on, (GRADIENT,), (), (), 100.0), penalty=3.0)
    monkeypatch.setattr(retest, "refit", lambda replica, model, variants, _: Fitted(model, tuple(variants), (), (), 100.0))
    monkeypatch.setattr(retest, "net_effect", lambda *_: StopChange(0.04, 0.0))

    def ask(
        cost: float, pulls: bool = False, left: float = 20.0, again: float = np.nan, least: float = np.nan,
        interval: tuple[float, float] = (0.001, 0.003), found: float = 60.0, twice: bool = False, linear: float = np.inf,
    ) -> retest.Retested | None:  # fmt: skip
        monkeypatch.setattr(retest, "estimates", lambda *_: {"rise": Estimate(0.002, "-", interval)})
        monkeypatch.setattr(retest, "converge", lambda *_: ("own replica", dataclasses.replace(one.fitted, cost=cost)))
        elsewhere = "replica of the step", dataclasses.replace(one.fitted, cost=linear)
        monkeypatch.setattr(retest, "converge_rescaled", lambda *_: elsewhere)
        anew = dataclasses.replace(one.fitted, cost=again)
        noise = SimpleNamespace(weights=lambda: PLAIN)
        monkeypatch.setattr(retest, "converge_reweighted", lambda *said: (f"{said[1].cost}, {said[3]}", anew, noise))
        monkeypatch.setattr(retest, "accepted_deviance", lambda *_: least)
        pulled = {True: 5.0**2, False: 0.0}[pulls]
        monkeypatch.setattr(retest, "_nuisance_chi_square", lambda _, model, __: pulled * ("track_gradient" in model.choice))
        monkeypatch.setattr(retest, "agreement", lambda *_: SimpleNamespace(student_evidence=lambda evidence: left))
        asked = dataclasses.replace(one, reduction=found)
        first = retest.retest(REPLICA, SEEN, PLAIN, asked)
        return retest.retest(REPLICA, SEEN, PLAIN, asked, first.suspended) if twice else first

    return ask


def test_a_trial_has_the_evidence_and_size_that_it_has_about_its_own_replica(own):
    """What goes with it there, less the price of its variants."""
    held = own(60.0)
    assert held.replica == "own replica"
    assert held.trial.evidence == 0.5 * 40.0 - 3.0
    assert (held.trial.fitted.cost, held.trial.reduction) == (60.0, 40.0)
    assert held.trial.size == StopChange(0.04, 0.0)


@pytest.mark.parametrize(("found", "expected"), [(-10.0, 30.0), (0.0, 40.0), (60.0, 40.0)])
def test_the_recordings_must_fit_better_than_without_it_about_a_replica_without_it(own, found, expected):
    """About its own replica, which shows it, a model without it costs 100; about its own 100 + `found`. With it: 60."""
    held = own(60.0, found=found)
    assert held.trial.reduction == expected
    assert held.suspended is None


@pytest.mark.parametrize(("found", "evidence"), [(-30.0, 2.0), (-60.0, -13.0)])
def test_what_is_no_longer_sure_about_its_own_replica_is_suspended(own, found, evidence):
    held = own(60.0, found=found)
    assert held.suspended.cost == 60.0
    assert held.trial.evidence == evidence  # a price of 3


@pytest.mark.parametrize(("refit", "linear", "replica"), [(150.0, 60.0, "replica of the step"), (60.0, 50.0, "own replica")])
def test_what_a_refit_has_lost_is_sought_from_the_linear_step(own, refit, linear, replica):
    """It costs 100 without it. What is sure from the refit is not sought elsewhere."""
    held = own(refit, linear=linear)
    assert (held.replica, held.suspended) == (replica, None)
    assert held.trial.fitted.cost == 60.0
    lost = own(150.0, linear=145.0)  # neither
    assert (lost.replica, lost.suspended.cost) == ("replica of the step", 145.0)
    assert own(145.0, linear=150.0).suspended.cost == 145.0


@pytest.mark.parametrize("lost", [{"pulls": True}, {"interval": (0.0, 0.003)}, {"left": 1.0}])
def test_what_holds_there_by_its_fit_alone_is_sought_from_the_linear_step_too(own, monkeypatch, lost):
    """From the refit it moves the nuisances, may be absent, or its parts disagree; from the step it costs less, and holds."""
    sought = []
    monkeypatch.setattr(retest, "_linear", lambda trial: sought.append(trial))
    own(60.0, linear=50.0, **lost)
    assert len(sought) == 1
    own(60.0, linear=50.0)
    assert len(sought) == 1


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


def test_what_does_not_converge_is_suspended_as_it_was_found(own):
    held = own(np.inf)
    assert (held.suspended.cost, held.trial.evidence) == (100.0, 30.0)


@pytest.mark.parametrize(("plain", "bent", "expected"), [(60.0, 60.0, 40.0), (60.0, 95.0, 5.0), (95.0, 60.0, 5.0)])
def test_beside_others_it_must_be_missing_whether_their_forms_bend_or_not(monkeypatch, plain, bent, expected):
    """Without the gradient each costs 100; with it so much, the forms of the gain before it at rest and bent."""
    both = switched(switched(Model(2e-4, (0.06,)), GAIN, np.array([0.1])), GRADIENT, np.array([0.002]))
    whole = Fitted(both, (GAIN, GRADIENT), (), (), plain)

    def refit(_, model, variants, weights):
        cost = 100.0 if GRADIENT not in variants else bent if weights is BENT else plain
        return Fitted(model, tuple(variants), (), (), cost)

    monkeypatch.setattr(retest, "refit", refit)
    monkeypatch.setattr(retest, "converge", lambda *_: ("own replica", whole))
    monkeypatch.setattr(retest, "_linear", lambda trial: trial.fitted)
    monkeypatch.setattr(retest, "converge_rescaled", lambda *_: ("replica of the step", whole))
    monkeypatch.setattr(retest, "forms", lambda _, __, variants, ___: variants)
    monkeypatch.setattr(retest, "weights_of", lambda _, __, forms: BENT if list(forms) == [GAIN] else "wrong forms")
    monkeypatch.setattr(retest, "net_effect", lambda *_: StopChange(0.04, 0.0))
    monkeypatch.setattr(retest, "_nuisance_chi_square", lambda *_: 0.0)
    monkeypatch.setattr(retest, "agreement", lambda *_: SimpleNamespace(student_evidence=lambda evidence: 20.0))
    monkeypatch.setattr(retest, "estimates", lambda *_: {"rise": Estimate(0.002, "-", (0.001, 0.003))})
    one = dataclasses.replace(trial(GRADIENT, 30.0), fitted=whole)
    held = retest.retest(REPLICA, SEEN, PLAIN, one)
    assert held.trial.reduction == expected
    assert held.trial.evidence == 0.5 * expected


def test_what_was_suspended_is_asked_under_the_weights_that_it_has_there(own):
    """It fits worse there than the model without it did, which left 160.

    Weights that were learned without it say what everything varied by while it was missing: both are compared by their
    deviances, each under weights of its own, and without it the least counts.
    """
    away = 170.0
    held = own(away, again=40.0, least=96.0, twice=True)
    assert held.replica == f"{away}, 160.0"  # begun there, and left where it costs more than without it
    assert held.trial.reduction == 56.0
    assert held.trial.evidence == 0.5 * 56.0 - 3.0
    assert (
        own(np.inf, again=40.0, least=96.0, twice=True).replica == "100.0, 160.0"
    )  # where it did not come to rest: from the trial


def test_what_was_suspended_must_explain_as_much_under_the_weights_of_its_own_replica_but_for_its_form(own):
    """It had 30. Where less than 0.8 squared of that is left, it was not seen; if it never came to rest, nothing tells."""
    away, no_less = 170.0, 2.0 * (0.64 * 30.0 + 3.0)
    own = functools.partial(own, twice=True)
    lost = pytest.approx(0.5 * (160.0 - away) - 3.0)
    assert own(away, again=100.0 - no_less - 0.1, least=100.0).trial.evidence == pytest.approx(0.64 * 30.0 + 0.05)
    assert own(away, again=100.0 - no_less - 0.1, least=99.8).trial.evidence == lost
    assert own(away, again=100.0 - no_less + 0.1).trial.evidence == lost  # the least is not asked
    assert own(np.inf, again=98.0) is None
    assert own(away, again=40.0, least=96.0, pulls=True).trial.evidence == lost
    assert own(away, again=40.0, least=96.0, interval=(-0.001, 0.003)).trial.evidence == -3.0  # its price


@pytest.mark.parametrize(
    ("most", "enough", "slope", "reached"),
    [
        (np.inf, 99.0, 0.5, [0.0, 0.002, 0.003, 0.0035]),
        (100.0, 99.0, 0.5, [0.0, 0.002, 0.003, 0.0035]),
        (99.0, 99.0, 0.5, [0.0, 0.002, 0.003]),
        (np.inf, 100.0, 0.5, [0.0, 0.002]),
        (np.inf, 99.0, -1.1, [0.0, 0.0084, 0.00378, 0.004242]),
    ],
)
def test_a_reweighted_fit_converges_under_the_weights_of_every_replica(monkeypatch, most, enough, slope, reached):
    """Each fit leaves a share of its distance from 0.004.

    One that moves less than a deviation, costs little enough, or a second that costs more, ends it. Fits that jump over 0.004
    and back would never end; the step back is halved.
    """
    deviation = 0.0008
    begin = Fitted(Model(2e-4, (0.06,)), (GRADIENT,), (np.array([0.0]),), (np.eye(1) * deviation**2,), 100.0)
    monkeypatch.setattr(retest, "replica_of", lambda recorded, model, weights: ("about", model))
    monkeypatch.setattr(retest, "weights_of", lambda *_: None)

    def noise_on(own, seen):
        return SimpleNamespace(weights=lambda: SimpleNamespace(deviance=lambda one: one.cost, of=own))

    monkeypatch.setattr(retest, "ReplicaNoise", noise_on)

    def refit(own, model, variants, weights):
        assert weights.of == own == ("about", model)
        value = 0.004 + slope * (values_in(model, GRADIENT) - 0.004)
        return dataclasses.replace(begin, model=switched(model, GRADIENT, value), values=(value,))

    monkeypatch.setattr(retest, "refit", refit)
    own, fitted, noise = retest.converge_reweighted(REPLICA, begin, SEEN, most, enough)
    assert fitted.values[0] == pytest.approx(reached[-1])
    assert values_in(own[1], GRADIENT) == pytest.approx(reached[-2])
    assert noise.weights().of == own


@pytest.mark.parametrize(("interval", "holds"), [((1e-6, 0.004), True), ((-1e-6, 0.004), False), ((-0.004, -1e-6), True)])
def test_a_name_whose_own_interval_leaves_it_open_does_not_hold(own, interval, holds):
    assert own(60.0, interval=interval).trial.evidence == (17.0 if holds else -3.0)  # its price


def test_what_pulls_nuisances_or_is_not_alike_in_the_runs_does_not_hold(own):
    assert own(60.0, pulls=True) is None
    left = SURE - PRIOR - 0.1
    assert own(60.0, left=left).trial.evidence == left  # which is no longer sure
    assert own(60.0, left=SURE - PRIOR + 0.1).trial.evidence == 0.5 * 40.0 - 3.0


@pytest.mark.parametrize(("cancels", "expected"), [(False, False), (True, True)])
def test_what_pulls_a_nuisance_is_no_finding(cancels, expected):
    """A nuisance of deviation 1 is the mechanism's own effect: it stood in for it, or is needed to cancel it."""
    effect = np.random.default_rng(2).standard_normal(50)
    projector = Projector(effect[:, None], np.ones(1, dtype=bool))
    weights = Weights(Whitening(np.ones(50), ()), np.ones(50), projector)
    sizes = {True: 0.0, False: 9.0}  # of the recordings' effect

    class Replica:
        def raw(self, model: Model) -> np.ndarray:
            return effect * (sizes[cancels] - 9.0 * ("track_gradient" in model.choice))

    on = switched(Model(2e-4, (0.06,)), GRADIENT, np.array([0.002]))
    beside, before = (retest._nuisance_chi_square(Replica(), one, weights) for one in (on, Model(2e-4, (0.06,))))
    assert (beside - before > retest.NUISANCE_SHIFT**2) == expected


def test_evidence_on_equal_terms_has_variances_of_each_model_s_own_residuals(monkeypatch):
    """With the gradient the deviance is 40 where its own weights say so; without it, the least is 96. A price of 3."""
    on = switched(Model(2e-4, (0.06,)), GRADIENT, np.array([0.002]))
    one = dataclasses.replace(trial(GRADIENT, 30.0), fitted=Fitted(on, (GRADIENT,), (), (), 100.0), penalty=3.0)
    noise = SimpleNamespace(weights=lambda: PLAIN)
    settled = dataclasses.replace(one.fitted, cost=40.0)
    limits = []
    monkeypatch.setattr(retest, "converge_reweighted", lambda *_, enough: limits.append(enough) or ("own", settled, noise))
    asked = []
    monkeypatch.setattr(retest, "accepted_deviance", lambda _, __, accepted, ___: asked.append(accepted) or 96.0)
    monkeypatch.setattr(retest, "refit", lambda _, model, variants, weights: (variants, weights))
    equal = retest.EqualTerms(REPLICA, SEEN, one.fitted, PLAIN)
    late = dataclasses.replace(one, listed=Variant("brake_delay", ("lag_s",), {"axle": 0.0}))
    assert equal.evidence(late) == 30.0  # as it was found
    assert [equal.evidence(one), equal.evidence(one)] == [0.5 * (96.0 - 40.0) - 3.0] * 2
    assert asked == [((GRADIENT,), PLAIN)]  # once
    equal.evidence(one, 20.0)
    assert limits == [-np.inf, -np.inf, 96.0 - 2.0 * (20.0 + 3.0)]
    assert equal.converged(one.fitted) == ("own", settled, noise)  # for its retest
    assert equal.converged(settled) is None


def test_the_scatter_of_half_a_deviance_is_that_of_chi_square():
    rows = np.random.default_rng(5).standard_normal((4000, 800))
    half = 0.5 * (rows**2).sum(axis=1)
    equal = retest.EqualTerms(SimpleNamespace(rows=range(800)), SEEN, None, PLAIN)
    assert equal.scatter == pytest.approx(half.std(), rel=0.05)
