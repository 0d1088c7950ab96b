"""Tests whether a tried mechanism holds on a replica of its own, on which its effect is not extrapolated linearly.

First with the weights with which it was found; then, on equal terms, with nuisance sizes estimated on its own replicas.
"""

import dataclasses
import functools
import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.agreement import agreement
from wsp_env.diagnosis.candidates import switched, values_in, without
from wsp_env.diagnosis.convergence import converge, converge_rescaled, midpoint, moves
from wsp_env.diagnosis.estimates import estimates, intervals_contain_null, within_a_sample
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit, replica_of
from wsp_env.diagnosis.form_errors import forms
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen, net_effect
from wsp_env.diagnosis.trials import (
    SURE,
    ReplicaNoise,
    Trial,
    accepted_deviance,
    changes_noise,
    corrects_recordings,
    form_of,
    log_odds,
    weights_of,
)

#: Change of a mechanism with new nuisance sizes, in standard deviations, from which on its replica is made again.
LARGE_CHANGE = 1.0
#: Largest number of replicas with newly estimated weights.
_REWEIGHTED = 4
#: Multiples of the linear step, or of the search's own if that is larger, from which a mechanism that is not sure about its own
#: replica is tried again (assumption: a nonlinear effect may saturate, so that the linear step is too small).
_MULTIPLES = (1.0, 2.0, 4.0)
#: Additional shift of the nuisances by a mechanism, in standard deviations, above which it is rejected: nuisances cancel it.
NUISANCE_SHIFT = 4.0


class Retested(NamedTuple):
    """A trial with its evidence on a replica of its own, and the replica to which it was fitted."""

    trial: Trial
    replica: Replica
    suspended: Fitted | None = None  # fit of a trial that is no longer sure there, with variances estimated without it


def retest(
    replica: Replica, seen: Screen, weights: Weights, trial: Trial, suspended: Fitted | None = None,
    equal: "EqualTerms | None" = None,
) -> Retested | None:  # fmt: skip
    """Return a trial with its size and evidence on a replica of its own; None if it does not hold.

    If the parts of the recordings disagree so that it is no longer sure, the evidence is the reduced one.

    Parameters
    ----------
    suspended : a fit of the trial from which to begin; each model has variances of its own residuals then. What was suspended
        and fails again is returned with its evidence in the first test, so that it counts as not seen
    equal : the comparison that may already have fitted it with such variances

    """
    judge = functools.partial(_judged, replica, seen, weights, trial, equal)
    if corrects_recordings(trial.listed):
        # It is already on its own replica; a model without it cannot fit the slides that it implies.
        return judge(trial.about, trial.fitted)
    if suspended or changes_noise(trial.listed):  # which given variances would take for an effect
        return judge(replica, suspended or trial.fitted, reweighted=True)
    led = converge(replica.recorded, trial.fitted, weights)
    held = judge(*led)
    if held is not None and held.suspended is None and log_odds(trial.listed, held.trial.evidence) > SURE:
        return held
    # About a replica without a strongly nonlinear mechanism, a refit may lead away from it.
    further = converge_rescaled(replica.recorded, _linear(trial), trial.variant, weights, _MULTIPLES)
    return judge(*further) if further[1].cost < led[1].cost else held


def _judged(
    replica: Replica, seen: Screen, weights: Weights, trial: Trial, equal: "EqualTerms | None", own: Replica, fitted: Fitted,
    reweighted: bool = False,
) -> Retested | None:  # fmt: skip
    """Return a trial with its size and evidence on a replica `own`, to which it is `fitted`; None if it does not hold.

    Parameters
    ----------
    reweighted : whether each model gets variances of its own residuals; `own` and `fitted` are then where to begin

    """
    own_weights, rejected = weights, None
    explained = np.inf  # reduction of the sum of squares from the null model about its replica to this one about its own
    weights_with: Callable[..., Weights] | None = None
    if corrects_recordings(trial.listed):
        own_weights, null_replica = trial.weights, replica
    else:
        without_it = dataclasses.replace(trial.fitted, cost=trial.fitted.cost + trial.reduction)
        null_replica, explained = own, without_it.cost - fitted.cost
        evidence = 0.5 * explained - trial.penalty
        if log_odds(trial.listed, evidence) <= SURE:
            if not np.isfinite(fitted.cost):
                return Retested(trial, own, trial.fitted)
            # The evidence of the linear search is void: if it fails again, it was not seen.
            rejected = Retested(dataclasses.replace(trial, evidence=evidence), own, None if reweighted else fitted)
            if not reweighted:
                return rejected
    if reweighted:
        known = equal.converged(fitted) if equal else None
        own, fitted, noise = known or converge_reweighted(replica, fitted, seen, weights.deviance(without_it))
        weights_with = noise.weights
        own_weights, null_replica = weights_with(), replica
    others = [one for one in fitted.variants if one is not trial.variant]
    null_fit = refit(null_replica, without(fitted.model, trial.variant), others, weights)
    # Nuisances are counted in expected deviations: both models need the same ones.
    same = weights if own_weights is weights else weights_of(own, seen)
    if (
        _nuisance_chi_square(own, fitted.model, same) - _nuisance_chi_square(null_replica, null_fit.model, weights)
        > NUISANCE_SHIFT**2
    ):
        return rejected
    reduction = trial.reduction
    if not corrects_recordings(trial.listed):
        reduction = weights.deviance(null_fit) - own_weights.deviance(fitted)
        if not reweighted:
            # Where the replica shows a mechanism, a model without it cannot fit. With it, the recordings must also fit better
            # than without it about a replica without it.
            reduction = min(reduction, explained)
    if reweighted:  # on its own replica it must explain as much as when it was found, less its form error
        least = 2.0 * ((1.0 - form_of(trial.listed)) ** 2 * trial.evidence + trial.penalty)
        if reduction > least:
            reduction = accepted_deviance(replica, seen, null_fit, weights) - own_weights.deviance(fitted)
        if reduction <= least:
            return rejected
    if others:
        # It must keep its evidence with and without form errors of the other mechanisms. If allowed, they may produce its
        # effect; they may also fit a false mechanism to the residual of another false one.
        with_forms = (weights_with or functools.partial(weights_of, own, seen))(
            forms(own, fitted.model, others, seen.whitening)
        )
        null_with_forms = (
            with_forms
            if null_replica is own
            else weights_of(null_replica, seen, forms(null_replica, null_fit.model, others, seen.whitening))
        )
        null_deviance = null_with_forms.deviance(refit(null_replica, null_fit.model, null_fit.variants, null_with_forms))
        reduction = min(reduction, null_deviance - with_forms.deviance(refit(own, fitted.model, fitted.variants, with_forms)))
    found = estimates(own, fitted, trial.variant, own_weights, reduction)
    if intervals_contain_null(found, trial.variant) or within_a_sample(found, trial.variant, replica.sample_s):
        reduction = 0.0  # these recordings cannot distinguish it from its absence: it is not seen
    evidence, size = 0.5 * reduction - trial.penalty, net_effect(own, fitted.model, trial.variant, seen.whitening)
    parts = agreement(own, fitted.model, trial.variant, own_weights, form_of(trial.listed))
    reduced_evidence = parts.student_evidence(evidence)
    if log_odds(trial.listed, reduced_evidence) <= SURE:
        evidence = reduced_evidence
    return Retested(
        dataclasses.replace(trial, fitted=fitted, reduction=reduction, evidence=evidence, size=size, weights=own_weights), own
    )


def _linear(trial: Trial) -> Fitted:
    """Return the fit of a trial with the sizes of its linear step, at least the search's own step, located as it was fitted."""
    amplitude = trial.found.amplitude / np.clip(np.abs(trial.found.amplitude).max(), 1e-9, 1.0)
    sizes = dict(zip(trial.listed.sizes, trial.listed.null() - amplitude * trial.listed.moves(), strict=True))
    fitted = zip(trial.variant.sizes, values_in(trial.fitted.model, trial.variant), strict=True)
    values = np.array([sizes.get(name, value) for name, value in fitted])
    return dataclasses.replace(trial.fitted, model=switched(trial.null_model, trial.variant, values))


class EqualTerms:
    """Compares trials if each model has variances of its own residuals.

    Parameters
    ----------
    accepted : fit of the accepted mechanisms; it is fitted again with `weights`

    """

    def __init__(self, replica: Replica, seen: Screen, accepted: Fitted, weights: Weights) -> None:
        self._replica, self._seen = replica, seen
        self._accepted, self._weights = accepted, weights
        self._lock, self._least = threading.Lock(), functools.cache(self._without)
        self._converged: list[tuple[Fitted, tuple[Replica, Fitted, ReplicaNoise]]] = []

    @property
    def scatter(self) -> float:
        """Standard deviation of half the deviance of n independent rows [nats], half that of chi-square.

        It bounds the scatter of the evidence: most of the residuals about two replicas are the same.
        """
        return 0.5 * float(np.sqrt(2.0 * len(self._replica.rows)))

    def deviance(self) -> float:
        """Return the least deviance of the accepted model."""
        with self._lock:  # computed once, and not by two threads
            return self._least()

    def _without(self) -> float:
        start = refit(self._replica, self._accepted.model, self._accepted.variants, self._weights)
        return accepted_deviance(self._replica, self._seen, start, self._weights)

    def evidence(self, trial: Trial, enough: float = np.inf) -> float:
        """Return the evidence of a trial, or a lower limit of it that is `enough`."""
        if corrects_recordings(trial.listed):
            return trial.evidence  # it was found so
        least = self.deviance()
        found = converge_reweighted(self._replica, trial.fitted, self._seen, enough=least - 2.0 * (enough + trial.penalty))
        self._converged.append((trial.fitted, found))
        _, fitted, noise = found
        return 0.5 * (least - noise.weights().deviance(fitted)) - trial.penalty

    def converged(self, begin: Fitted) -> tuple[Replica, Fitted, ReplicaNoise] | None:
        """Return the replica, the fit and the noise to which a trial's fit has led; None if it was not compared."""
        return next((found for fitted, found in self._converged if fitted is begin), None)


def converge_reweighted(
    replica: Replica, fitted: Fitted, seen: Screen, most: float = np.inf, enough: float = -np.inf
) -> tuple[Replica, Fitted, ReplicaNoise]:  # fmt: skip
    """Iterate replicas with nuisance sizes estimated on each one; a step that turns back is halved.

    Return the last replica, the fit to it, and its noise. If its deviance exceeds `most` or is `enough`, there is no other.
    """
    begin, weights, last = fitted, weights_of(replica, seen), np.zeros(1)
    for repeated in range(_REWEIGHTED):
        own = replica_of(replica.recorded, begin.model, weights)
        noise = ReplicaNoise(own, seen)
        weights = noise.weights()
        again = refit(own, begin.model, begin.variants, weights)
        step, deviance = moves(begin, again), weights.deviance(again)
        if np.abs(step).max() < LARGE_CHANGE or deviance <= enough or (repeated and deviance > most):
            break
        begin, last = midpoint(begin, again) if (step * last).sum() < 0.0 else again, step
    return own, again, noise


def _nuisance_chi_square(replica: Replica, model: Model, weights: Weights) -> float:
    """Return the sum of squared nuisance amplitudes, in prior deviations; a true finding relaxes those that replaced it."""
    amplitudes = weights.projector.amplitudes(weights(replica.raw(model)))
    return float(amplitudes @ amplitudes)
