"""Searches the terms that explain a residual: greedily, chosen on some runs, accepted on others, errors taken from runs.

A term is one column or a group of columns. It is accepted only if, off all nuisances and all terms before it,

1. it reduces the sum of squares of the runs to tune on, each predicted from the others (leave one run out), and of the
   held-out runs, predicted from those to tune on, both surely: the sum over runs exceeds zero by Student's one-sided
   quantile of its standard error over runs, and
2. its own effect, all else re-tuned, is large enough to matter, which the caller decides.

The candidates are ranked by what they explain on the runs to tune on; of those that these runs cannot tell apart the
plainest is taken, that with the fewest parameters, and the others are named as alternatives. The held-out runs are asked
one question a step, about this one candidate, and the search stops at the first no: however many terms are tried, noise
alone passes at most as often as the level says. Rows of one run may depend on each other in any way; runs may not.

Everything is done with the runs' Gram matrices: no step but the size of an effect touches the rows.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import t as student

from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.grams import Fitted, Runs

#: One-sided level at which a reduction counts as one: the usual 5 %.
LEVEL = 0.05


@dataclasses.dataclass(frozen=True)
class Term:
    """A candidate."""

    name: str
    columns: np.ndarray  # (n, k) whitened as the residual is
    shape: int = 0  # parameters of its form that the caller tried several values of: a place, a frequency, a threshold

    @property
    def parameters(self) -> int:
        """Amplitudes and parameters of its form."""
        return self.columns.shape[1] + self.shape


@dataclasses.dataclass(frozen=True)
class Reduction:
    """By how much a term reduces the sum of squares of runs that it was not fitted to."""

    total: float  # sum over runs
    error: float  # its standard error, from the scatter between runs
    runs: int

    def sure(self, level: float = LEVEL) -> bool:
        """Whether it is above zero at a one-sided level; never with fewer than two runs."""
        return self.runs > 1 and self.total > student.ppf(1.0 - level, self.runs - 1) * self.error


@dataclasses.dataclass(frozen=True)
class Chosen:
    """A term that was accepted, or the one at which the search stopped."""

    term: Term
    amplitude: np.ndarray  # (k,) on the runs to tune on, all terms accepted in the end fitted together
    covariance: np.ndarray  # (k, k) of it, cluster-robust: from the scatter between runs
    reduction_tune: Reduction  # leaving one run out
    reduction_held_out: Reduction
    removed: float  # share of the held-out sum of squares that there was before any term
    multiple: float  # its effect, all else re-tuned, in multiples of what matters
    alternatives: tuple[str, ...] = ()  # names of terms that these runs cannot tell from it


@dataclasses.dataclass(frozen=True)
class Selection:
    """What a search found."""

    chosen: tuple[Chosen, ...]
    refused: Chosen | None  # the candidate it stopped at; none if `most` were found or none is left
    why: str  # it stopped


def search(
    y: np.ndarray,
    terms: Sequence[Term],
    nuisances: tuple[np.ndarray, np.ndarray],
    cluster: np.ndarray,
    held_out: np.ndarray,
    least: Callable[[np.ndarray], float] = lambda effect: np.inf,
    most: int = 3,
    level: float = LEVEL,
) -> Selection:
    """Search the terms that explain a residual.

    Parameters
    ----------
    y : (n,) residual, whitened
    nuisances : columns (n, p), whitened, those with a prior scaled by its deviation, and which have one (p,) bool.
        One that concerns a single run is fitted in that run also where the run is predicted; one of several runs is predicted
        along with the terms.
    cluster : (n,) int, the run of each row
    held_out : (n,) bool, rows of the runs to validate on; at least two runs, as to tune on
    least : size of an effect (n,) in multiples of what matters; below one a term is passed over
    most : terms to accept at most

    Raises
    ------
    ValueError : if a run is partly held out

    """
    data = Runs(y, [one.columns for one in terms], nuisances, cluster, held_out)
    chosen: list[Chosen] = []
    given: list[int] = []
    refused, why = None, f"{most} terms were found"
    while len(chosen) < most:
        some = _Candidates.of(data, terms, given, least, level)
        best = some.best()
        if best is None:
            why = "no candidate that matters improves the runs to tune on for sure"
            break
        candidate = some.chosen(best)
        if not candidate.reduction_held_out.sure(level):
            refused, why = candidate, "the best candidate does not improve the held-out runs for sure"
            break
        given.append(some.free[best])
        chosen.append(candidate)
    amplitude, covariance = data.together(given)
    result, start = [], data.p
    for one in chosen:
        part = slice(start, start := start + one.term.columns.shape[1])
        result.append(dataclasses.replace(one, amplitude=amplitude[part], covariance=covariance[part, part]))
    return Selection(tuple(result), refused, why)


def _reduction(by_run: np.ndarray) -> Reduction:
    runs = len(by_run)
    error = float(np.sqrt(runs) * by_run.std(ddof=1)) if runs > 1 else np.inf
    return Reduction(float(by_run.sum()), error, runs)


@dataclasses.dataclass(frozen=True)
class _Candidates:
    """All terms that are not accepted yet, beside those that are."""

    data: Runs
    terms: Sequence[Term]
    free: Sequence[int]  # (J,) which terms
    others: Projector  # off nuisances and accepted terms
    amplitudes: Sequence[np.ndarray]
    tune: np.ndarray  # (J, R) reductions by run
    held: np.ndarray  # (J, H)
    least: Callable[[np.ndarray], float]
    level: float

    @classmethod
    def of(
        cls,
        data: Runs,
        terms: Sequence[Term],
        given: Sequence[int],
        least: Callable[[np.ndarray], float],
        level: float,
    ) -> "_Candidates":
        """Fit all."""
        free = [i for i in range(len(terms)) if i not in given]
        amplitudes = Fitted.of(data.tune, data.base(given)).amplitudes([data.parts[i] for i in free])
        tune, held = data.predicted(given, free)
        return cls(data, terms, free, data.projector(given), amplitudes, tune, held, least, level)

    def best(self) -> int | None:
        """Return the candidate to ask the held-out runs about."""
        for j in np.argsort(-self.tune.sum(axis=1)):
            if self.sure(j, held=False) and self.least(self.effect(j)) >= 1.0:
                # Of terms that the runs to tune on cannot tell apart, the plainest; the best comes first of equals.
                alike = [one for one in self.alike(j, held=False) if self.least(self.effect(one)) >= 1.0]
                return min([int(j), *alike], key=lambda i: self.terms[self.free[i]].parameters)
        return None

    def effect(self, j: int) -> np.ndarray:
        """Effect (n,) of a candidate, all else re-tuned without it."""
        return self.others.rest(self.terms[self.free[j]].columns @ self.amplitudes[j])

    def sure(self, j: int, held: bool) -> bool:
        """Whether a candidate improves the runs to tune on and, if asked for, the held-out ones."""
        parts = (self.tune, self.held) if held else (self.tune,)
        return all(_reduction(part[j]).sure(self.level) for part in parts)

    def alike(self, j: int, held: bool) -> list[int]:
        """Return the candidates that cannot be told from one, that one excluded.

        Either no part of the runs prefers the one for sure, or the effects of both differ by less than what matters.
        """
        parts, effect, result = (self.tune, self.held) if held else (self.tune,), self.effect(j), []
        for i in np.argsort(-self.tune.sum(axis=1)):
            if i == j or not self.sure(i, held):
                continue
            preferred = any(_reduction(part[j] - part[i]).sure(self.level) for part in parts)
            if not preferred or self.least(effect - self.effect(i)) < 1.0:
                result.append(int(i))
        return result

    def chosen(self, j: int) -> Chosen:
        """Return all figures of a candidate."""
        on_held, left, k = _reduction(self.held[j]), self.data.left_held_out(), len(self.amplitudes[j])
        return Chosen(
            self.terms[self.free[j]],
            self.amplitudes[j],
            np.full((k, k), np.nan),
            _reduction(self.tune[j]),
            on_held,
            on_held.total / left if left > 0.0 else 0.0,
            self.least(self.effect(j)),
            tuple(self.terms[self.free[i]].name for i in self.alike(j, held=True)),
        )
