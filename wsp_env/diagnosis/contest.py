"""Which of the tried mechanisms holds, and is the best: from both sides, and beside its rivals."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from wsp_env.diagnosis.convergence import fits_worse
from wsp_env.diagnosis.retest import AboutItself, Retested
from wsp_env.diagnosis.side_by_side import side_by_side
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
    batches: Iterable[Sequence[Trial]], rejects: Callable[[Trial], bool], about: Callable[[Trial], AboutItself],
    retest_trial: Callable[[AboutItself], Retested | None], threshold: Callable[[Trial], float],
    first_round: bool = True,
) -> Contest:  # fmt: skip
    """Return the best trial of the first batch; in the first round, of the first batch in which one holds.

    Promising names are fitted to replicas of their own (`about`), where they may change places. In the order in which they fit
    there, they are tested from both sides (`retest_trial`): the log odds must exceed `threshold`, and `rejects` must be false.
    A name that explains less here than one that holds explains from both sides, and fits worse about itself by more than the
    scatter of sums of squares, is not tested. The same applies to terms that may replace the best name.
    """
    rejected: dict[str, float] = {}
    trials: list[Trial] = []
    for some in batches:
        last = {one.listed.title: one for one in some}
        held: list[Retested] = []
        marks: list[tuple[float, float]] = []  # evidence and sum of squares of what holds
        for kind in ([one for one in some if not one.listed.family], [one for one in some if one.listed.family]):
            promising = _promising(kind, some, threshold, held)
            tested = [one for one in promising if not rejects(one)]
            for one in sorted(side_by_side(about, tested), key=lambda one: one.step.fitted.cost):
                cost = one.step.fitted.cost
                worse = any(one.trial.evidence < most and fits_worse(cost, least) for most, least in marks)
                retested = None if worse else retest_trial(one)
                if retested is None:
                    continue
                last[one.trial.listed.title] = retested.trial
                odds = log_odds(retested.trial.listed, retested.trial.evidence)
                if odds > threshold(retested.trial) and not rejects(retested.trial):
                    held.append(retested)
                    marks.append((retested.trial.evidence, cost))
            hold = {one.trial.listed.title for one in held}
            for title in [one.listed.title for one in promising]:
                if title not in hold:
                    rejected[title] = log_odds(last[title].listed, last[title].evidence)
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
