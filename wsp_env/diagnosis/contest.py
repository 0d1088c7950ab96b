"""Which of the tried mechanisms holds, and is the best: as found, about a replica of its own, and beside its rivals."""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.retest import EqualTerms, Retested
from wsp_env.diagnosis.trials import FORM, INDISTINCT, MATTERS, SURE, Trial, corrects_recordings, form_of, log_odds

#: Log odds of what explains nothing with variances of its own residuals, or may be too small to matter there.
NOT_SEEN = -float("inf")


def at_least(trial: Trial) -> float:
    """Return the lower limit of a trial's size (95 %) in smallest effects of interest."""
    deviations = np.sqrt(max(trial.reduction, np.finfo(float).tiny))  # from zero, as for a single size
    return trial.size.multiple * (1.0 - float(norm.ppf(0.95)) / float(deviations))


def preferred(trials: Sequence[Trial]) -> list[Trial]:
    """Sort trials, best first; a name precedes a term unless the term explains more than the name's form error allows."""
    if not trials:
        return []
    least = (1.0 - FORM) ** 2 * max(one.evidence for one in trials)
    return sorted(trials, key=lambda one: (bool(one.listed.family) or one.evidence < least, -one.evidence))


class Contest(NamedTuple):
    """The best trial that holds, and all trials."""

    best: Retested | None
    rejected: dict[str, float]  # titles of trials that do not hold, with their log odds; they are no alternatives
    trials: list[Trial]


def best_of(
    batches: Iterable[Sequence[Trial]], rejects: Callable[[Trial], bool],
    retest_trial: Callable[[Trial, Fitted | None], Retested | None], equal: EqualTerms, threshold: Callable[[Trial], float],
    pool: Executor, first_round: bool = True,
) -> Contest:  # fmt: skip
    """Return the best trial of the first batch; in the first round, of the first batch in which one holds.

    All promising trials are tested about replicas of their own (`retest_trial`), where they may change places: what explains
    hardly anything linearly may explain most. There, the log odds must exceed `threshold`, and `rejects` must be false. The
    best must not lose its evidence with variances of its own residuals, and is compared there with all others that hold; a
    further finding must be sure there. Suspended trials are tested with own variances if none holds, and in the first round if
    the best keeps its evidence there only within the scatter, or if one explained distinctly more when it was found. They must
    surely matter. If none holds, the mean of the three estimates of their evidence must be sure: as found, about their own
    replica, and with own variances. Otherwise they must explain more than the best and the scatter together.
    """
    rejected: dict[str, float] = {}
    suspended: list[tuple[Trial, Retested]] = []
    trials: list[Trial] = []

    def holds(one: Trial) -> bool:
        return log_odds(one.listed, one.evidence) > threshold(one) and not rejects(one)

    def test(one: Trial, begin: Fitted | None = None) -> Retested | None:
        return None if rejects(one) else retest_trial(one, begin)

    @functools.cache
    def tested_again() -> list[tuple[Trial, float, Retested]]:
        """Return suspended trials that surely matter with own variances, each with the evidence that it had lost before."""
        found = [(one, before.trial.evidence, _if(holds, test(one, before.suspended))) for one, before in suspended]
        return [
            (one, min(lost, 0.0), again) for one, lost, again in found if again is not None and at_least(again.trial) >= MATTERS
        ]

    def surer(least: float) -> list[Retested]:
        """Return the suspended trials that explain more than `least` with own variances, best first; others were not seen."""
        kept = [(again.trial, again) for _, _, again in tested_again() if again.trial.evidence > least]
        rejected.update(dict.fromkeys((one.listed.title for one, _ in suspended), NOT_SEEN))
        for one, _ in kept:
            rejected.pop(one.listed.title)
        return _preferred(kept)

    for some in batches:
        trials += some
        held: list[tuple[Trial, Retested]] = []
        refused: list[Trial] = []  # for what they do to nuisances whose variances may be too large
        promising = [one for one in some if _is_promising(one, threshold)]
        for one, retested in zip(promising, pool.map(test, promising), strict=True):
            last = one if retested is None else retested.trial
            if retested is not None and retested.suspended is None and holds(last):
                held.append((one, retested))
                continue
            rejected[one.listed.title] = log_odds(last.listed, last.evidence)
            if retested is None and not rejects(one):
                refused.append(one)
            elif retested is not None and retested.suspended is not None:
                suspended.append((one, retested))
        order = _preferred(held)
        while order:
            best, *order = order
            others = [*(one.trial for one in order), *refused]
            least = -np.inf if first_round else SURE - log_odds(best.trial.listed, 0.0)
            winner = _on_equal_terms(best, others, equal, lambda one: _if(holds, retest_trial(one, one.fitted)), pool, least)
            if winner is not None:
                if first_round and suspended and not corrects_recordings(winner.trial.listed):
                    own = equal.evidence(winner.trial)
                    distinctly = winner.trial.evidence + INDISTINCT
                    if own < _share(winner.trial) or any(one.evidence > distinctly for one, _ in suspended):
                        winner = next(iter(surer(max(own, 0.0) + equal.scatter)), winner)
                rejected.pop(winner.trial.listed.title, None)
                return Contest(winner, rejected, trials)
            rejected[best.trial.listed.title] = NOT_SEEN
        if not first_round:
            break
    gained = [
        (again.trial, again)
        for one, lost, again in tested_again()
        if log_odds(one.listed, (one.evidence + lost + again.trial.evidence) / 3.0) > threshold(again.trial)
    ]
    best_gained = next(iter(_preferred(gained)), None)
    more = surer(np.inf if best_gained is None else best_gained.trial.evidence + equal.scatter)
    for one, _ in gained:
        rejected.pop(one.listed.title, None)
    return Contest(next(iter(more), best_gained), rejected, trials)


def _share(one: Trial) -> float:
    """Return the share of its evidence that a trial must keep on equal terms, for the possible error of its form."""
    return (1.0 - form_of(one.listed)) ** 2 * one.evidence


def _is_promising(one: Trial, threshold: Callable[[Trial], float]) -> bool:
    """Whether a trial may hold about a replica of its own; those that correct the recordings have one already."""
    if log_odds(one.listed, one.evidence) > threshold(one):
        return True
    return not corrects_recordings(one.listed) and log_odds(one.listed, one.found.evidence) > 0.0


def _if(holds: Callable[[Trial], bool], retested: Retested | None) -> Retested | None:
    """Return what was tested, if it holds."""
    return retested if retested is not None and retested.suspended is None and holds(retested.trial) else None


def _preferred(held: Sequence[tuple[Trial, Retested]]) -> list[Retested]:
    """Sort what holds, best first, by its evidence as it was found or about its own replica: the larger counts.

    Both are uncertain, in different ways. On equal terms, a rival must exceed the best one by the scatter.
    """
    larger = [dataclasses.replace(one.trial, evidence=max(as_found.evidence, one.trial.evidence)) for as_found, one in held]
    order = preferred(larger)
    return [held[next(i for i, one in enumerate(larger) if one is trial)][1] for trial in order]


def _on_equal_terms(
    best: Retested, rivals: Sequence[Trial], equal: EqualTerms, retest_on_own: Callable[[Trial], Retested | None],
    pool: Executor, least: float,
) -> Retested | None:  # fmt: skip
    """Return the best of what holds, or another that explains far more, if each has variances of its own residuals.

    Return None if the best one fails. Variances estimated without a mechanism are too large if it is missing. They may hide how
    much more the true one explains, and that a false one explains nothing that smaller variances would not leave.

    Parameters
    ----------
    retest_on_own : retest of a trial with variances of its own residuals; None if it does not hold
    least : evidence that the best one must have there in any case

    """
    needed = max(_share(best.trial) - equal.scatter, least)
    if not rivals:
        return best if equal.evidence(best.trial, needed) >= needed else None
    own, *theirs = pool.map(equal.evidence, [best.trial, *rivals])
    if own < needed:
        return None
    if max(theirs) <= equal.scatter + max(best.trial.evidence, own):
        return best
    pairs = zip([best.trial, *rivals], [own, *theirs], strict=True)
    compared = [dataclasses.replace(one, evidence=evidence) for one, evidence in pairs]
    for first in preferred(compared):
        if first is compared[0]:
            break
        retested = retest_on_own(next(one for one in rivals if one.listed is first.listed))
        if retested is not None:
            return retested
    return best
