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

from wsp_env.diagnosis.agreement import agreement
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant, near, parameter_of, refined, switched, values_in, without
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.discovered import terms
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, cost, refit, weigh
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, Screen, net_effect, screen
from wsp_env.diagnosis.variation import Group, shapes
from wsp_env.plant.mechanisms import ALL

#: Mechanisms that are accepted at most.
MOST = 3
#: Mechanisms that are refitted in every round.
TRIED = 4
#: Replicas that are made after an acceptance, each about the fit to the one before: the first may be far from the recordings,
#: and of a wheel that is turned by a per cent so may the second. At least, and at most.
_REPLICAS = 2, 6
#: Deviations by which a size still moves from replica to replica, below which it has settled.
_SETTLED = 0.5
#: Shares of the linear step at which a refit may begin.
_SHARES = (2.0, 1.0, 0.5, 0.25, 0.1)
#: Log odds that a name of the library is missing in a campaign before it is seen: one in fifty (assumption).
PRIOR = -float(np.log(50.0))
#: The same of a term without a name: the library holds what practice meets (assumption: three in four).
PRIOR_TERM = PRIOR - float(np.log(3.0))
#: Log odds from which on a mechanism is accepted: 99 %.
SURE = float(np.log(99.0))
#: Smallest effects of interest from which on a size matters: one, less what its form may err by at 95 %,
#: 1 / (1 + 1.645 FORM), rounded.
MATTERS = 0.75
#: Evidence within which another name is as good, if its share of the best one's is what a form may miss: a factor of e^10.
INDISTINCT = 10.0
#: Factor by which a mechanism may grow beside a further one: twice what its own form may err by, at 90 % (assumption).
GROWN = 1.7
#: Deviations by which a nuisance may be pulled further beside a mechanism than without it: what cancels it is no finding.
PULLED = 4.0
#: Share of a mechanism's effect that nature's form may differ by, over slip, speed, work, axles and runs: assumption.
FORM = 0.2
#: The same of a term without a name, which is one of few forms that were tried: assumption.
FORM_TERM = 0.4


@dataclasses.dataclass(frozen=True)
class Trial:
    """A mechanism refitted together with those accepted before."""

    found: Found
    listed: Variant  # as it was searched
    variant: Variant  # with what the refit moves free
    fitted: Fitted
    evidence: float  # with what the refit explains more than the linear search
    reduction: float  # of chi-square, by the refit
    size: StopChange  # net


@dataclasses.dataclass(frozen=True)
class Accepted:
    """A mechanism that was accepted, and how."""

    trial: Trial
    alternatives: tuple[str, ...]  # its own name first
    confidence: float

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

    @property
    def missing(self) -> tuple[Accepted, ...]:
        """What is missing and matters."""
        return tuple(one for one in self.accepted if one.trial.size.multiple >= MATTERS)


def form_of(variant: Variant) -> float:
    """Share of an effect that nature's form may differ by; none where it is what a sensor shows by geometry or by its clock."""
    if variant.family:
        return FORM_TERM
    signature = ALL[variant.name].signature
    return 0.0 if signature.exact and signature.acts_on == "sensor" else FORM


def odds(variant: Variant, evidence: float) -> float:
    """Log odds that a mechanism is missing, or a term that has no name."""
    return evidence + (PRIOR_TERM if variant.family else PRIOR)


def select(
    replica: Replica, tried: Sequence[Variant], pool: Executor, progress: Callable[[str], None] = lambda step: None
) -> Outcome:
    """Accept mechanisms one after the other; what competes is refitted side by side."""
    first = seen = screen(replica, replica.baseline, [*tried, *terms(replica, 1)], pool)
    fitted = Fitted(replica.baseline, (), (), (), 0.0)
    accepted: list[Accepted] = []
    for _ in range(2 * MOST):  # rounds: one may be taken back
        if len(accepted) == MOST:
            break
        progress(f"refitting {len(accepted) + 1} of {MOST}")
        weights = weights_of(replica, seen)
        trials = _trials(replica, seen, fitted, weights, pool)
        # What the form of those before may leave of what they explain looks like another.
        form = sum(form_of(one.trial.listed) ** 2 * one.trial.evidence for one in accepted)
        sure = [one for one in trials if odds(one.listed, one.evidence) > max(SURE, form)]
        refused: set[str] = set()  # what contradicts itself is no alternative either
        best = _first_that_holds(sure, functools.partial(_refused, replica, accepted, fitted.model, seen, weights), refused)
        if best is None:
            break
        rivals = [one for one in trials if one.listed.title not in refused]
        accepted.append(Accepted(best, *belief(best, rivals, [one for one in seen.found if one.name not in refused])))
        accepted, fitted = _still_sure(replica, accepted, best.fitted, seen)
        if all(one.size.multiple < MATTERS for one in sure):
            break  # told as too small; nothing that matters could be taken for it
        replica, fitted = _settled(replica.recorded, fitted, weights)
        accepted = [one.sized(net_effect(replica, fitted.model, one.trial.variant, seen.whitening)) for one in accepted]
        left = [one for one in tried if one.name not in fitted.model.choice]
        left += terms(replica, 1 + sum(len(one.trial.listed.sizes) for one in accepted if one.trial.listed.family))
        bent = forms(replica, fitted.model, fitted.variants)
        seen = screen(replica, fitted.model, left, pool, fitted.variants, bent)
    return Outcome(replica, fitted, tuple(accepted), first, seen)


def _still_sure(replica: Replica, accepted: list[Accepted], fitted: Fitted, seen: Screen) -> tuple[list[Accepted], Fitted]:
    """Take back what is no longer sure beside the last one: of two names for one effect the better may come second."""
    for one in accepted[:-1]:
        weights = weights_of(replica, seen, one.trial.variant)
        beside = refit(replica, fitted.model, fitted.variants, weights)
        others = [variant for variant in fitted.variants if variant is not one.trial.variant]
        again = refit(replica, without(fitted.model, one.trial.variant), others, weights)
        price = 0.5 * one.trial.reduction - one.trial.evidence  # of its sizes and variants
        if odds(one.trial.listed, 0.5 * (again.cost - beside.cost) - price) <= SURE:
            accepted, fitted = [other for other in accepted if other is not one], again
    return accepted, fitted


def _settled(recorded: Balances, fitted: Fitted, weights: Weights) -> tuple[Replica, Fitted]:
    """Return the replica about an extended model, and the model fitted to it."""
    for made in range(1, _REPLICAS[1] + 1):
        replica = Replica(recorded, _with_sensors_as_read(fitted.model))
        again = refit(replica, fitted.model, fitted.variants, weights)
        moved = max(
            float(np.max(np.abs(new - old) / np.sqrt(np.maximum(np.diag(spread), 1e-300))))
            for new, old, spread in zip(again.values, fitted.values, again.covariance, strict=True)
        )
        fitted = again
        if made >= _REPLICAS[0] and moved < _SETTLED:
            break
    return replica, fitted


def _with_sensors_as_read(model: Model) -> Model:
    """Return a model without mechanisms on sensors: a replica holds what sensors read."""
    true = {name: values for name, values in model.choice.items() if ALL[name].signature.acts_on != "sensor"}
    return dataclasses.replace(model, choice=true)


def weights_of(replica: Replica, seen: Screen, asked: Variant | None = None) -> Weights:
    """Return the weights of a screen; not those of the form of a mechanism that is asked for, which would stand in for it."""
    kept = [i for i, group in enumerate(seen.groups) if asked is None or group.name != _form_name(asked)]
    sizes = Sizes(np.append(seen.sizes.groups[kept], 1.0), seen.sizes.noise)
    return weigh(replica, seen.whitening, [*(seen.groups[i] for i in kept), seen.small], sizes)


def _form_name(variant: Variant) -> str:
    return f"form of {variant.title}"


def _preferred(trials: Sequence[Trial]) -> list[Trial]:
    """Sort trials, the best first: a name before a term that explains no more than the name's own form may miss."""
    if not trials:
        return []
    least = (1.0 - FORM) ** 2 * max(one.evidence for one in trials)
    return sorted(trials, key=lambda one: (bool(one.listed.family) or one.evidence < least, -one.evidence))


def _first_that_holds(sure: Sequence[Trial], refuses: Callable[[Trial], bool], refused: set[str]) -> Trial | None:
    """Return the best trial that is not refused; the names of those that are, are added to `refused`."""
    for one in _preferred(sure):
        if not refuses(one):
            return one
        refused.add(one.listed.title)
    return None


def _refused(
    replica: Replica, accepted: Sequence[Accepted], before: Model, seen: Screen, weights: Weights, trial: Trial
) -> bool:
    """Whether a mechanism contradicts itself, whatever its evidence."""
    if at_bound(trial.listed, trial.fitted.model) or _compensates(replica, trial, accepted, seen):
        return True
    runs = agreement(replica, trial.fitted.model, trial.variant, weights, form_of(trial.listed))
    if odds(trial.listed, runs.left_of(trial.evidence)) <= SURE:
        return True
    return _pulls(replica, trial, before, weights)


def at_bound(listed: Variant, model: Model) -> bool:
    """Whether a size was fitted to the end of what it may be: the recordings ask for something else."""
    for name, value in zip(listed.sizes, values_in(model, listed), strict=True):
        size = parameter_of(listed.name, name)
        if value != size.null and not size.low < value < size.high:
            return True
    return False


def _compensates(replica: Replica, trial: Trial, accepted: Sequence[Accepted], seen: Screen) -> bool:
    """Whether a mechanism makes one of those before grow: what is missing beside another leaves the other as it is."""
    for one in accepted:
        now = net_effect(replica, trial.fitted.model, one.trial.variant, seen.whitening).multiple
        if now > GROWN * one.trial.size.multiple:
            return True
    return False


def _pulls(replica: Replica, trial: Trial, before: Model, weights: Weights) -> bool:
    """Whether a mechanism pulls nuisances from what they are: what is missing lets them relax, as they stood in for it."""

    def unlikely(model: Model) -> float:
        amplitudes = weights.projector.amplitudes(weights(replica.raw(model)))
        return float(amplitudes @ amplitudes)

    return unlikely(trial.fitted.model) - unlikely(before) > PULLED**2


def _trials(replica: Replica, seen: Screen, fitted: Fitted, weights: Weights, pool: Executor) -> list[Trial]:
    """Refit the mechanisms that promise most; the best first."""
    promising = sorted(seen.found, key=lambda one: -odds(one.candidate.variant, one.evidence))[:TRIED]
    promising = [one for one in promising if odds(one.candidate.variant, one.evidence) > 0.0]
    if not promising:
        return []
    # A refit moves where a mechanism acts only from near: its next best place or band may be the better one to begin with.
    seconds = [seen.second[one.name] for one in promising if one.name in seen.second]
    promising += [one for one in seconds if len(refined(one.candidate.variant).sizes) > len(one.candidate.variant.sizes)]
    start = refit(replica, fitted.model, fitted.variants, weights)

    def trial(one: Found) -> Trial:
        listed = one.candidate.variant
        change = -one.amplitude * listed.moves()
        best, free = start, listed
        # The linear step may lead astray: the refit begins where the way to it leaves least. Where it acts may be found better
        # than it was searched, or be lost.
        on_the_way = [switched(start.model, listed, listed.null() + share * change) for share in _SHARES]
        first, second = sorted(on_the_way, key=lambda model: cost(replica, model, weights))[:2]
        there, wide = near(listed), refined(near(listed))
        narrow = [(there, first)] if wide.sizes != there.sizes else []
        for tried, begin in ((wide, first), *narrow, (wide, second)):
            again = refit(replica, begin, (*start.variants, tried), weights)
            if again.cost < best.cost or best is start:
                best, free = again, tried
            if best.cost < start.cost - 0.8 * one.reduction:
                break
        # Those before may fit better now for a reason of their own: no merit of the one that was tried.
        alone = refit(replica, without(best.model, free), start.variants, weights)
        reduction = min(start.cost, alone.cost) - best.cost
        evidence = one.evidence + 0.5 * (reduction - one.reduction)
        return Trial(one, listed, free, best, evidence, reduction, net_effect(replica, best.model, free, seen.whitening))

    best: dict[str, Trial] = {}
    for one in sorted(pool.map(trial, promising), key=lambda one: -odds(one.listed, one.evidence)):
        best.setdefault(one.listed.title, one)
    return list(best.values())


def forms(replica: Replica, model: Model, variants: Sequence[Variant]) -> list[Group]:
    """Return for every mechanism that is on what it may leave of nature's form: its own effect, bent over what was measured."""
    base, bent = replica.raw(model), shapes(replica)
    return [
        Group(_form_name(one), (replica.raw(without(model, one)) - base)[:, None] * bent, form_of(one), True)
        for one in variants
        if form_of(one) > 0.0
    ]


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
