"""Tests whether a tried mechanism holds from both sides: about the replica without it, and about a replica of its own.

A replica favours the model about which it was made. About the replica without a mechanism its effect is extrapolated; about its
own replica a model without it cannot fit. On each side both models are fitted to the same rows, each with nuisance sizes
estimated from its own residuals: sizes estimated without a mechanism are too large if it is missing, and hide it. Deviances
about two replicas scatter by tens of nats.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.agreement import agreement
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import replica_of
from wsp_env.diagnosis.candidates import Variant, switched, values_in, without
from wsp_env.diagnosis.convergence import WORSE, fits_worse, largest_change, midpoint, moves, rescaled
from wsp_env.diagnosis.estimates import estimates, intervals_contain_null, within_a_sample
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, refit
from wsp_env.diagnosis.form_errors import forms
from wsp_env.diagnosis.net import net_effect
from wsp_env.diagnosis.noise import Noise, NoiseParameters
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.trials import SURE, ReplicaNoise, Trial, form_of, freed, log_odds
from wsp_env.diagnosis.weights import Weights

#: Change of a mechanism with new nuisance sizes, in standard deviations, from which on its replica is made again.
LARGE_CHANGE = 1.0
#: Largest numbers of estimates of the nuisance sizes, and of replicas under each of them.
_REWEIGHTED, _STEPS = 3, 4
#: Multiples of the linear step, or of the search's own if that is larger, from which a mechanism that is not sure about its own
#: replica is tried again (assumption: a nonlinear effect may saturate, so that the linear step is too small).
_MULTIPLES = (1.0, 2.0, 4.0)
#: Multiple of `WORSE` from which on a sum of squares about another replica, with the same weights, is far larger (assumption:
#: those of true mechanisms were at most as large as without them, docs/lab/diagnosis_truth_r.md).
_FAR = 2.0
#: Additional shift of the nuisances by a mechanism, in standard deviations, above which it is rejected: nuisances cancel it.
NUISANCE_SHIFT = 4.0


class Step(NamedTuple):
    """A replica, the fit from which it was made, and the fit to it."""

    replica: Replica
    begin: Fitted
    fitted: Fitted


class AboutItself(NamedTuple):
    """A trial, and its fit to a replica of its own."""

    trial: Trial
    step: Step
    without: float = -np.inf  # cost of the model without it about a replica made again from its fit

    @property
    def fits_better(self) -> bool:
        """Whether it leaves distinctly less of the recordings than the model without it, each about itself."""
        return fits_worse(self._without, self.step.fitted.cost, len(self.step.replica.rows))

    @property
    def fits_far_worse(self) -> bool:
        """Whether it leaves so much more that weights, which belong to the replica without it, cannot be the reason."""
        return fits_worse(self.step.fitted.cost, self._without, len(self.step.replica.rows), _FAR * WORSE)

    @property
    def fits_as_well(self) -> bool:
        """Whether it leaves no more of the recordings than the model without it, each about itself with the same weights."""
        return self.step.fitted.cost <= self._without

    @property
    def _without(self) -> float:
        return max(self.trial.fitted.cost + self.trial.reduction, self.without)


class Weighted(NamedTuple):
    """A model fitted to a replica with nuisance sizes estimated from its own residuals."""

    fitted: Fitted
    weights: Weights
    deviance: float


class Side:
    """A replica on which models are compared, each with nuisance sizes estimated from its own residuals.

    Parameters
    ----------
    weights : with which a fit begins
    like : noise about a similar model, whose nuisances and colour all models share: with their own, the sizes would not be
        comparable
    without : model and variants without the mechanism to compare, if they are the same for all; they are fitted once
    known : a model and its variants that were fitted to this replica, with or without the mechanism

    """

    def __init__(
        self, replica: Replica, seen: Screen, weights: Weights, like: ReplicaNoise,
        without: tuple[Model, Sequence[Variant]] | None = None, known: Weighted | None = None,
    ) -> None:  # fmt: skip
        self.replica, self.weights = replica, weights
        self._seen, self._like, self._known = seen, like, known
        self._without = self.fit(*without) if without else None

    def fits_worse(self, other: "Side") -> bool:
        """Whether the model about which this side is has a larger deviance than that of the other side about itself."""
        return self.deviance > other.deviance

    @property
    def deviance(self) -> float:
        """Deviance of the model about which this side is, with nuisance sizes of its own."""
        known = self._known or self._without
        assert known is not None
        return known.deviance

    @property
    def noise_parameters(self) -> NoiseParameters:
        """What this side tells about the noise of similar residuals."""
        return self._like.parameters

    def fit(self, model: Model, variants: Sequence[Variant]) -> Weighted:
        """Fit a model and estimate its nuisance sizes."""
        if self._known and list(self._known.fitted.variants) == list(variants):
            return self._known
        first = refit(self.replica, model, variants, self.weights)
        weights = self._like.about(first.model).weights()
        fitted = refit(self.replica, first.model, variants, weights)
        return Weighted(fitted, weights, weights.deviance(fitted.cost))

    def compare(self, models: Sequence[Model], variant: Variant, variants: Sequence[Variant]) -> tuple[float, float]:
        """Return by how much a mechanism reduces the deviance beside the others, and increases the nuisances' chi-square.

        The best of several beginnings counts, and the smaller reduction with and without form errors of the others. If allowed,
        these may produce its effect; they may also fit a false mechanism to the residual of another false one. A true finding
        relaxes the nuisances that replaced it.
        """
        others = [one for one in variants if one != variant]
        on = min((self.fit(model, variants) for model in models), key=lambda one: one.deviance)
        off = self._without or self.fit(without(on.fitted.model, variant), others)
        found = off.deviance - on.deviance
        if others:
            found = min(found, self._bent(off, others) - self._bent(on, others))
        return found, self._nuisance_chi_square(on.fitted.model) - self._nuisance_chi_square(off.fitted.model)

    def _bent(self, one: Weighted, others: Sequence[Variant]) -> float:
        """Return the deviance with form errors of other mechanisms."""
        bent = forms(self.replica, one.fitted.model, others, self._seen.whitening)
        if not bent:
            return one.deviance
        weights = one.weights.beside(np.column_stack([group.columns * group.expected for group in bent]))
        return weights.deviance(refit(self.replica, one.fitted.model, one.fitted.variants, weights).cost)

    def _nuisance_chi_square(self, model: Model) -> float:
        amplitudes = self.weights.projector.amplitudes(self.weights(self.replica.raw(model)))
        return float(amplitudes @ amplitudes)  # in prior deviations


class Retested(NamedTuple):
    """A trial with its evidence from both sides, and its own side."""

    trial: Trial
    own: Side

    @property
    def deviance(self) -> float:
        """Deviance about its own replica, with nuisance sizes of its own."""
        return self.own.deviance

    @property
    def scatter(self) -> float:
        """Standard deviation of the sum of squares of as many rows."""
        return float(np.sqrt(2.0 * len(self.own.replica.rows)))

    def exceeds(self, other: "Retested") -> float:
        """Return how much more it explains than another trial [nats]: the mean about the replicas of both."""
        mine, others = self.trial, other.trial
        reduced = [
            one.own.fit(others.fitted.model, others.fitted.variants).deviance
            - one.own.fit(mine.fitted.model, mine.fitted.variants).deviance
            for one in (self, other)
        ]
        return 0.5 * float(np.mean(reduced)) - mine.penalty + others.penalty


def about_itself(
    recorded: Balances, weights: Weights, seen: Screen, trial: Trial, without: Callable[[], float] = lambda: -np.inf
) -> AboutItself:  # fmt: skip
    """Return a trial about a replica of its own, with the weights of the other side.

    These weights may shift the law. The replica without the mechanism was made with others, and may fit better than any that
    is made again: what the model without it leaves there (`without`) is compared, too.

    About a replica without a strongly nonlinear mechanism, a refit may lead away from it. A name is tried from its refit and
    from its linear step; what fits better counts.
    """
    refitted = functools.partial(begun, recorded, trial.fitted, weights, seen)
    if trial.listed.family:
        return AboutItself(trial, refitted(), without())
    own = freed(weights, seen, trial.fitted.variants)
    stepped = functools.partial(rescaled, recorded, _linear(trial), trial.variant, own, _MULTIPLES)
    first, begin = side_by_side(lambda one: one(), (refitted, stepped))
    if begin.cost >= first.fitted.cost or largest_change(first.fitted, begin) <= LARGE_CHANGE:
        return AboutItself(trial, first, without())
    further = begun(recorded, begin, weights, seen)
    return AboutItself(trial, min(first, further, key=lambda one: one.fitted.cost), without())


def own_side(step: Step, seen: Screen) -> tuple[Side, Fitted]:
    """Return the side of a model about itself, and its fit there."""
    own, again, noise = converge_reweighted(step, seen)
    weights = noise.weights()
    known = Weighted(again, weights, weights.deviance(again.cost))
    return Side(own, seen, weights, noise, known=known), again


def retest(seen: Screen, here: Side, one: AboutItself) -> Retested | None:
    """Return a trial with its size and evidence from both sides; None if nuisances cancel it.

    `here` is the side without it.

    The evidence is the mean of both sides. If a side speaks against it, this side counts alone, but the side without it only
    unless the model with it fits distinctly better, each about itself with the same weights; its own side is then not made.
    There is none if it fits worse about itself, each with weights of its own, and also with the same: both sides may then
    extrapolate in its favour. What leaves far more about itself with the same weights is not tested. If the parts of the
    recordings leave it no longer sure, the evidence is what they leave. A delay that may be within a sample keeps its evidence.
    """
    trial, variant, variants = one.trial, one.trial.variant, one.trial.fitted.variants
    if one.fits_far_worse:
        return Retested(dataclasses.replace(trial, reduction=0.0, evidence=-trial.penalty), here)
    make_own = functools.partial(own_side, one.step, seen)
    compare = functools.partial(here.compare, [trial.fitted.model], variant, variants)
    if one.fits_better:
        (own, fitted), (about_other, _) = side_by_side(lambda make: make(), (make_own, compare))
    else:
        about_other = compare()[0]
        if 0.5 * about_other <= trial.penalty:
            evidence = 0.5 * about_other - trial.penalty
            return Retested(dataclasses.replace(trial, reduction=about_other, evidence=evidence), here)
        own, fitted = make_own()
    model = fitted.model
    about_own, shift = own.compare([model], variant, variants)
    both = [about_own]
    if 0.5 * about_own > trial.penalty:
        if largest_change(trial.fitted, fitted) > LARGE_CHANGE:  # from there, a refit may end in another minimum
            about_other = max(about_other, here.compare([model], variant, variants)[0])
        both.append(about_other)
    if shift > NUISANCE_SHIFT**2:
        return None
    reduction, least = float(np.mean(both)), min(both)
    worse = own.fits_worse(here)
    if 0.5 * least <= trial.penalty and (worse or not one.fits_better):
        reduction = least
    if worse and not one.fits_as_well:
        reduction = 0.0
    found = estimates(own.replica, fitted, variant, own.weights, reduction)
    if intervals_contain_null(found, variant):
        reduction = 0.0  # these recordings cannot distinguish it from its absence: it is not seen
    evidence, size = 0.5 * reduction - trial.penalty, net_effect(own.replica, model, variant, seen.whitening)
    parts = agreement(own.replica, model, variant, own.weights, form_of(trial.listed))
    reduced_evidence = parts.student_evidence(evidence)
    if log_odds(trial.listed, reduced_evidence) <= SURE:
        evidence = reduced_evidence
    resolved = not within_a_sample(found, variant, own.replica.sample_s, float(np.median(own.replica.rows.speed)))
    found_trial = dataclasses.replace(
        trial, fitted=fitted, reduction=reduction, evidence=evidence, size=size, resolved=resolved
    )
    return Retested(found_trial, own)


def _linear(trial: Trial) -> Fitted:
    """Return the fit of a trial with the sizes of its linear step, at least the search's own step, located as it was fitted."""
    amplitude = trial.found.amplitude / np.clip(np.abs(trial.found.amplitude).max(), 1e-9, 1.0)
    sizes = dict(zip(trial.listed.sizes, trial.listed.null() - amplitude * trial.listed.moves(), strict=True))
    fitted = zip(trial.variant.sizes, values_in(trial.fitted.model, trial.variant), strict=True)
    values = np.array([sizes.get(name, value) for name, value in fitted])
    return dataclasses.replace(trial.fitted, model=switched(trial.null_model, trial.variant, values))


def converge_reweighted(step: Step, seen: Screen) -> tuple[Replica, Fitted, ReplicaNoise]:
    """Estimate the nuisance sizes, then iterate replicas, until the fit with these sizes belongs to the replica.

    Return the last replica, the fit to it, and its noise.
    """
    like: Noise | None = None
    weights: Weights | None = None
    fitted = step.begin
    for _ in range(_REWEIGHTED):
        if weights is not None:
            step = begun(step.replica.recorded, fitted, weights, seen)
        noise = ReplicaNoise(step.replica, seen, like=like)
        like = noise.noise._replace(groups=())  # which depend on the replica
        weights = noise.weights()
        own = freed(weights, seen, step.begin.variants)
        fitted = refit(step.replica, step.begin.model, step.begin.variants, own)
        if largest_change(step.begin, fitted) < LARGE_CHANGE:
            break
    return step.replica, fitted, noise


def begun(recorded: Balances, fitted: Fitted, weights: Weights, seen: Screen) -> Step:
    """Return the last of a few replicas, each made from the fit to the previous one, until one fits the recordings worse.

    A step that turns back is halved.
    """
    last, found, least = np.zeros(1), None, np.inf
    weights = freed(weights, seen, fitted.variants)
    for _ in range(_STEPS):
        begin, own = fitted, replica_of(recorded, fitted.model, weights)
        again = refit(own, begin.model, begin.variants, weights)
        if fits_worse(again.cost, least, len(own.rows)):
            break
        least = min(least, again.cost)
        found, step = Step(own, begin, again), moves(begin, again)
        if np.abs(step).max() < LARGE_CHANGE:
            break
        fitted, last = midpoint(begin, again) if (step * last).sum() < 0.0 else again, step
    assert found is not None
    return found
