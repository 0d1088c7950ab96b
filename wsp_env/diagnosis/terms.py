"""Searches terms that explain a residual: greedy forward search, with selection and acceptance on different runs.

A term is one column or a group of columns. After projection off all nuisances and earlier terms, it is accepted only if
1. it significantly reduces the sum of squares of the tuning runs, each predicted from the others (leave one run out), and of
   the held-out runs, predicted from the tuning runs: the sum over runs exceeds zero by Student's one-sided quantile of its
   standard error over runs, and
2. its own effect, with all else refitted, is large enough to matter; the caller decides this.

Candidates are ranked by their reduction on the tuning runs. Of those that these runs cannot distinguish, the one with the
fewest parameters is taken, and the others are named as alternatives. The held-out runs test only this candidate in each step,
and the search stops at the first failure. Noise alone therefore passes at most with the probability of the level, however many
terms are tried. Rows of one run may depend on each other in any way; runs must be independent.

All computations use the runs' Gram matrices; only the size of an effect needs the rows.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import t as student

from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.grams import Fitted, Runs

#: One-sided significance level of a reduction: the usual 5 %.
LEVEL = 0.05


@dataclasses.dataclass(frozen=True)
class Term:
    """A candidate term."""

    name: str
    columns: np.ndarray  # (n, k) whitened as the residual is
    shape: int = 0  # number of shape parameters with several tried values: a place, a frequency, a threshold

    @property
    def parameters(self) -> int:
        """Number of amplitudes and shape parameters."""
        return self.columns.shape[1] + self.shape


@dataclasses.dataclass(frozen=True)
class Reduction:
    """Reduction of the sum of squares by a term, in runs to which it was not fitted."""

    total: float  # sum over runs
    error: float  # standard error of the total, from the scatter between runs
    runs: int

    def sure(self, level: float = LEVEL) -> bool:
        """Whether the total exceeds zero at a one-sided level; never with fewer than two runs."""
        return self.runs > 1 and self.total > student.ppf(1.0 - level, self.runs - 1) * self.error


@dataclasses.dataclass(frozen=True)
class Chosen:
    """A term that was accepted, or the one at which the search stopped."""

    term: Term
    amplitude: np.ndarray  # (k,) on the tuning runs, all accepted terms fitted together
    covariance: np.ndarray  # (k, k) of the amplitude, cluster-robust: from the scatter between runs
    reduction_tune: Reduction  # leave one run out
    reduction_held_out: Reduction
    removed: float  # share of the initial held-out sum of squares
    multiple: float  # effect, with all else refitted, as a multiple of the smallest that matters
    alternatives: tuple[str, ...] = ()  # names of terms that these runs cannot distinguish from it


@dataclasses.dataclass(frozen=True)
class Selection:
    """Result of a search."""

    chosen: tuple[Chosen, ...]
    refused: Chosen | None  # candidate at which it stopped; None if `most` were found or no candidate is left
    why: str  # reason for which it stopped


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
    nuisances : columns (n, p), whitened and scaled by the standard deviation of a prior if there is one; and (p,) bool, which
        have one. A nuisance of a single run is fitted in this run even when the run is predicted. One of several runs is
        predicted with the terms.
    cluster : (n,) int, the run of each row
    held_out : (n,) bool, rows of the validation runs; at least two runs, as for tuning
    least : size of an effect (n,) as a multiple of what matters; terms below 1 are skipped
    most : largest number of accepted terms

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
    """All terms that are not accepted yet, fitted beside the accepted ones."""

    data: Runs
    terms: Sequence[Term]
    free: Sequence[int]  # (J,) their indices in `terms`
    others: Projector  # projector off nuisances and accepted terms
    amplitudes: Sequence[np.ndarray]
    tune: np.ndarray  # (J, R) reductions by tuning run
    held: np.ndarray  # (J, H) reductions by held-out run
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
        """Fit all terms that are not `given`."""
        free = [i for i in range(len(terms)) if i not in given]
        amplitudes = Fitted.of(data.tune, data.base(given)).amplitudes([data.parts[i] for i in free])
        tune, held = data.predicted(given, free)
        return cls(data, terms, free, data.projector(given), amplitudes, tune, held, least, level)

    def best(self) -> int | None:
        """Return the candidate that the held-out runs are to test; None if none qualifies."""
        for j in np.argsort(-self.tune.sum(axis=1)):
            if self.sure(j, held=False) and self.least(self.effect(j)) >= 1.0:
                # Of the indistinguishable terms, take the one with the fewest parameters; the best comes first among equals.
                alike = [one for one in self.alike(j, held=False) if self.least(self.effect(one)) >= 1.0]
                return min([int(j), *alike], key=lambda i: self.terms[self.free[i]].parameters)
        return None

    def effect(self, j: int) -> np.ndarray:
        """Effect (n,) of a candidate, after refitting all else without it."""
        return self.others.rest(self.terms[self.free[j]].columns @ self.amplitudes[j])

    def sure(self, j: int, held: bool) -> bool:
        """Whether a candidate significantly improves the tuning runs and, with `held`, the held-out runs."""
        parts = (self.tune, self.held) if held else (self.tune,)
        return all(_reduction(part[j]).sure(self.level) for part in parts)

    def alike(self, j: int, held: bool) -> list[int]:
        """Return the candidates that cannot be distinguished from candidate j, without j.

        Either no part of the runs significantly prefers j, or the two effects differ by less than what matters.
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
        """Return the complete figures of a candidate."""
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
