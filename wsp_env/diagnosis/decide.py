"""Decides: which mechanisms are missing, one after the other, each fitted together with all before it.

A mechanism is accepted if its evidence (`wsp_env.diagnosis.search`) makes up for how rarely one is missing. It is named if its
size, net of what another tau and mu_cd do as well, passes the smallest effect of interest; else it stays in the model, so that
nothing else is named for it.
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
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, Screen, net_effect, screen
from wsp_env.diagnosis.settle import moved, settle
from wsp_env.diagnosis.standing import MOVES, Held, about_its_own, weighed_anew
from wsp_env.diagnosis.structure import structured
from wsp_env.diagnosis.trials import FORM, SURE, FormsLeft, Trial, odds, told, trials_of, weights_of

#: Mechanisms that are accepted at most.
MOST = 3
#: Smallest effects of interest from which on a size matters: one, less what its form may err by at 95 %,
#: 1 / (1 + 1.645 FORM), rounded.
MATTERS = 0.75
#: Evidence within which another name is as good, if its share of the best one's is what a form may miss: a factor of e^10.
INDISTINCT = 10.0
#: Factor by which a mechanism may grow beside a further one: twice what its own form may err by, at 90 % (assumption).
GROWN = 1.7


@dataclasses.dataclass(frozen=True)
class Accepted:
    """A mechanism that was accepted, and how."""

    trial: Trial
    alternatives: tuple[str, ...]  # its own name first
    confidence: float
    rivals: tuple[Trial, ...] = ()  # what was sure as well when it was accepted

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.trial.listed.title

    @property
    def words(self) -> str:
        """The name, as it is said."""
        return self.name.replace("_", " ")

    def sized(self, size: StopChange) -> "Accepted":
        """Return it with the size that it has in the whole of the extended model."""
        return dataclasses.replace(self, trial=dataclasses.replace(self.trial, size=size))


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The end of the selection."""

    replica: Replica  # about the extended model
    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: Screen  # about the baseline
    last: Screen  # about the extended model
    weights: Weights  # that the extended model's residuals are compared with
    refused: tuple[Trial, ...] = ()  # where nothing was accepted: what has evidence and matters, but does not hold

    @property
    def missing(self) -> tuple[Accepted, ...]:
        """What is missing and matters."""
        return tuple(one for one in self.accepted if one.trial.size.multiple >= MATTERS)


def select(
    replica: Replica, tried: Sequence[Variant], pool: Executor, progress: Callable[[str], None] = lambda step: None
) -> Outcome:
    """Accept mechanisms one after the other; what competes is refitted side by side."""
    first = seen = screen(replica, replica.baseline, [*tried, *terms(replica)], pool)
    weights = weights_of(replica, seen)
    by_curves = False
    fitted = Fitted(replica.baseline, (), (), (), 0.0)
    accepted: list[Accepted] = []
    left: list[Trial] = []
    for _ in range(2 * MOST):  # rounds: one may be taken back
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
            by_curves = True  # nothing that has a form holds
            seen = _screened(replica, fitted, tried, curves(replica, [one.trial.listed for one in accepted]), pool)
            weights = weights_of(replica, seen)
            continue
        others = [one for one in trials if one.listed.title not in {*refused, best.trial.listed.title}]
        sure = [one for one in others if odds(one.listed, one.evidence) > forms_left(one)]
        searched = [one for one in seen.found if one.name not in refused]
        first_tried = next(one for one in trials if one.listed.title == best.trial.listed.title)
        named = Accepted(best.trial, *belief(_more_sure(best.trial, first_tried), others, searched), tuple(sure))
        replica, fitted, accepted = _beside([*accepted, named], best, weights, seen)
        replica, fitted, accepted = _exchanged(replica, fitted, accepted, seen)
        seen = _screened(replica, fitted, tried, terms(replica, [one.trial.listed for one in accepted]), pool)
        weights = weights_of(replica, seen)
        # What was missing made everything else seem to vary more, and so itself seem smaller.
        own, again = _settled_beside(replica, fitted, accepted, seen, weights)
        if np.isfinite(again.cost) and moved(fitted, again) > MOVES:
            replica, fitted, accepted = _sized(own, again, accepted, seen)
            seen = _screened(replica, fitted, tried, terms(replica, [one.trial.listed for one in accepted]), pool)
            weights = weights_of(replica, seen)
        if all(one.size.multiple < MATTERS for one in (best.trial, *sure)):
            break  # told as too small; nothing that matters could be taken for it
    return Outcome(replica, fitted, tuple(accepted), first, seen, weights, () if accepted else tuple(left))


def _screened(
    replica: Replica, fitted: Fitted, tried: Sequence[Variant], unnamed: Sequence[Variant], pool: Executor
) -> Screen:  # fmt: skip
    """Return the names that are left, and what has none, about what was accepted."""
    left = [one for one in tried if one.name not in fitted.model.choice]
    return screen(replica, fitted.model, [*left, *unnamed], pool, fitted.variants)


def _settled_beside(
    replica: Replica, fitted: Fitted, accepted: Sequence[Accepted], seen: Screen, weights: Weights
) -> tuple[Replica, Fitted]:  # fmt: skip
    """Settle under the sizes of nuisances beside what was accepted.

    Where wheels are read later, or their speeds otherwise, other rows slide: then every replica is weighed anew.
    """
    if not any(told(one.trial.listed) for one in accepted):
        return settle(replica.recorded, fitted, weights)
    own, again, _ = weighed_anew(replica, fitted, seen)
    return own, again


def _beside(
    accepted: list[Accepted], last: "Held", weights: Weights, seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return the replica and the fit with all that was accepted, less what is no longer sure beside the last one."""
    replica = last.replica
    kept, fitted = _still_sure(replica, accepted, last.trial.fitted, seen)
    if len(kept) < len(accepted):
        replica, fitted = settle(replica.recorded, fitted, weights)
    return _sized(replica, fitted, kept, seen)


def _exchanged(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Exchange an earlier mechanism for a rival that explains more beside what was accepted later."""
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
            if rival.listed.title not in taken and not told(rival.listed):  # that was compared about its own replica
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
    """Return the one of both with more evidence: what competes was tried about the last replica too, and nothing was bent."""
    return max(held, tried, key=lambda one: one.evidence)


def _sized(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return the same, with the sizes that mechanisms have in the whole of the extended model."""
    sizes = [net_effect(replica, fitted.model, one.trial.variant, seen.whitening) for one in accepted]
    return replica, fitted, [one.sized(size) for one, size in zip(accepted, sizes, strict=True)]


def _still_sure(replica: Replica, accepted: list[Accepted], fitted: Fitted, seen: Screen) -> tuple[list[Accepted], Fitted]:
    """Take back what is no longer sure beside the last one: of two names for one effect the better may come second."""
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
    """Sort trials, the best first: a name before a term that explains no more than the name's own form may miss."""
    if not trials:
        return []
    least = (1.0 - FORM) ** 2 * max(one.evidence for one in trials)
    return sorted(trials, key=lambda one: (bool(one.listed.family) or one.evidence < least, -one.evidence))


def _best(
    trials: Sequence[Trial], refuses: Callable[[Trial], bool], stands: Callable[[Trial], Held | None],
    least: Callable[[Trial], float],
) -> tuple[Held | None, dict[str, float]]:  # fmt: skip
    """Return the best trial that holds, and the names of those found not to, with their log odds: no alternatives either.

    Its log odds must be above the `least`, and nothing may refuse it, as it was found and as it `stands`.
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
    """Whether a mechanism contradicts itself, whatever its evidence."""
    return at_bound(trial.variant, trial.fitted.model) or _compensates(replica, trial, accepted, seen)


def _compensates(replica: Replica, trial: Trial, accepted: Sequence[Accepted], seen: Screen) -> bool:
    """Whether a mechanism makes one of those before grow: what is missing beside another leaves the other as it is."""

    def size(model: Model, one: Accepted) -> float:
        return net_effect(replica, model, one.trial.variant, seen.whitening).multiple

    return any(size(trial.fitted.model, one) > GROWN * size(trial.beside, one) for one in accepted)


def belief(best: Trial, trials: Sequence[Trial], found: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names that explain nearly as much, best first, and the share of belief in the best."""
    evidence = {one.name: one.evidence for one in found} | {one.listed.title: one.evidence for one in trials}
    top = best.evidence
    scale = max(1.0, FORM**2 * top)
    others = {name: value for name, value in evidence.items() if name != best.listed.title}
    least = top - min((1.0 - (1.0 - FORM) ** 2) * top, INDISTINCT)
    near = sorted((name for name, value in others.items() if value > least), key=lambda name: -others[name])
    total = 1.0 + sum(float(np.exp((min(value, top) - top) / scale)) for value in others.values())
    return (best.listed.title, *near), 1.0 / total
