"""Gram matrices by run: reductions by columns in runs to which they were not fitted, computed with small matrices."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.gls import Projector, fit

#: Smallest share of a column's square that must remain after projection for the column to be fitted.
_LEFT = 1e-6
_COMMON = -1


class Runs:
    """Gram matrices of common nuisances, candidates and residual by run, with the nuisances of single runs projected out.

    Parameters
    ----------
    y : (n,) residual, whitened
    candidates : columns (n, k) of each candidate
    nuisances : columns (n, p), scaled by the standard deviation of a prior if there is one; and (p,) bool, which have one
    cluster : (n,) int, the run of each row
    held_out : (n,) bool, rows of the validation runs

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
        # A prior is a pseudo-observation 0 +- 1: it belongs to no run and is never left out.
        self.prior = np.zeros((z.shape[1], z.shape[1]))
        np.fill_diagonal(self.prior[: self.p, : self.p], prior[common].astype(float))
        gram = []
        for r in range(len(names)):
            rows, mine = run == r, own == r
            # Equivalent to Projector.inner, whose sparse products are slow for dense columns.
            inner = z[rows].T @ Projector.of(columns[np.ix_(rows, mine)], prior[mine]).rest(z[rows])
            # Columns within the span of the run's own nuisances leave only rounding errors.
            spanned = np.diag(inner) < _LEFT * np.einsum("nk,nk->k", z[rows], z[rows])
            inner[spanned, :] = inner[:, spanned] = 0.0
            gram.append(inner)
        self.gram = np.array(gram)  # (R, K, K)
        self.tune = self.gram[~self.held].sum(axis=0) + self.prior

    def base(self, given: Sequence[int]) -> np.ndarray:
        """Return the indices of the common nuisances and of the columns of given candidates."""
        return np.concatenate([np.arange(self.p), *(self.parts[i] for i in given)]).astype(int)

    def left_held_out(self) -> float:
        """Sum of squares of the held-out runs with the nuisances as fitted to the tuning runs."""
        base = self.base([])
        it = Fitted.of(self.tune, base).amplitude
        held = self.gram[self.held].sum(axis=0)
        return float(held[-1, -1] - 2.0 * it @ held[base, -1] + it @ held[np.ix_(base, base)] @ it)

    def projector(self, given: Sequence[int]) -> Projector:
        """Return the projector off all nuisances and given candidates."""
        columns, prior = self.nuisances
        every = np.column_stack([columns, *(self.candidates[i] for i in given)])
        return Projector.of(every, np.concatenate([prior, np.zeros(every.shape[1] - len(prior), dtype=bool)]))

    def predicted(self, given: Sequence[int], free: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return the reduction of the sum of squares by each free candidate, beside the given ones, in runs not fitted.

        For each tuning run (J, R), predicted from the other tuning runs. For each held-out run (J, H), predicted from the
        tuning runs.
        """
        base, parts = self.base(given), [self.parts[i] for i in free]
        tune = [Fitted.of(self.tune - one, base).reductions(parts, one) for one in self.gram[~self.held]]
        whole = Fitted.of(self.tune, base)
        held = [whole.reductions(parts, one) for one in self.gram[self.held]]
        shape = (-1, len(free))
        return np.reshape(tune, shape).T, np.reshape(held, shape).T

    def together(self, given: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Fit common nuisances and given candidates to the tuning runs: amplitudes (b,) and covariance (b, b).

        The covariance is the cluster-robust sandwich from the scores of the runs (Liang and Zeger, 1986, Biometrika 73, 13).
        """
        base = self.base(given)
        one = fit(self.tune[np.ix_(base, base)], self.tune[base, -1])
        runs = self.gram[~self.held]
        scores = np.array([gram[base, -1] - gram[np.ix_(base, base)] @ one.amplitude for gram in runs])
        # R / (R - 1): the scatter of few runs about a fit to them is smaller than about the true value.
        meat = scores.T @ scores * (len(runs) / max(len(runs) - 1, 1))
        return one.amplitude, one.covariance @ meat @ one.covariance


def _own(columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return for each nuisance (p,) the only run that it concerns, or `_COMMON`."""
    result = np.full(columns.shape[1], _COMMON)
    for i, column in enumerate(columns.T):
        concerned = np.unique(run[column != 0.0])
        if len(concerned) == 1:
            result[i] = concerned[0]
    return result


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Given columns fitted to a training set, and their share in all other columns."""

    cross: np.ndarray  # (b, K) regression coefficients of all columns on the given ones
    amplitude: np.ndarray  # (b,) of the given columns
    base: np.ndarray  # (b,) indices of the given columns
    train: np.ndarray  # (K, K) Gram matrix of the training set, not projected

    @classmethod
    def of(cls, train: np.ndarray, base: np.ndarray) -> "Fitted":
        """Fit the given columns."""
        inverse = fit(train[np.ix_(base, base)], train[base, -1]).covariance
        return cls(inverse @ train[base, :-1], inverse @ train[base, -1], base, train)

    def freed(self, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Gram matrix of columns freed from the given ones, and their products with the residual."""
        rows = gram[self.base, :-1]
        mixed = rows.T @ self.cross
        inner = gram[np.ix_(self.base, self.base)]
        squares = gram[:-1, :-1] - mixed - mixed.T + self.cross.T @ inner @ self.cross
        rest = gram[:-1, -1] - rows.T @ self.amplitude
        return squares, rest - self.cross.T @ (gram[self.base, -1] - inner @ self.amplitude)

    def amplitudes(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return the amplitudes of each part, fitted alone beside the given columns."""
        freed, against = self.freed(self.train)
        squares = np.diag(self.train)
        return [fit(freed[np.ix_(i, i)], against[i], squares[i], _LEFT).amplitude for i in parts]

    def reductions(self, parts: Sequence[np.ndarray], gram: np.ndarray) -> np.ndarray:
        """Reduction (J,) of the sum of squares of other rows with Gram matrix `gram`, by each part as fitted in training."""
        test, against = self.freed(gram)
        fitted = zip(self.amplitudes(parts), parts, strict=True)
        return np.array([2.0 * a @ against[i] - a @ test[np.ix_(i, i)] @ a for a, i in fitted])
