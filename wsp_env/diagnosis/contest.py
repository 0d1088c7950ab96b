"""Which of the tried mechanisms holds, and is the best: from both sides, and beside its rivals."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from wsp_env.diagnosis.convergence import WORSE, fits_worse
from wsp_env.diagnosis.replica import OF_TIME
from wsp_env.diagnosis.retest import AboutItself, Retested, Side
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.trials import FORM, Trial, fades, hides_in_noise, log_odds

#: Largest ratio of the evidence from both sides to the evidence about the replica without it that is considered. What would
#: need more to be the best is not tested. Assumptions: of names, it was 0.7 to 3.9 in the campaigns of
#: docs/lab/diagnosis_both_sides.md; of terms, which are linear in their coefficient, up to 1.3 in those of
#: docs/lab/diagnosis_one_thing.md.
_MOST_GAINED, _MOST_GAINED_BY_TERM = 4.0, 2.0
#: Number of trials that are tested from both sides at a time; the answer does not depend on it.
_AT_A_TIME = 2


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
    make_here: Callable[[], Side], retest_trial: Callable[[Side, AboutItself], Retested | None],
    threshold: Callable[[Trial], float], first_round: bool = True,
) -> Contest:  # fmt: skip
    """Return the best trial of the first batch; in the first round, of the first batch in which one holds.

    Promising names are fitted to replicas of their own (`about`), where they may change places. In the order in which they fit
    there, they are tested from both sides (`retest_trial`): the log odds must exceed `threshold`, and `rejects` must be false.
    A name is not tested if it fits worse about itself than one that holds, by more than the scatter of sums of squares, and
    explains so little here that it can hardly explain as much from both sides. The same applies to terms that may replace the
    best name.
    """
    rejected: dict[str, float] = {}
    trials: list[Trial] = []
    sides: list[Side] = []
    for some in batches:
        last = {one.listed.title: one for one in some}
        held: list[tuple[Retested, AboutItself]] = []
        for kind in ([one for one in some if not one.listed.family], [one for one in some if one.listed.family]):
            promising = _promising(kind, some, threshold, _trials(held))
            tested = [one for one in promising if not rejects(one)]
            makes = [functools.partial(about, one) for one in tested]
            if tested and not sides:  # the side without any of them is made beside them
                *abouts, side = side_by_side(lambda make: make(), [*makes, make_here])
                sides.append(side)
            else:
                abouts = side_by_side(lambda make: make(), makes)
            left = sorted(abouts, key=lambda one: one.step.fitted.cost)
            while left := [one for one in left if not _is_hopeless(one, _trials(held))]:
                number = _at_once(left)
                now, left = left[:number], left[number:]
                for one, retested in zip(now, side_by_side(functools.partial(retest_trial, sides[0]), now), strict=True):
                    if retested is None or _is_hopeless(one, _trials(held)):  # beside what has just held
                        continue
                    last[one.trial.listed.title] = retested.trial
                    odds = log_odds(retested.trial.listed, retested.trial.evidence)
                    if odds > threshold(retested.trial) and not rejects(retested.trial):
                        held.append((retested, one))
            hold = {one.trial.listed.title for one, _ in held}
            for title in [one.listed.title for one in promising]:
                if title not in hold:
                    rejected[title] = log_odds(last[title].listed, last[title].evidence)
        if held:
            best, *others = _compared([one for one, _ in held])
            return Contest(
                best, rejected, trials + list((last | {one.trial.listed.title: one.trial for one in others}).values())
            )
        trials += last.values()
        if not first_round:
            break
    return Contest(None, rejected, trials)


def _most_gained(one: Trial) -> float:
    return _MOST_GAINED_BY_TERM if one.listed.family else _MOST_GAINED


def _is_hopeless(one: AboutItself, held: Sequence[tuple[Trial, AboutItself]]) -> bool:
    """Whether a trial explains too little here to be the best, as it fits about itself.

    Of those that hold: the trial, and what it was about itself. A name must fit worse than such a one; if it explains more
    here, it is not hopeless: it may gain as much. A term must fit distinctly better, or explain more than the form of a name
    may lose.
    """
    most, family = _most_gained(one.trial) * one.trial.evidence, bool(one.trial.listed.family)

    def behind(other: Trial, about: AboutItself) -> bool:
        mine, its, rows = one.step.fitted.cost, about.step.fitted.cost, len(one.step.replica.rows)
        if family:
            form = 1.0 if other.listed.family else (1.0 - FORM) ** 2
            return form * most < other.evidence and not fits_worse(its, mine, rows)
        return most < other.evidence and one.trial.evidence < about.trial.evidence and fits_worse(mine, its, rows)

    return any(behind(other, about) for other, about in held)


def _trials(held: Sequence[tuple[Retested, AboutItself]]) -> list[tuple[Trial, AboutItself]]:
    return [(one.trial, about) for one, about in held]


def _at_once(left: Sequence[AboutItself]) -> int:
    """Return how many trials to test beside each other: those that need be tested even if the first holds as it does here."""
    holds = [(left[0].trial, left[0])]
    return 1 + sum(1 for _ in itertools.takewhile(lambda one: not _is_hopeless(one, holds), left[1:_AT_A_TIME]))


def _behind_what_fits(held: Sequence[Retested]) -> list[Retested]:
    """Return what holds, with less evidence for what fits distinctly worse about itself than the best.

    What another inertia or a wrong sensor leaves looks like noise, of which no other replica knows: beside it, the mechanism
    explains little. The worse of the two then has less evidence than the better, by half of the difference of their deviances.
    Sums of squares with the same weights would not do: where a clock is put right, other wheels slide.
    """
    best = min(held, key=lambda one: one.deviance)

    def behind(one: Retested) -> Retested:
        more = one.deviance - best.deviance
        evidence = min(one.trial.evidence, best.trial.evidence - 0.5 * more)
        return one if more <= WORSE * one.scatter else _with_evidence(one, evidence)

    return [behind(one) for one in held]


def _with_evidence(one: Retested, evidence: float) -> Retested:
    return one._replace(trial=dataclasses.replace(one.trial, evidence=evidence))


def _compared(held: Sequence[Retested]) -> list[Retested]:
    """Return what holds, best first.

    Evidence is told against the model without the mechanism. A name with less of it that fits better about itself is compared
    directly: the worse of the two then has so much less evidence than the better.
    """
    held = _behind_what_fits(held)
    first, *others = [next(one for one in held if one.trial is trial) for trial in preferred([one.trial for one in held])]
    after: list[Retested] = []
    for one in others:
        if first.trial.listed.family or one.trial.listed.family or one.deviance >= first.deviance:
            after.append(one)
            continue
        more = one.exceeds(first)
        better, worse = (one, first) if more > 0.0 else (first, one)
        after.append(_with_evidence(worse, min(worse.trial.evidence, better.trial.evidence - abs(more))))
        first = better
    return [first, *after]


def _promising(
    some: Sequence[Trial], among: Sequence[Trial], threshold: Callable[[Trial], float],
    held: Sequence[tuple[Trial, AboutItself]],
) -> list[Trial]:  # fmt: skip
    """Return those of `some` that may hold and be the best of all, beside what holds.

    A name that explains little here, because it is nonlinear or hidden by nuisances, may explain most about its own replica.
    Delays are the least linear effects: the true one may explain far less here than a false one. Another inertia hides in the
    noise. A term that explains more here than every name that holds may also fit better about itself.
    """
    least = max((one.evidence for one in among), default=0.0)
    least = max([least, *(one.evidence / (1.0 - FORM) ** 2 for one, _ in held)])
    here = max((about.trial.evidence for _, about in held), default=math.inf)

    def may_hold(one: Trial) -> bool:
        if not one.listed.family and log_odds(one.listed, one.found.evidence) > 0.0:
            return True
        if (hides_in_noise(one.found) or fades(one.found)) and not held:
            return True
        may_be_best = _most_gained(one) * one.evidence > least or one.evidence > here or one.listed.name in OF_TIME
        return log_odds(one.listed, one.evidence) > threshold(one) and may_be_best

    return [one for one in some if may_hold(one)]
