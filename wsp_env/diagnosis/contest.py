"""Which of the tried mechanisms holds, and is the best: as found, about a replica of its own, and beside its rivals."""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.retest import EqualTerms, Retested
from wsp_env.diagnosis.trials import FORM, Trial, corrects_recordings, form_of, log_odds

#: Log odds of what explains nothing with variances of its own residuals.
NOT_SEEN = -float("inf")


def preferred(trials: Sequence[Trial]) -> list[Trial]:
    """Sort trials, best first; a name precedes a term unless the term explains more than the name's form error allows."""
    if not trials:
        return []
    least = (1.0 - FORM) ** 2 * max(one.evidence for one in trials)
    return sorted(trials, key=lambda one: (bool(one.listed.family) or one.evidence < least, -one.evidence))


def best_of(
    trials: Sequence[Trial], rejects: Callable[[Trial], bool], retest_trial: Callable[[Trial, Fitted | None], Retested | None],
    equal: EqualTerms, threshold: Callable[[Trial], float], pool: Executor, again: bool = True,
) -> tuple[Retested | None, dict[str, float]]:  # fmt: skip
    """Return the best trial that holds, and the titles of rejected trials with their log odds.

    The log odds of a trial must exceed `threshold`, and `rejects` must be false: for the trial as found, and about its own
    replica (`retest_trial`). If none holds with the variances as they are, suspended trials are tested with own
    variances if `again`. What holds must not lose its evidence with own variances, and is compared with its rivals there.
    Rejected titles are not listed as alternatives.
    """
    best: Retested | None = None
    rejected: dict[str, float] = {}
    suspended: dict[str, Fitted] = {}

    def holds(one: Trial) -> bool:
        return log_odds(one.listed, one.evidence) > threshold(one) and not rejects(one)

    def retest_on_own(one: Trial) -> Retested | None:
        retested = retest_trial(one, one.fitted)
        return retested if retested is not None and holds(retested.trial) else None

    def test(one: Trial, scatter: float = 0.0) -> None:
        nonlocal best
        retested = None if rejects(one) else retest_trial(one, suspended.pop(one.listed.title, None))
        last = one if retested is None else dataclasses.replace(retested.trial, evidence=retested.trial.evidence - scatter)
        if retested is not None and retested.suspended is not None:
            suspended[one.listed.title] = retested.suspended
        elif retested is not None and holds(last):
            rejected.pop(one.listed.title, None)
            best = retested if best is None or preferred([best.trial, retested.trial])[0] is retested.trial else best
            return
        rejected[one.listed.title] = log_odds(last.listed, last.evidence)

    promising = preferred([trial for trial in trials if log_odds(trial.listed, trial.evidence) > threshold(trial)])
    while left := [one for one in promising if one.listed.title not in rejected]:
        best = None
        for one in left:
            if best is None or preferred([best.trial, one])[0] is one:
                test(one)
        if best is None:
            break
        title = best.trial.listed.title
        others = [one for one in left if one.listed.title not in {title, *rejected} and not rejects(one)]
        found = next(one for one in left if one.listed.title == title)
        winner = _on_equal_terms(best, found, others, equal, retest_on_own, pool)
        if winner is not None:
            return winner, rejected
        rejected[title] = NOT_SEEN
    best = None
    if again:  # the evidence with which these were found is void: all are tested, and must exceed the scatter
        for one in [one for one in promising if one.listed.title in suspended]:
            test(one, equal.scatter)
    return best, rejected


def _on_equal_terms(
    best: Retested, found: Trial, others: Sequence[Trial], equal: EqualTerms,
    retest_on_own: Callable[[Trial], Retested | None], pool: Executor,
) -> Retested | None:  # fmt: skip
    """Return the best trial, or another that explains far more, if each has variances of its own residuals; None if it fails.

    Variances estimated without a mechanism are too large if it is missing. They may hide how much more the true one explains,
    and that a false one explains nothing that smaller variances would not leave.

    Parameters
    ----------
    found : the best trial as it was found; others that explain far less in the same way are no rivals
    retest_on_own : retest of a trial with variances of its own residuals; None if it does not hold

    """

    def is_rival(one: Trial) -> bool:
        alike = corrects_recordings(one.listed) == corrects_recordings(found.listed)
        return not alike or one.evidence >= (1.0 - FORM) ** 2 * found.evidence

    rivals = [one for one in others if is_rival(one)]
    own, *theirs = pool.map(equal.evidence, [best.trial, *rivals])
    if own < (1.0 - form_of(found.listed)) ** 2 * best.trial.evidence - equal.scatter:
        return None
    least = equal.scatter + max(best.trial.evidence, own)
    better = [(one, evidence) for one, evidence in zip(rivals, theirs, strict=True) if evidence > least]
    compared = [dataclasses.replace(best.trial, evidence=own), *(dataclasses.replace(one, evidence=e) for one, e in better)]
    for first in preferred(compared):
        if first is compared[0]:
            break
        retested = retest_on_own(next(one for one, _ in better if one.listed is first.listed))
        if retested is not None:
            return retested
    return best
