"""Decides which mechanisms are missing: one after the other, each fitted together with all earlier ones.

A mechanism is accepted if its evidence (`wsp_env.diagnosis.search`) outweighs the low prior odds that it is missing. It is
named if its net size, after refitting tau and mu_cd, reaches `MATTERS` of the smallest effect of interest. Otherwise it stays
in the model, so that no other mechanism is named in its place.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

from wsp_env.diagnosis.accepted import Accepted, posterior, sized
from wsp_env.diagnosis.candidates import Variant, at_bound, without
from wsp_env.diagnosis.contest import best_of
from wsp_env.diagnosis.convergence import converge, fits_worse, largest_change
from wsp_env.diagnosis.discovered import curves, terms
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.exchange import exchanged
from wsp_env.diagnosis.fitting import Fitted, refit
from wsp_env.diagnosis.form_errors import FormErrorThreshold
from wsp_env.diagnosis.net import net_effect
from wsp_env.diagnosis.noise import NoiseParameters
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.retest import LARGE_CHANGE, Retested, Side, about_itself, begun, converge_reweighted, own_side, retest
from wsp_env.diagnosis.search import Screen, screen
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.structure import structured
from wsp_env.diagnosis.trials import (
    MATTERS,
    SURE,
    ReplicaNoise,
    Trial,
    corrects_recordings,
    freed,
    log_odds,
    trials_of,
    weights_of,
)
from wsp_env.diagnosis.weights import Weights

#: Largest number of accepted mechanisms.
MOST = 3


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Result of the selection."""

    replica: Replica  # replica of the extended model
    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: Screen  # candidates about the baseline
    last: Screen  # candidates about the extended model
    weights: Weights  # weights for the residuals of the extended model
    rejected: tuple[Trial, ...] = ()  # if nothing was accepted: trials with evidence and sufficient size that failed a check

    @property
    def missing(self) -> tuple[Accepted, ...]:
        """The accepted mechanisms that matter."""
        return tuple(one for one in self.accepted if one.trial.matters)


def select(
    replica: Replica,
    tried: Sequence[Variant],
    progress: Callable[[str], None] = lambda step: None,
    noise_parameters: NoiseParameters | None = None,
) -> Outcome:
    """Accept mechanisms one after the other; competing candidates are refitted in parallel.

    Parameters
    ----------
    noise_parameters : noise about the law alone; None: it is estimated

    """
    begin = nothing(replica, tried, noise_parameters)
    first, seen, weights, fitted = begin.first, begin.last, begin.weights, begin.fitted
    by_curves = False
    accepted: list[Accepted] = []
    left: list[Trial] = []
    for _ in range(2 * MOST):  # rounds; an accepted mechanism may be removed again
        if len(accepted) == MOST:
            break
        progress(f"refitting {len(accepted) + 1} of {MOST}")
        here = functools.partial(_without_new, replica, fitted, seen, weights)
        made_again = functools.cache(functools.partial(_made_again, replica, fitted, seen, weights))
        about = functools.partial(about_itself, replica.recorded, weights, seen, without=made_again)
        threshold = functools.partial(
            _threshold,
            FormErrorThreshold(replica, fitted.model, [(one.trial.variant, one.trial.evidence) for one in accepted], seen),
            functools.partial(_coincidence, replica, accepted, seen),
        )
        batches = trials_of(replica, seen, fitted, weights)
        best, rejected, trials = best_of(
            batches, _ends_at_bound, about, here, functools.partial(retest, seen), threshold, not accepted
        )
        if best is None:
            left = left or [
                one for one in trials if not accepted and rejected.get(one.listed.title, 0.0) > SURE and one.matters
            ]
            if by_curves or not (left or structured(replica, seen, weights).unexplained):
                break
            by_curves = True  # no candidate with a form holds: try curves
            seen = _screened(
                replica, fitted, seen.noise_parameters, tried, curves(replica, [one.trial.listed for one in accepted])
            )
            weights = weights_of(replica, seen)
            continue
        others = [one for one in trials if one.listed.title not in {*rejected, best.trial.listed.title}]
        sure = [one for one in others if log_odds(one.listed, one.evidence) > threshold(one)]
        searched = [one for one in seen.found if one.name not in rejected]
        named = Accepted(best.trial, *posterior(best.trial, others, searched), tuple(sure))
        replica, fitted, accepted = _forward_step([*accepted, named], best, weights, seen)
        replica, fitted, accepted = exchanged(replica, fitted, accepted, seen)
        noise = best.own.noise_parameters
        if fitted is not best.trial.fitted:  # without an earlier mechanism, or with another one, sizes and noise are others
            own, again, noise = _converge_all(replica, fitted, accepted, seen)
            if np.isfinite(again.cost) and largest_change(fitted, again) > LARGE_CHANGE:
                replica, fitted, accepted = sized(own, again, accepted, seen)
        further = terms(replica, [one.trial.listed for one in accepted]) if len(accepted) < MOST else ()
        seen = _screened(replica, fitted, noise, tried, further)
        weights = weights_of(replica, seen)
        matters = any(one.matters for one in (best.trial, *sure)) or _promises(seen)
        if not (matters or structured(replica, seen, weights).unexplained):
            break  # reported as too small; it stays in the model, so that nothing that matters is found in its place
    return Outcome(replica, fitted, tuple(accepted), first, seen, weights, () if accepted else tuple(left))


def nothing(replica: Replica, tried: Sequence[Variant], noise_parameters: NoiseParameters | None = None) -> Outcome:
    """Return the outcome of the search alone, in which nothing is accepted."""
    seen = screen(replica, replica.baseline, [*tried, *terms(replica)], noise_parameters=noise_parameters)
    return Outcome(replica, Fitted(replica.baseline, (), (), (), 0.0), (), seen, seen, weights_of(replica, seen))


def _without_new(replica: Replica, fitted: Fitted, seen: Screen, weights: Weights) -> Side:
    """Return the side without a further mechanism, for all trials of a round."""
    return Side(replica, seen, weights, ReplicaNoise(replica, seen, like=seen.noise), (fitted.model, fitted.variants))


def _made_again(replica: Replica, fitted: Fitted, seen: Screen, weights: Weights) -> float:
    """Return the cost of a model about a replica made again from its fit with the weights of a round."""
    begin = refit(replica, fitted.model, fitted.variants, freed(weights, seen, fitted.variants))
    return begun(replica.recorded, begin, weights, seen).fitted.cost


def _promises(seen: Screen) -> bool:
    """Whether the search about a model finds anything that is sure and matters."""
    return any(
        log_odds(one.candidate.variant, one.evidence) > SURE and float(np.abs(one.multiple).max()) >= MATTERS
        for one in seen.found
    )


def _screened(
    replica: Replica, fitted: Fitted, noise_parameters: NoiseParameters, tried: Sequence[Variant],
    unnamed: Sequence[Variant],
) -> Screen:  # fmt: skip
    """Screen the remaining names and terms about the accepted model."""
    left = [one for one in tried if one.name not in fitted.model.choice]
    return screen(replica, fitted.model, [*left, *unnamed], fitted.variants, noise_parameters)


def _converge_all(
    replica: Replica, fitted: Fitted, accepted: Sequence[Accepted], seen: Screen
) -> tuple[Replica, Fitted, NoiseParameters]:  # fmt: skip
    """Iterate replicas with nuisance sizes that belong to the accepted mechanisms; return the noise, too.

    If a mechanism changes when or how speeds are read, other rows slide, and each replica gets new weights.
    """
    if not any(corrects_recordings(one.trial.listed) for one in accepted):
        noise = ReplicaNoise(replica, seen)
        return *converge(replica.recorded, fitted, freed(noise.weights(), seen, fitted.variants)), noise.parameters
    own, again, noise = converge_reweighted(begun(replica.recorded, fitted, weights_of(replica, seen), seen), seen)
    return own, again, noise.parameters


def _forward_step(
    accepted: list[Accepted], last: Retested, weights: Weights, seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return replica and fit of all accepted mechanisms, without those that are no longer sure with the last one present."""
    replica = last.own.replica
    kept, fitted = _backward_elimination(replica, accepted, last.trial.fitted, seen)
    if len(kept) < len(accepted):
        replica, fitted = converge(replica.recorded, fitted, freed(weights, seen, fitted.variants))
    return sized(replica, fitted, kept, seen)


def _backward_elimination(
    replica: Replica, accepted: list[Accepted], fitted: Fitted, seen: Screen
) -> tuple[list[Accepted], Fitted]:
    """Remove earlier mechanisms that are no longer sure with the last one present: the better of two names may come second."""
    for one in accepted[:-1]:
        rest = _unneeded(replica, one.trial, fitted, seen)
        if rest is not None:
            accepted, (replica, fitted) = [other for other in accepted if other is not one], rest
    return accepted, fitted


def _unneeded(replica: Replica, trial: Trial, fitted: Fitted, seen: Screen) -> tuple[Replica, Fitted] | None:
    """Return replica and fit without an accepted mechanism if it is not sure beside the others, else None.

    To stay, it must be sure on both sides. The side of a model that fits distinctly worse about itself does not count: what it
    lacks is extrapolated there.
    """
    variant, weights = trial.variant, weights_of(replica, seen)
    others = [other for other in fitted.variants if other != variant]
    reduced = refit(replica, without(fitted.model, variant), others, weights)
    step = begun(replica.recorded, reduced, weights, seen)
    whole = refit(replica, fitted.model, fitted.variants, weights)

    def make_here() -> Side:
        return Side(replica, seen, weights, ReplicaNoise(replica, seen))

    def is_sure(side: Side) -> bool:
        reduction, _ = side.compare([fitted.model], variant, fitted.variants)
        return log_odds(trial.listed, 0.5 * reduction - trial.penalty) > SURE

    make_own = functools.partial(own_side, step, seen)
    if fits_worse(step.fitted.cost, whole.cost, len(replica.rows)):
        if is_sure(make_here()):
            return None
        rest, left = make_own()
        return rest.replica, left
    here, (rest, left) = side_by_side(lambda make: make(), (make_here, make_own))
    return None if all(side_by_side(is_sure, (here, rest))) else (rest.replica, left)


def _ends_at_bound(trial: Trial) -> bool:
    """Whether a trial is rejected whatever its evidence."""
    return at_bound(trial.variant, trial.fitted.model)


def _threshold(form: Callable[[Trial], float], coincidence: Callable[[Trial], float], trial: Trial) -> float:
    """Return the log odds that a trial must exceed: what form errors of earlier ones ask for, and what a coincidence costs."""
    return form(trial) + coincidence(trial)


def _coincidence(replica: Replica, accepted: Sequence[Accepted], seen: Screen, trial: Trial) -> float:
    """Return the cost [nats] of a mechanism that had hidden a part of earlier ones, which grow with it.

    That two independent effects cancel each other but for one part in g is about as rare as one in g. An earlier one that was
    too small to matter may grow as if it had just mattered.
    """

    def size(model: Model, one: Accepted) -> float:
        return net_effect(replica, model, one.trial.variant, seen.whitening).multiple

    grown = [size(trial.fitted.model, one) / max(size(trial.null_model, one), MATTERS) for one in accepted]
    return float(np.sum(np.log(np.maximum(grown, 1.0))))
