"""Accepted mechanisms: with alternatives, confidence and size."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.net import net_effect
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, Screen
from wsp_env.diagnosis.trials import FORM, INDISTINCT, Trial


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


def sized(
    replica: Replica, fitted: Fitted, accepted: list[Accepted], seen: Screen
) -> tuple[Replica, Fitted, list[Accepted]]:  # fmt: skip
    """Return replica, fit and mechanisms, with the mechanisms' sizes in the complete extended model."""
    sizes = [net_effect(replica, fitted.model, one.trial.variant, seen.whitening) for one in accepted]
    return replica, fitted, [one.sized(size) for one, size in zip(accepted, sizes, strict=True)]


def posterior(best: Trial, trials: Sequence[Trial], found: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names with nearly equal evidence, best first, and the posterior probability of the best one."""
    evidence = {one.name: one.evidence for one in found} | {one.listed.title: one.evidence for one in trials}
    top = best.evidence
    scale = max(1.0, FORM**2 * top)
    others = {name: value for name, value in evidence.items() if name != best.listed.title}
    least = top - min((1.0 - (1.0 - FORM) ** 2) * top, INDISTINCT)
    near = sorted((name for name, value in others.items() if value > least), key=lambda name: -others[name])
    total = 1.0 + sum(float(np.exp((min(value, top) - top) / scale)) for value in others.values())
    return (best.listed.title, *near), 1.0 / total
