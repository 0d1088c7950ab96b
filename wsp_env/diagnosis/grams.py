"""Gram matrices of runs: what columns explain in runs that they were not fitted to, by small matrices."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.gls import Projector, fit

#: Share of its square that a column must have left, off what is given, to be fitted.
_LEFT = 1e-6
_COMMON = -1


class Runs:
    """Gram matrices of common nuisances, candidates and residual in every run, off the nuisances of the run alone.

    Parameters
    ----------
    y : (n,) residual, whitened
    candidates : columns (n, k) each
    nuisances : columns (n, p), those with a prior scaled by its deviation, and which have one (p,) bool
    cluster : (n,) int, the run of each row
    held_out : (n,) bool, rows of the runs to validate on

    Raises
    ------
    ValueError : if a run is partly held out

    """

    def __init__(
        self,
        y: np.ndarray,
        candidates: Sequence[np.ndarray],
        nuisances: tuple[np.ndarray, np.ndarray],
        cluster: np.ndarray,
        held_out: np.ndarray,
    ) -> None:
        columns, prior = nuisances
        self.candidates, self.nuisances = candidates, nuisances
        names, run = np.unique(cluster, return_inverse=True)
        self.held = np.array([held_out[run == r].all() for r in range(len(names))])
        if any(held_out[run == r].any() != self.held[r] for r in range(len(names))):
            raise ValueError("a run is either held out or not: some rows of one are, others are not")
        own = _own(columns, run)
        common = own == _COMMON
        self.p = int(common.sum())
        ends = self.p + np.cumsum([one.shape[1] for one in candidates], dtype=int)
        self.parts = [np.arange(end - one.shape[1], end) for end, one in zip(ends, candidates, strict=True)]
        z = np.column_stack([columns[:, common], *candidates, y])
        # A prior is one more row that says 0 +- 1: it belongs to no run and is never left out.
        self.prior = np.zeros((z.shape[1], z.shape[1]))
        np.fill_diagonal(self.prior[: self.p, : self.p], prior[common].astype(float))
        gram = []
        for r in range(len(names)):
            rows, mine = run == r, own == r
            # The same as Projector.inner, whose sparse products are slow where nothing is sparse.
            inner = z[rows].T @ Projector(columns[np.ix_(rows, mine)], prior[mine]).rest(z[rows])
            # What the run's own nuisances span leaves rounding errors.
            spanned = np.diag(inner) < _LEFT * np.einsum("nk,nk->k", z[rows], z[rows])
            inner[spanned, :] = inner[:, spanned] = 0.0
            gram.append(inner)
        self.gram = np.array(gram)  # (R, K, K)
        self.tune = self.gram[~self.held].sum(axis=0) + self.prior

    def base(self, given: Sequence[int]) -> np.ndarray:
        """Return the indices of the common nuisances and of the columns of some candidates."""
        return np.concatenate([np.arange(self.p), *(self.parts[i] for i in given)]).astype(int)

    def left_held_out(self) -> float:
        """Sum of squares of the held-out runs that the nuisances, fitted to the runs to tune on, leave."""
        base = self.base([])
        it = Fitted.of(self.tune, base).amplitude
        held = self.gram[self.held].sum(axis=0)
        return float(held[-1, -1] - 2.0 * it @ held[base, -1] + it @ held[np.ix_(base, base)] @ it)

    def projector(self, given: Sequence[int]) -> Projector:
        """Return what takes away the part of all nuisances and of some candidates."""
        columns, prior = self.nuisances
        every = np.column_stack([columns, *(self.candidates[i] for i in given)])
        return Projector(every, np.concatenate([prior, np.zeros(every.shape[1] - len(prior), dtype=bool)]))

    def predicted(self, given: Sequence[int], free: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return how much each free candidate reduces the sum of squares, beside those given, in runs it was not fitted to.

        In each run to tune on (J, R), predicted from the others, and in each held out (J, H), predicted from those to tune on.
        """
        base, parts = self.base(given), [self.parts[i] for i in free]
        tune = [Fitted.of(self.tune - one, base).reductions(parts, one) for one in self.gram[~self.held]]
        whole = Fitted.of(self.tune, base)
        held = [whole.reductions(parts, one) for one in self.gram[self.held]]
        shape = (-1, len(free))
        return np.reshape(tune, shape).T, np.reshape(held, shape).T

    def together(self, given: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Fit common nuisances and candidates to the runs to tune on: amplitudes (b,) and covariance (b, b).

        The covariance comes from the scores of the runs: the sandwich of Liang and Zeger (1986), Biometrika 73, 13.
        """
        base = self.base(given)
        one = fit(self.tune[np.ix_(base, base)], self.tune[base, -1])
        runs = self.gram[~self.held]
        scores = np.array([gram[base, -1] - gram[np.ix_(base, base)] @ one.amplitude for gram in runs])
        # R / (R - 1): few runs scatter less about a fit to them than about the truth.
        meat = scores.T @ scores * (len(runs) / max(len(runs) - 1, 1))
        return one.amplitude, one.covariance @ meat @ one.covariance


def _own(columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return the one run (p,) that a nuisance concerns, or `_COMMON`."""
    result = np.full(columns.shape[1], _COMMON)
    for i, column in enumerate(columns.T):
        concerned = np.unique(run[column != 0.0])
        if len(concerned) == 1:
            result[i] = concerned[0]
    return result


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Given columns fitted to a training set, and what of them is in all others."""

    cross: np.ndarray  # (b, K) coefficients
    amplitude: np.ndarray  # (b,) of the given
    base: np.ndarray  # (b,)
    train: np.ndarray  # (K, K) Gram matrix, not freed

    @classmethod
    def of(cls, train: np.ndarray, base: np.ndarray) -> "Fitted":
        """Fit the given columns."""
        inverse = fit(train[np.ix_(base, base)], train[base, -1]).covariance
        return cls(inverse @ train[base, :-1], inverse @ train[base, -1], base, train)

    def freed(self, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gram matrix of the freed columns and their inner products with what the given leave of the residual."""
        rows = gram[self.base, :-1]
        mixed = rows.T @ self.cross
        inner = gram[np.ix_(self.base, self.base)]
        squares = gram[:-1, :-1] - mixed - mixed.T + self.cross.T @ inner @ self.cross
        rest = gram[:-1, -1] - rows.T @ self.amplitude
        return squares, rest - self.cross.T @ (gram[self.base, -1] - inner @ self.amplitude)

    def amplitudes(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Fit each part alone, beside the given columns."""
        freed, against = self.freed(self.train)
        squares = np.diag(self.train)
        return [fit(freed[np.ix_(i, i)], against[i], squares[i], _LEFT).amplitude for i in parts]

    def reductions(self, parts: Sequence[np.ndarray], gram: np.ndarray) -> np.ndarray:
        """Reduction (J,) of the sum of squares of rows with a Gram matrix by each part, fitted to the training set."""
        test, against = self.freed(gram)
        fitted = zip(self.amplitudes(parts), parts, strict=True)
        return np.array([2.0 * a @ against[i] - a @ test[np.ix_(i, i)] @ a for a, i in fitted])
