"""Which of the tried mechanisms holds, and is the best: from both sides, and beside its rivals."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

from wsp_env.diagnosis.retest import Retested
from wsp_env.diagnosis.trials import FORM, Trial, log_odds

#: Largest ratio of the evidence from both sides to the evidence about the replica without it that is considered (assumption:
#: 0.7 to 3.9 in the campaigns of docs/lab/diagnosis_both_sides.md). What would need more to be the best is not tested.
_MOST_GAINED = 4.0


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
    trials: list[Trial]  # with their evidence from both sides, if they were tested


def best_of(
    batches: Iterable[Sequence[Trial]], rejects: Callable[[Trial], bool], retest_trial: Callable[[Trial], Retested | None],
    threshold: Callable[[Trial], float], pool: Executor, first_round: bool = True,
) -> Contest:  # fmt: skip
    """Return the best trial of the first batch; in the first round, of the first batch in which one holds.

    All promising names are tested from both sides (`retest_trial`), where they may change places, then those terms that may
    replace the best name. There, the log odds must exceed `threshold`, and `rejects` must be false.
    """
    rejected: dict[str, float] = {}
    trials: list[Trial] = []
    for some in batches:
        last = {one.listed.title: one for one in some}
        held: list[Retested] = []
        names = [one for one in some if not one.listed.family]
        for kind in (names, [one for one in some if one.listed.family]):
            promising = _promising(kind, some, threshold, held)
            tested = pool.map(lambda one: None if rejects(one) else retest_trial(one), promising)
            for one, retested in zip(promising, tested, strict=True):
                title = one.listed.title
                if retested is not None:
                    last[title] = retested.trial
                odds = log_odds(one.listed, last[title].evidence)
                if retested is not None and odds > threshold(retested.trial) and not rejects(retested.trial):
                    held.append(retested)
                else:
                    rejected[title] = odds
        trials += last.values()
        if held:
            first = preferred([one.trial for one in held])[0]
            return Contest(next(one for one in held if one.trial is first), rejected, trials)
        if not first_round:
            break
    return Contest(None, rejected, trials)


def _promising(
    some: Sequence[Trial], among: Sequence[Trial], threshold: Callable[[Trial], float], held: Sequence[Retested]
) -> list[Trial]:
    """Return those of `some` that may hold and be the best of all, beside what holds.

    A name that explains little here, because it is nonlinear or hidden by nuisances, may explain most about its own replica.
    """
    least = max((one.evidence for one in among), default=0.0)
    least = max([least, *(one.trial.evidence / (1.0 - FORM) ** 2 for one in held)]) / _MOST_GAINED

    def may_hold(one: Trial) -> bool:
        if not one.listed.family and log_odds(one.listed, one.found.evidence) > 0.0:
            return True
        return log_odds(one.listed, one.evidence) > threshold(one) and one.evidence > least

    return [one for one in some if may_hold(one)]
