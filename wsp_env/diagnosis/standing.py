"""Tests whether a tried mechanism holds on a replica of its own, with the nuisance sizes estimated there.

On the replica on which it was found, a mechanism with nonlinear effect is extrapolated linearly.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.agreement import agreement
from wsp_env.diagnosis.candidates import without
from wsp_env.diagnosis.estimates import estimates, leave_it_open, within_a_sample
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen, net_effect
from wsp_env.diagnosis.settle import has_run_away, moved, settle
from wsp_env.diagnosis.trials import SURE, NoiseOn, Trial, form_of, forms, least_deviance, odds, told, weights_of

#: Change of a mechanism with new nuisance sizes, in standard deviations, from which on its replica is made again.
MOVES = 1.0
#: Largest number of replicas with newly estimated weights.
_WEIGHED = 4
#: Additional pull on the nuisances by a mechanism, in standard deviations, above which it is rejected: nuisances cancel it.
PULLED = 4.0


class Held(NamedTuple):
    """A trial that holds, and the replica to which it was fitted."""

    trial: Trial
    replica: Replica


def about_its_own(replica: Replica, seen: Screen, weights: Weights, trial: Trial) -> Held | None:
    """Return a trial with its size and evidence on a replica of its own; None if it does not hold.

    If the parts of the recordings disagree so that it is no longer sure, the evidence is the reduced one. A trial that diverges
    and then fails is returned with its evidence there, so that it counts as not seen.
    """
    mine, ran_away, refused = weights, False, None
    weights_with: Callable[..., Weights] | None = None
    if told(trial.listed):  # already on its own replica; a model without it cannot fit the slides that it implies
        own, fitted, mine, other = trial.about, trial.fitted, trial.weights, replica
    else:
        own, fitted = settle(replica.recorded, trial.fitted, weights)
        other = own
        without_it = dataclasses.replace(trial.fitted, cost=trial.fitted.cost + trial.reduction)
        ran_away = has_run_away(fitted, without_it.cost)
    if ran_away:  # variances estimated without it do not hold: compare both models, each with variances of its own residuals
        begin = trial.fitted
        if np.isfinite(fitted.cost):  # the evidence of the linear search is void: if it fails now, it was not seen
            begin, lost = fitted, 0.5 * (without_it.cost - fitted.cost) - trial.price
            refused = Held(dataclasses.replace(trial, evidence=lost), own)
        own, fitted, noise = weighed_anew(replica, begin, seen, weights.deviance(without_it))
        weights_with = noise.weights
        mine, other = weights_with(), replica
    others = [one for one in fitted.variants if one is not trial.variant]
    gone = refit(other, without(fitted.model, trial.variant), others, weights)
    if _pulled(own, fitted.model, mine) - _pulled(other, gone.model, weights) > PULLED**2:
        return refused
    reduction = trial.reduction
    if not told(trial.listed):
        reduction = weights.deviance(gone) - mine.deviance(fitted)
        if not ran_away:
            # Where the replica shows a mechanism, a model without it cannot fit. With it, the recordings must also fit better
            # than without it about a replica without it.
            reduction = min(reduction, without_it.cost - fitted.cost)
    if ran_away:  # on its own replica it must explain as much as when it was found, less its form error
        least = 2.0 * ((1.0 - form_of(trial.listed)) ** 2 * trial.evidence + trial.price)
        if reduction > least:
            reduction = least_deviance(replica, seen, gone, weights) - mine.deviance(fitted)
        if reduction <= least:
            return refused
    if others:
        # It must keep its evidence with and without form errors of the other mechanisms. If allowed, they may produce its
        # effect; they may also fit a false mechanism to the residual of another false one.
        bent = (weights_with or functools.partial(weights_of, own, seen))(forms(own, fitted.model, others, seen.whitening))
        without_bent = bent if other is own else weights_of(other, seen, forms(other, gone.model, others, seen.whitening))
        left_without = without_bent.deviance(refit(other, gone.model, gone.variants, without_bent))
        reduction = min(reduction, left_without - bent.deviance(refit(own, fitted.model, fitted.variants, bent)))
    found = estimates(own, fitted, trial.variant, mine, reduction)
    if leave_it_open(found, trial.variant):
        return refused
    if within_a_sample(found, trial.variant, replica.sample_s):
        reduction = 0.0  # a recording with these samples cannot distinguish it from zero
    evidence, size = 0.5 * reduction - trial.price, net_effect(own, fitted.model, trial.variant, seen.whitening)
    left = agreement(own, fitted.model, trial.variant, mine, form_of(trial.listed)).left_of(evidence)
    if odds(trial.listed, left) <= SURE:
        evidence = left
    return Held(dataclasses.replace(trial, fitted=fitted, reduction=reduction, evidence=evidence, size=size, weights=mine), own)


def weighed_anew(
    replica: Replica, fitted: Fitted, seen: Screen, most: float = np.inf
) -> tuple[Replica, Fitted, NoiseOn]:  # fmt: skip
    """Settle with nuisance sizes estimated on each replica, while the deviance does not exceed `most`.

    Return the last replica, the fit to it, and its noise.
    """
    own, again = replica, fitted
    for _ in range(_WEIGHED):
        before, own = again, Replica(replica.recorded, again.model)
        noise = NoiseOn(own, seen)
        weights = noise.weights()
        again = refit(own, before.model, before.variants, weights)
        if moved(before, again) < MOVES or weights.deviance(again) > most:
            break
    return own, again, noise


def _pulled(replica: Replica, model: Model, weights: Weights) -> float:
    """Return the sum of squared nuisance amplitudes, in prior deviations; a true finding relaxes those that replaced it."""
    amplitudes = weights.projector.amplitudes(weights(replica.raw(model)))
    return float(amplitudes @ amplitudes)
