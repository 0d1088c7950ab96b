"""Asks what was tried to hold about a replica of its own, and with the sizes of nuisances that are found there.

About the replica that it was found with a mechanism that bends is a straight line at its end.
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
from wsp_env.diagnosis.trials import SURE, Trial, anew, form_of, forms, least_deviance, odds, told, weights_of

#: Deviations by which a mechanism moves under the nuisances' sizes beside it, from which on all is asked again about it there.
MOVES = 1.0
#: Replicas that are weighed anew at most until a mechanism rests.
_WEIGHED = 4
#: Deviations by which a nuisance may be pulled further beside a mechanism than without it: what cancels it is no finding.
PULLED = 4.0


class Held(NamedTuple):
    """A trial, and the replica that it was fitted to."""

    trial: Trial
    replica: Replica


def about_its_own(replica: Replica, seen: Screen, weights: Weights, trial: Trial) -> Held | None:
    """Return a trial about a replica of its own, with the size and the evidence that it has there; None: it does not hold.

    The evidence is what the parts of the recordings leave of it where that makes it no longer sure.
    """
    mine, ran_away, refused = weights, False, None
    weights_with: Callable[..., Weights] | None = None
    if told(trial.listed):  # it was; and where it says that wheels slide, a model without it fits nothing
        own, fitted, mine, other = trial.about, trial.fitted, trial.weights, replica
    else:
        own, fitted = settle(replica.recorded, trial.fitted, weights)
        other = own
        without_it = dataclasses.replace(trial.fitted, cost=trial.fitted.cost + trial.reduction)
        ran_away = has_run_away(fitted, without_it.cost)
    if ran_away:  # under what everything varied by without it; so both are asked again, each under what it leaves itself
        begin = trial.fitted
        if np.isfinite(fitted.cost):  # what spoke for it on a straight line is not there: if it does not hold, it was not seen
            begin, lost = fitted, 0.5 * (without_it.cost - fitted.cost) - trial.price
            refused = Held(dataclasses.replace(trial, evidence=lost), own)
        own, fitted, weights_with = weighed_anew(replica, begin, seen, weights.deviance(without_it))
        mine, other = weights_with(), replica
    others = [one for one in fitted.variants if one is not trial.variant]
    gone = refit(other, without(fitted.model, trial.variant), others, weights)
    if _pulled(own, fitted.model, mine) - _pulled(other, gone.model, weights) > PULLED**2:
        return refused
    reduction = trial.reduction if told(trial.listed) else weights.deviance(gone) - mine.deviance(fitted)
    if ran_away:  # what is there explains no less than it was found with, but for its form
        least = 2.0 * ((1.0 - form_of(trial.listed)) ** 2 * trial.evidence + trial.price)
        if reduction > least:
            reduction = least_deviance(replica, seen, gone, weights) - mine.deviance(fitted)
        if reduction <= least:
            return refused
    if others:
        # It must be missing whether the forms of the others bend or not: bent, they do what it does; and free to bend, a false
        # one bends to what another false one leaves.
        bent = (weights_with or functools.partial(weights_of, own, seen))(forms(own, fitted.model, others, seen.whitening))
        without_bent = bent if other is own else weights_of(other, seen, forms(other, gone.model, others, seen.whitening))
        left_without = without_bent.deviance(refit(other, gone.model, gone.variants, without_bent))
        reduction = min(reduction, left_without - bent.deviance(refit(own, fitted.model, fitted.variants, bent)))
    found = estimates(own, fitted, trial.variant, mine, reduction)
    if leave_it_open(found, trial.variant):
        return refused
    if within_a_sample(found, trial.variant, replica.sample_s):
        reduction = 0.0  # no recording of these samples tells it from nothing
    evidence, size = 0.5 * reduction - trial.price, net_effect(own, fitted.model, trial.variant, seen.whitening)
    left = agreement(own, fitted.model, trial.variant, mine, form_of(trial.listed)).left_of(evidence)
    if odds(trial.listed, left) <= SURE:
        evidence = left
    return Held(dataclasses.replace(trial, fitted=fitted, reduction=reduction, evidence=evidence, size=size, weights=mine), own)


def weighed_anew(
    replica: Replica, fitted: Fitted, seen: Screen, most: float = np.inf
) -> tuple[Replica, Fitted, Callable[..., Weights]]:  # fmt: skip
    """Settle under the sizes of nuisances that every replica asks for itself, while the deviance is no more than `most`.

    Returns the last replica, the fit to it, and what gives its weights.
    """
    own, again = replica, fitted
    for _ in range(_WEIGHED):
        before, own = again, Replica(replica.recorded, again.model)
        weights_with = anew(own, seen)
        weights = weights_with()
        again = refit(own, before.model, before.variants, weights)
        if moved(before, again) < MOVES or weights.deviance(again) > most:
            break
    return own, again, weights_with


def _pulled(replica: Replica, model: Model, weights: Weights) -> float:
    """Return by how much nuisances are pulled from what they are: what is missing lets them relax, as they stood in for it."""
    amplitudes = weights.projector.amplitudes(weights(replica.raw(model)))
    return float(amplitudes @ amplitudes)
