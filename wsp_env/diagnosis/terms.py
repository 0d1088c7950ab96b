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

from wsp_env.diagnosis.gls import Projector, fit

#: Share of its square that a column must have left, off what is given, to be a term.
_LEFT = 1e-6
#: One-sided level at which a reduction counts as one: the usual 5 %.
LEVEL = 0.05
_ROW_OF_OWN = -1


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
    data = _Runs(y, terms, nuisances, cluster, held_out)
    chosen: list[Chosen] = []
    given: list[int] = []
    refused, why = None, f"{most} terms were found"
    while len(chosen) < most:
        candidate, why = _next(data, given, least, level)
        if candidate is None or why:
            refused = candidate
            break
        given.append(next(i for i, one in enumerate(terms) if one is candidate.term))
        chosen.append(candidate)
    return Selection(_together(data, given, chosen), refused, why)


class _Runs:
    """Gram matrices of the common nuisances, all terms and the residual in every run, off what concerns the run alone."""

    def __init__(
        self,
        y: np.ndarray,
        terms: Sequence[Term],
        nuisances: tuple[np.ndarray, np.ndarray],
        cluster: np.ndarray,
        held_out: np.ndarray,
    ) -> None:
        columns, prior = nuisances
        self.y, self.terms, self.nuisances = y, terms, nuisances
        names, run = np.unique(cluster, return_inverse=True)
        self.held = np.array([held_out[run == r].all() for r in range(len(names))])
        if any(held_out[run == r].any() != self.held[r] for r in range(len(names))):
            raise ValueError("a run is either held out or not: some rows of one are, others are not")
        own = _own(columns, run)
        common = own == _ROW_OF_OWN
        self.p = int(common.sum())
        ends = self.p + np.cumsum([one.columns.shape[1] for one in terms], dtype=int)
        self.parts = [np.arange(end - one.columns.shape[1], end) for end, one in zip(ends, terms, strict=True)]
        z = np.column_stack([columns[:, common], *(one.columns for one in terms), y])
        # A prior is one more row that says 0 +- 1: it belongs to no run and is never left out.
        self.prior = np.zeros((z.shape[1], z.shape[1]))
        np.fill_diagonal(self.prior[: self.p, : self.p], prior[common].astype(float))
        gram = []
        for r in range(len(names)):
            rows, mine = run == r, own == r
            # The same as Projector.inner, whose sparse products are slow where nothing is sparse.
            gram.append(z[rows].T @ Projector(columns[np.ix_(rows, mine)], prior[mine]).rest(z[rows]))
        self.gram = np.array(gram)  # (R, K, K)
        self.tune = self.gram[~self.held].sum(axis=0) + self.prior

    def base(self, given: Sequence[int]) -> np.ndarray:
        """Return the indices of the common nuisances and of the columns of the terms accepted so far."""
        return np.concatenate([np.arange(self.p), *(self.parts[i] for i in given)]).astype(int)

    def left_held_out(self) -> float:
        """Sum of squares of the held-out runs that the nuisances, fitted to the runs to tune on, leave."""
        base = self.base([])
        it = _Freed.of(self.tune, base).amplitude
        held = self.gram[self.held].sum(axis=0)
        return float(held[-1, -1] - 2.0 * it @ held[base, -1] + it @ held[np.ix_(base, base)] @ it)

    def size(self, which: int, amplitude: np.ndarray, given: Sequence[int]) -> np.ndarray:
        """Effect (n,) of a term with everything else re-tuned without it."""
        columns, prior = self.nuisances
        others = np.column_stack([columns, *(self.terms[i].columns for i in given)])
        flags = np.concatenate([prior, np.zeros(others.shape[1] - len(prior), dtype=bool)])
        return Projector(others, flags).rest(self.terms[which].columns @ amplitude)


def _own(columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return the one run (p,) that a nuisance concerns, or -1."""
    result = np.full(columns.shape[1], _ROW_OF_OWN)
    for i, column in enumerate(columns.T):
        concerned = np.unique(run[column != 0.0])
        if len(concerned) == 1:
            result[i] = concerned[0]
    return result


@dataclasses.dataclass(frozen=True)
class _Freed:
    """All columns off the given ones, coefficients of a training set."""

    cross: np.ndarray  # (b, K) what of the given is in every column
    amplitude: np.ndarray  # (b,) of the given
    base: np.ndarray  # (b,)
    train: np.ndarray  # (K, K) Gram matrix, not freed

    @classmethod
    def of(cls, train: np.ndarray, base: np.ndarray) -> "_Freed":
        """Fit the given columns."""
        inverse = fit(train[np.ix_(base, base)], train[base, -1]).covariance
        return cls(inverse @ train[base, :-1], inverse @ train[base, -1], base, train)

    def apply(self, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gram matrix of the freed columns and their inner products with what the given leave of the residual."""
        rows = gram[self.base, :-1]
        mixed = rows.T @ self.cross
        inner = gram[self.base][:, self.base]
        freed = gram[:-1, :-1] - mixed - mixed.T + self.cross.T @ inner @ self.cross
        rest = gram[:-1, -1] - rows.T @ self.amplitude
        return freed, rest - self.cross.T @ (gram[self.base, -1] - inner @ self.amplitude)

    def amplitudes(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Fit each part alone, beside the given columns."""
        freed, against = self.apply(self.train)
        squares = np.diag(self.train)
        return [fit(freed[np.ix_(i, i)], against[i], squares[i], _LEFT).amplitude for i in parts]


def _reductions(freed: _Freed, parts: Sequence[np.ndarray], gram: np.ndarray) -> np.ndarray:
    """Reduction (J,) of the sum of squares of rows with a Gram matrix by each part, fitted to the training set."""
    test, against = freed.apply(gram)
    amplitudes = freed.amplitudes(parts)
    return np.array([2.0 * a @ against[i] - a @ test[np.ix_(i, i)] @ a for a, i in zip(amplitudes, parts, strict=True)])


def _predicted(data: _Runs, given: Sequence[int], parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Reductions of all parts in each run to tune on (J, R), predicted from the others, and in each held out (J, H)."""
    base = data.base(given)
    tune = [_reductions(_Freed.of(data.tune - one, base), parts, one) for one in data.gram[~data.held]]
    whole = _Freed.of(data.tune, base)
    held = [_reductions(whole, parts, one) for one in data.gram[data.held]]
    empty = np.zeros((len(parts), 0))
    return np.array(tune).T if tune else empty, np.array(held).T if held else empty


def _reduction(by_run: np.ndarray) -> Reduction:
    runs = len(by_run)
    error = float(np.sqrt(runs) * by_run.std(ddof=1)) if runs > 1 else np.inf
    return Reduction(float(by_run.sum()), error, runs)


@dataclasses.dataclass(frozen=True)
class _Candidates:
    """All terms that are not accepted yet, beside those that are."""

    data: _Runs
    given: Sequence[int]
    free: Sequence[int]  # (J,) which terms
    amplitudes: Sequence[np.ndarray]
    tune: np.ndarray  # (J, R) reductions by run
    held: np.ndarray  # (J, H)
    least: Callable[[np.ndarray], float]
    level: float

    @classmethod
    def of(cls, data: _Runs, given: Sequence[int], least: Callable[[np.ndarray], float], level: float) -> "_Candidates":
        """Fit all."""
        free = [i for i in range(len(data.terms)) if i not in given]
        parts = [data.parts[i] for i in free]
        amplitudes = _Freed.of(data.tune, data.base(given)).amplitudes(parts)
        return cls(data, given, free, amplitudes, *_predicted(data, given, parts), least, level)

    def effect(self, j: int) -> np.ndarray:
        """Effect (n,) of a candidate, all else re-tuned."""
        return self.data.size(self.free[j], self.amplitudes[j], self.given)

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
            self.data.terms[self.free[j]],
            self.amplitudes[j],
            np.full((k, k), np.nan),
            _reduction(self.tune[j]),
            on_held,
            on_held.total / left if left > 0.0 else 0.0,
            self.least(self.effect(j)),
            tuple(self.data.terms[self.free[i]].name for i in self.alike(j, held=True)),
        )


def _next(data: _Runs, given: Sequence[int], least: Callable[[np.ndarray], float], level: float) -> tuple[Chosen | None, str]:
    """Return the best candidate and, if it is refused, why."""
    some = _Candidates.of(data, given, least, level)
    for j in np.argsort(-some.tune.sum(axis=1)):
        if some.sure(j, held=False) and least(some.effect(j)) >= 1.0:
            # Of terms that the runs to tune on cannot tell apart, the plainest; the best comes first of equals.
            alike = [one for one in some.alike(j, held=False) if least(some.effect(one)) >= 1.0]
            plainest = min([int(j), *alike], key=lambda i: data.terms[some.free[i]].parameters)
            passed = _reduction(some.held[plainest]).sure(level)
            return some.chosen(plainest), "" if passed else "the best candidate does not improve the held-out runs for sure"
    return None, "no candidate that matters improves the runs to tune on for sure"


def _together(data: _Runs, given: Sequence[int], chosen: Sequence[Chosen]) -> tuple[Chosen, ...]:
    """Fit all accepted terms together; their covariance from the scores of the runs (the sandwich of White and Liang-Zeger)."""
    base = data.base(given)
    one = fit(data.tune[np.ix_(base, base)], data.tune[base, -1])
    runs = data.gram[~data.held]
    scores = np.array([gram[base, -1] - gram[np.ix_(base, base)] @ one.amplitude for gram in runs])
    # R / (R - 1): few runs scatter less about a fit than they do.
    meat = scores.T @ scores * (len(runs) / max(len(runs) - 1, 1))
    covariance = one.covariance @ meat @ one.covariance
    result, start = [], data.p
    for it in chosen:
        part = slice(start, start := start + it.term.columns.shape[1])
        result.append(dataclasses.replace(it, amplitude=one.amplitude[part], covariance=covariance[part, part]))
    return tuple(result)
