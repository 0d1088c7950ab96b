"""Decides: which mechanisms are missing, one after the other, each fitted together with all before it.

A mechanism is accepted if the recordings say that it matters: its evidence (`wsp_env.diagnosis.search`) makes up for how rarely
one is missing, and its size, net of what another tau and mu_cd do as well, passes the smallest effect of interest.
"""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from wsp_env.diagnosis.candidates import Variant, choice_of, parameter_of, refined
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit, weigh
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, Screen, net_effect, screen
from wsp_env.diagnosis.variation import Group, shapes
from wsp_env.plant.mechanisms import ALL

#: Mechanisms that are accepted at most.
MOST = 3
#: Mechanisms that are refitted in every round.
TRIED = 4
#: Log odds that a name of the library is missing in a campaign before it is seen: one in fifty (assumption).
PRIOR = -float(np.log(50.0))
#: Log odds from which on a mechanism is accepted: 95 %.
SURE = float(np.log(19.0))
#: Share of a mechanism's effect that nature's form may differ by, over slip, speed, work, axles and runs: assumption.
FORM = 0.15


@dataclasses.dataclass(frozen=True)
class Trial:
    """A mechanism refitted together with those accepted before."""

    found: Found
    listed: Variant  # as it was searched
    variant: Variant  # with what the refit moves free
    fitted: Fitted
    evidence: float  # with what the refit explains more than the linear search
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
        return self.trial.listed.name


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The end of the selection."""

    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: Screen  # about the baseline
    last: Screen  # about the extended model
    refused: tuple[Trial, ...]  # seen, but too small to matter


def odds(evidence: float) -> float:
    """Log odds that a mechanism is missing."""
    return evidence + PRIOR


def select(replica: Replica, tried: Sequence[Variant], pool: Executor) -> Outcome:
    """Accept mechanisms one after the other; what competes is refitted side by side."""
    first = seen = screen(replica, replica.baseline, tried, pool)
    fitted, accepted, refused = Fitted(replica.baseline, (), (), (), 0.0), [], []
    while len(accepted) < MOST:
        weights = _weights(replica, seen)
        trials = _trials(replica, seen, fitted, weights, pool)
        sure = [one for one in trials if odds(one.evidence) > SURE]
        refused += [one for one in sure if one.size.multiple < 1.0]
        matter = [one for one in sure if one.size.multiple >= 1.0]
        if not matter:
            break
        best = matter[0]
        alternatives, confidence = belief(best, trials, seen.found)
        accepted.append(Accepted(best, alternatives, confidence))
        fitted = best.fitted
        seen = screen(replica, fitted.model, _left(tried, fitted.model), pool, forms(replica, fitted.model), seen.sizes)
    return Outcome(fitted, tuple(accepted), first, seen, tuple(refused))


def _left(tried: Sequence[Variant], model: Model) -> list[Variant]:
    return [one for one in tried if one.name not in model.choice]


def _weights(replica: Replica, seen: Screen) -> Weights:
    sizes = Sizes(np.concatenate([seen.sizes.groups, [1.0]]), seen.sizes.noise)
    return weigh(replica, seen.whitening, [*seen.groups, seen.small], sizes)


def _trials(replica: Replica, seen: Screen, fitted: Fitted, weights: Weights, pool: Executor) -> list[Trial]:
    """Refit the mechanisms that promise most; the best first."""
    promising = [one for one in seen.found if odds(one.evidence) > 0.0][:TRIED]
    if not promising:
        return []
    start = refit(replica, fitted.model, fitted.variants, weights)

    def trial(one: Found) -> Trial:
        listed = one.candidate.variant
        assert listed is not None
        free, _ = refined(listed)
        null = np.array([parameter_of(listed.name, name).null for name in listed.sizes])
        values = null - one.amplitude * one.candidate.steps
        best = None
        for share in (1.0, 0.4, 2.0):  # the linear step may lead astray
            choice = {**start.model.choice, **choice_of(listed, null + share * (values - null))}
            again = refit(replica, dataclasses.replace(start.model, choice=choice), (*start.variants, free), weights)
            if best is None or again.cost < best.cost:
                best = again
            if best.cost < start.cost - 0.8 * one.reduction:
                break
        assert best is not None
        evidence = one.evidence + 0.5 * (start.cost - best.cost - one.reduction)
        return Trial(one, listed, free, best, evidence, net_effect(replica, best.model, listed.name, seen.whitening))

    return sorted(pool.map(trial, promising), key=lambda one: -one.evidence)


def forms(replica: Replica, model: Model) -> list[Group]:
    """Return for every mechanism that is on what it may leave of nature's form: its own effect, bent over what was measured."""
    found = []
    base = replica.raw(model)
    bent = shapes(replica)
    for name in model.choice:
        if ALL[name].signature.exact:
            continue
        without = dataclasses.replace(model, choice={other: values for other, values in model.choice.items() if other != name})
        effect = replica.raw(without) - base
        found.append(Group(f"form of {name}", effect[:, None] * bent, FORM, True))
    return found


def belief(best: Trial, trials: Sequence[Trial], found: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names that explain nearly as much, best first, and the share of belief in the best."""
    evidence = {one.name: one.evidence for one in found} | {one.listed.name: one.evidence for one in trials}
    top = best.evidence
    scale = max(1.0, FORM**2 * top)
    others = {name: value for name, value in evidence.items() if name != best.listed.name}
    near = sorted((name for name, value in others.items() if value > top - 3.0 * scale), key=lambda name: -others[name])
    total = 1.0 + sum(float(np.exp((min(value, top) - top) / scale)) for value in others.values())
    return (best.listed.name, *near), 1.0 / total
