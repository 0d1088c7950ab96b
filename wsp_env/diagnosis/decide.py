"""Decides which mechanisms are missing: one after the other, each fitted together with all earlier ones.

A mechanism is accepted if its evidence (`wsp_env.diagnosis.search`) outweighs the low prior odds that it is missing. It is
named if its net size, after refitting tau and mu_cd, reaches `MATTERS` of the smallest effect of interest. Otherwise it stays
in the model, so that no other mechanism is named in its place.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from wsp_env.diagnosis.candidates import Variant, at_bound, switched, values_in, without
from wsp_env.diagnosis.discovered import curves, terms
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.noise import Known
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, Screen, net_effect, screen
from wsp_env.diagnosis.settle import moved, settle
from wsp_env.diagnosis.standing import MOVES, Held, about_its_own, weighed_anew
from wsp_env.diagnosis.structure import structured
from wsp_env.diagnosis.trials import FORM, SURE, FormsLeft, NoiseOn, Trial, odds, told, trials_of, weights_of

#: Largest number of accepted mechanisms.
MOST = 3
#: Size, in smallest effects of interest, from which on a mechanism matters: one less the form error at 95 %, 1 / (1 + 1.645
#: FORM), rounded.
MATTERS = 0.75
#: Largest difference of evidence at which another name is as good: a factor of e^10. The form error sets a further limit.
INDISTINCT = 10.0
#: Largest factor by which an earlier mechanism may grow with a new one: twice its form error, at 90 % (assumption).
GROWN = 1.7


@dataclasses.dataclass(frozen=True)
class Accepted:
    """An accepted mechanism, its alternatives and its confidence."""

    trial: Trial
    alternatives: tuple[str, ...]  # its own name first
    confidence: float
    rivals: tuple[Trial, ...] = ()  # other trials that were sure when this one was accepted

    @property
    def name(self) -> str:
        """Name of the mechanism, or family of the term."""
        return self.trial.listed.title

    @property
    def words(self) -> str:
        """The name in words."""
        return self.name.replace("_", " ")

    def sized(self, size: StopChange) -> "Accepted":
        """Return the same with its size in the complete extended model."""
        return dataclasses.replace(self, trial=dataclasses.replace(self.trial, size=size))


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Result of the selection."""

    replica: Replica  # replica of the extended model
    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: Screen  # candidates about the baseline
    last: Screen  # candidates about the extended model
    weights: Weights  # weights for the residuals of the extended model
    refused: tuple[Trial, ...] = ()  # if nothing was accepted: trials with evidence and sufficient size that failed a check

    @property
    def missing(self) -> tuple[Accepted, ...]:
        """The accepted mechanisms that matter."""
        return tuple(one for one in self.accepted if one.trial.size.multiple >= MATTERS)


def select(
    replica: Replica,
    tried: Sequence[Variant],
    pool: Executor,
    progress: Callable[[str], None] = lambda step: None,
    known: Known | None = None,
) -> Outcome:
    """Accept mechanisms one after the other; competing candidates are refitted in parallel.

    Parameters
    ----------
    known : noise about the law alone; None: it is estimated

    """
    first = seen = screen(replica, replica.baseline, [*tried, *terms(replica)], pool, known=known)
    weights = weights_of(replica, seen)
    by_curves = False
    fitted = Fitted(replica.baseline, (), (), (), 0.0)
    accepted: list[Accepted] = []
    left: list[Trial] = []
    for _ in range(2 * MOST):  # rounds; an accepted mechanism may be removed again
        if len(accepted) == MOST:
            break
        progress(f"refitting {len(accepted) + 1} of {MOST}")
        refuses = functools.partial(_refused, replica, accepted, seen)
        stands = functools.partial(about_its_own, replica, seen, weights)
        forms_left = FormsLeft(replica, fitted.model, [(one.trial.variant, one.trial.evidence) for one in accepted], seen)
        trials = trials_of(replica, seen, fitted, weights, pool)
        best, refused = _best(trials, refuses, stands, forms_left)
        if best is None:
            left = left or [
                one
                for one in trials
                if not accepted and refused.get(one.listed.title, 0.0) > SURE and one.size.multiple >= MATTERS
            ]
            if by_curves or not (left or structured(replica, seen, weights).unexplained):
                break
            by_curves = True  # no candidate with a form holds: try curves
            seen = _screened(replica, fitted, seen.known, tried, curves(replica, [one.trial.listed for one in accepted]), pool)
            weights = weights_of(replica, seen)
            continue
        others = [one for one in trials if one.listed.title not in {*refused, best.trial.listed.title}]
        sure = [one for one in others if odds(one.listed, one.evidence) > forms_left(one)]
        searched = [one for one in seen.found if one.name not in refused]
        first_tried = next(one for one in trials if one.listed.title == best.trial.listed.title)
        named = Accepted(best.trial, *belief(_more_sure(best.trial, first_tried), others, searched), tuple(sure))
        replica, fitted, accepted = _beside([*accepted, named], best, weights, seen)
        replica, fitted, accepted = _exchanged(replica, fitted, accepted, seen)
        # The missing mechanism had enlarged all nuisances, and these had reduced its size: estimate both again.
        own, again, noise = _settled_beside(replica, fitted, accepted, seen)
        if np.isfinite(again.cost) and moved(fitted, again) > MOVES:
            replica, fitted, accepted = _sized(own, again, accepted, seen)
        seen = _screened(replica, fitted, noise, tried, terms(replica, [one.trial.listed for one in accepted]), pool)
        weights = weights_of(replica, seen)
        if all(one.size.multiple < MATTERS for one in (best.trial, *sure)):
            break  # reported as too small; it stays in the model, so that nothing that matters is found in its place
    return Outcome(replica, fitted, tuple(accepted), first, seen, weights, () if accepted else tuple(left))


def _screened(
    replica: Replica, fitted: Fitted, known: Known, tried: Sequence[Variant], unnamed: Sequence[Variant], pool: Executor
) -> Screen:  # fmt: skip
    """Screen the remaining names and terms about the accepted model."""
    left = [one for one in tried if one.name not in fitted.model.choice]
    return screen(replica, fitted.model, [*left, *unnamed], pool, fitted.variants, known)


def _settled_beside(
    replica: Replica, fitted: Fitted, accepted: Sequence[Accepted], seen: Screen
) -> tuple[Replica, Fitted, Known]:  # fmt: skip
    """Settle the fit with nuisance sizes that belong to the accepted mechanisms; return the noise, too.

    If a mechanism changes when or how speeds are read, other rows slide, and each replica gets new weights.
    """
    if not any(told(one.trial.listed) for one in accepted):
        noise = NoiseOn(replica, seen)
        return *settle(replica.recorded, fitted, noise.weights()), noise.known
    own, again, noise = weighed_anew(replica, fitted, seen)
    return own, again, noise.known


def _beside(
    accepted: list[Accepted], last: "Held", weights: Weights, seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return replica and fit of all accepted mechanisms, without those that are no longer sure with the last one present."""
    replica = last.replica
    kept, fitted = _still_sure(replica, accepted, last.trial.fitted, seen)
    if len(kept) < len(accepted):
        replica, fitted = settle(replica.recorded, fitted, weights)
    return _sized(replica, fitted, kept, seen)


def _exchanged(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Replace an earlier mechanism by a rival that explains more together with the later ones."""
    if len(accepted) < 2:
        return replica, fitted, accepted
    weights = weights_of(replica, seen)
    for one in accepted[:-1]:
        now = refit(replica, fitted.model, fitted.variants, weights)
        others = [variant for variant in fitted.variants if variant is not one.trial.variant]
        rest = refit(replica, without(fitted.model, one.trial.variant), others, weights)
        taken = {variant.title for variant in others}
        tried = []
        for rival in one.rivals:
            if rival.listed.title not in taken and not told(rival.listed):  # others were compared on their own replica
                begin = switched(rest.model, rival.variant, values_in(rival.fitted.model, rival.variant))
                again = refit(replica, begin, [*others, rival.variant], weights)
                reduction = rest.cost - again.cost
                tried.append(dataclasses.replace(
                    rival, fitted=again, beside=rest.model, reduction=reduction, evidence=0.5 * reduction - rival.price
                ))  # fmt: skip
        before = 0.5 * (rest.cost - now.cost) - one.trial.price
        for better in sorted(tried, key=lambda rival: -rival.evidence):
            if better.evidence <= before or bool(better.listed.family) > bool(one.trial.listed.family):
                break
            held = None if at_bound(better.variant, better.fitted.model) else about_its_own(replica, seen, weights, better)
            if held is not None and odds(held.trial.listed, held.trial.evidence) > SURE:
                kept = [other for other in accepted if other is not one]
                others_tried = [*tried, dataclasses.replace(one.trial, evidence=before)]
                named = Accepted(held.trial, *belief(_more_sure(held.trial, better), others_tried, ()))
                return _sized(held.replica, held.trial.fitted, [*kept, named], seen)
    return replica, fitted, accepted


def _more_sure(held: Trial, tried: Trial) -> Trial:
    """Return the trial with more evidence: competitors were also tried on the earlier, linear replica."""
    return max(held, tried, key=lambda one: one.evidence)


def _sized(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return replica, fit and mechanisms, with the mechanisms' sizes in the complete extended model."""
    sizes = [net_effect(replica, fitted.model, one.trial.variant, seen.whitening) for one in accepted]
    return replica, fitted, [one.sized(size) for one, size in zip(accepted, sizes, strict=True)]


def _still_sure(replica: Replica, accepted: list[Accepted], fitted: Fitted, seen: Screen) -> tuple[list[Accepted], Fitted]:
    """Remove earlier mechanisms that are no longer sure with the last one present: the better of two names may come second."""
    if len(accepted) < 2:
        return accepted, fitted
    weights = weights_of(replica, seen)
    for one in accepted[:-1]:
        beside = refit(replica, fitted.model, fitted.variants, weights)
        others = [variant for variant in fitted.variants if variant is not one.trial.variant]
        again = refit(replica, without(fitted.model, one.trial.variant), others, weights)
        if odds(one.trial.listed, 0.5 * (again.cost - beside.cost) - one.trial.price) <= SURE:
            accepted, fitted = [other for other in accepted if other is not one], again
    return accepted, fitted


def _preferred(trials: Sequence[Trial]) -> list[Trial]:
    """Sort trials, best first; a name precedes a term unless the term explains more than the name's form error allows."""
    if not trials:
        return []
    least = (1.0 - FORM) ** 2 * max(one.evidence for one in trials)
    return sorted(trials, key=lambda one: (bool(one.listed.family) or one.evidence < least, -one.evidence))


def _best(
    trials: Sequence[Trial], refuses: Callable[[Trial], bool], stands: Callable[[Trial], Held | None],
    least: Callable[[Trial], float],
) -> tuple[Held | None, dict[str, float]]:  # fmt: skip
    """Return the best trial that holds, and the titles of rejected trials with their log odds.

    The log odds of a trial must exceed `least`, and `refuses` must be false: for the trial as found, and about its own replica
    (`stands`). Rejected titles are not listed as alternatives.
    """
    best: Held | None = None
    refused: dict[str, float] = {}
    for one in _preferred([trial for trial in trials if odds(trial.listed, trial.evidence) > least(trial)]):
        if best is not None and _preferred([best.trial, one])[0] is best.trial:
            continue
        held = None if refuses(one) else stands(one)
        if held is None or odds(held.trial.listed, held.trial.evidence) <= least(held.trial) or refuses(held.trial):
            last = one if held is None else held.trial
            refused[one.listed.title] = odds(last.listed, last.evidence)
        elif best is None or _preferred([best.trial, held.trial])[0] is held.trial:
            best = held
    return best, refused


def _refused(replica: Replica, accepted: Sequence[Accepted], seen: Screen, trial: Trial) -> bool:
    """Whether a trial is rejected whatever its evidence: it is at a bound, or it compensates an earlier mechanism."""
    return at_bound(trial.variant, trial.fitted.model) or _compensates(replica, trial, accepted, seen)


def _compensates(replica: Replica, trial: Trial, accepted: Sequence[Accepted], seen: Screen) -> bool:
    """Whether a mechanism makes an earlier one grow by more than `GROWN`; a truly missing mechanism would not."""

    def size(model: Model, one: Accepted) -> float:
        return net_effect(replica, model, one.trial.variant, seen.whitening).multiple

    return any(size(trial.fitted.model, one) > GROWN * size(trial.beside, one) for one in accepted)


def belief(best: Trial, trials: Sequence[Trial], found: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names with nearly equal evidence, best first, and the share of belief in the best one."""
    evidence = {one.name: one.evidence for one in found} | {one.listed.title: one.evidence for one in trials}
    top = best.evidence
    scale = max(1.0, FORM**2 * top)
    others = {name: value for name, value in evidence.items() if name != best.listed.title}
    least = top - min((1.0 - (1.0 - FORM) ** 2) * top, INDISTINCT)
    near = sorted((name for name, value in others.items() if value > least), key=lambda name: -others[name])
    total = 1.0 + sum(float(np.exp((min(value, top) - top) / scale)) for value in others.values())
    return (best.listed.title, *near), 1.0 / total
