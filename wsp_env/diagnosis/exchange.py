"""Exchanges an earlier mechanism for a rival, once later ones are known."""

import dataclasses
from collections.abc import Sequence

from wsp_env.diagnosis.accepted import Accepted, posterior, sized
from wsp_env.diagnosis.candidates import Variant, at_bound, switched, values_in, without
from wsp_env.diagnosis.fitting import Fitted, refit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.retest import Retested, Side, about_itself, retest
from wsp_env.diagnosis.search import Screen
from wsp_env.diagnosis.trials import INDISTINCT, SURE, ReplicaNoise, Trial, corrects_recordings, log_odds, weights_of
from wsp_env.diagnosis.weights import Weights


def exchanged(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Replace an earlier mechanism by a rival that explains distinctly more together with the later ones."""
    if len(accepted) < 2:
        return replica, fitted, accepted
    weights = weights_of(replica, seen)
    whole = refit(replica, fitted.model, fitted.variants, weights)
    for one in accepted[:-1]:
        others = [variant for variant in fitted.variants if variant != one.trial.variant]
        rest = refit(replica, without(fitted.model, one.trial.variant), others, weights)
        before = 0.5 * (rest.cost - whole.cost) - one.trial.penalty
        tried = [_beside(replica, rest, others, weights, rival) for rival in _rivals(one, others)]
        for better in sorted(tried, key=lambda rival: -rival.evidence):
            if better.evidence <= before + INDISTINCT or bool(better.listed.family) > bool(one.trial.listed.family):
                break
            found = _retested(replica, rest, others, weights, seen, better)
            if found is not None:
                kept = [other for other in accepted if other is not one]
                named = Accepted(
                    found.trial, *posterior(found.trial, [*tried, dataclasses.replace(one.trial, evidence=before)], ())
                )
                return sized(found.own.replica, found.trial.fitted, [*kept, named], seen)
    return replica, fitted, accepted


def _rivals(one: Accepted, others: Sequence[Variant]) -> list[Trial]:
    """Return the rivals of a mechanism; those that correct the recordings were compared on their own replica."""
    taken = {variant.title for variant in others}
    return [rival for rival in one.rivals if rival.listed.title not in taken and not corrects_recordings(rival.listed)]


def _beside(replica: Replica, rest: Fitted, others: Sequence[Variant], weights: Weights, rival: Trial) -> Trial:
    """Return a rival refitted beside the other mechanisms."""
    begin = switched(rest.model, rival.variant, values_in(rival.fitted.model, rival.variant))
    again = refit(replica, begin, [*others, rival.variant], weights)
    reduction = rest.cost - again.cost
    return dataclasses.replace(
        rival, fitted=again, null_model=rest.model, reduction=reduction, evidence=0.5 * reduction - rival.penalty
    )  # fmt: skip


def _retested(
    replica: Replica, rest: Fitted, others: Sequence[Variant], weights: Weights, seen: Screen, rival: Trial
) -> Retested | None:  # fmt: skip
    """Return a rival tested from both sides, if it is sure."""
    if at_bound(rival.variant, rival.fitted.model):
        return None
    here = Side(replica, seen, weights, ReplicaNoise(replica, seen), (rest.model, others))
    found = retest(seen, here, about_itself(replica.recorded, weights, seen, rival))
    return found if found is not None and log_odds(found.trial.listed, found.trial.evidence) > SURE else None
