"""Generalised least squares with nuisances that have a prior: projection, reductions of chi-square, estimates.

Rows are whitened. A nuisance with prior standard deviation d is a column scaled by d plus one pseudo-observation 0 +- 1. A
nuisance without a prior is free. After projection off the nuisances, fits of any set of columns need only small matrices. The
reduction of chi-square is the decrease of the sum of squares, in the prior's metric, at the best amplitudes of the set.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, Eliminated, Order, rows_of

_NOTHING = 1e-11  # share of a nuisance column's largest square below which a direction carries no information


class Projector:
    """Projects whitened rows off nuisances. Most nuisances concern one run only; the equations are solved run by run.

    Parameters
    ----------
    columns : (n, p) whitened; those with a prior are scaled by its standard deviation
    prior : (p,) bool, columns with a prior
    run : (n,) int, the run of each row; used if many columns concern one run only

    """

    def __init__(self, columns: np.ndarray, prior: np.ndarray, run: np.ndarray | None = None) -> None:
        self._columns, self._prior = columns, prior
        run = np.zeros(len(columns), dtype=int) if run is None else run
        self._unit = np.ones(len(prior))
        if not prior.all():  # a free direction gets a prior so wide that it carries almost no information
            least = _NOTHING * max(float(np.einsum("np,np->p", columns, columns).max(initial=0.0)), 1.0)
            self._unit[~prior] = least**-0.5
        self._order = Order.of(columns, run, 0)
        scaled = columns if prior.all() else columns * self._unit
        parts = zip(rows_of(run), self._order.own, strict=True)
        self._parts = [Part.of(scaled, rows, mine, self._order) for rows, mine in parts]
        common = len(self._order.common)
        own, cross, across = [], [], np.zeros((common, common))
        for part in self._parts:
            own.append(part.own.T @ part.own)
            cross.append(np.zeros((part.own.shape[1], common)))
            cross[-1][:, part.used] = part.own.T @ part.shared
            if len(part.used) == common:
                across += part.shared.T @ part.shared
            else:
                across[np.ix_(part.used, part.used)] += part.shared.T @ part.shared
        self._solved = Eliminated(Arrow(tuple(own), tuple(cross), across), common)

    @property
    def logdet(self) -> float:
        """Log determinant of the rows' covariance from white noise of deviation 1 and nuisances that all have a prior."""
        return self._solved.logdet

    def _half(self, y: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return L^-1 Z' Y, with the root L of the normal matrix, the nuisances Z and rows Y (n, k)."""
        common = np.zeros((len(self._order.common), y.shape[1]))
        for part in self._parts:
            common[part.used] += part.shared.T @ y[part.rows]
        return self._solved.half([part.own.T @ y[part.rows] for part in self._parts], common)

    def inner(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Inner products (k, l) of columns (n, k) and (n, l) after projection."""
        own, common = self._half(a)
        others, other = (own, common) if b is a else self._half(b)
        result: np.ndarray = a.T @ b - common.T @ other
        for left, right in zip(own, others, strict=True):
            result -= left.T @ right
        return result

    def rest(self, y: np.ndarray) -> np.ndarray:
        """Residuals of rows (n,) or (n, k) after subtraction of the best-fitting nuisances."""
        result: np.ndarray = y - self._columns @ self.amplitudes(y)
        return result

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (p,) or (p, k) of the nuisances; with a prior, in units of its standard deviation."""
        own, common = self._solved.back(*self._half(y.reshape(len(y), -1)))
        result = np.empty((len(self._prior), common.shape[1]))
        for mine, one in zip((*self._order.own, self._order.common), (*own, common), strict=True):
            result[mine] = one * self._unit[mine, None]
        return result.reshape(-1, *y.shape[1:])


class Part(NamedTuple):
    """The columns in the rows of one run."""

    rows: slice | np.ndarray  # (m,) indices
    own: np.ndarray  # (m, k) columns of this run only
    used: np.ndarray  # (u,) indices into the common columns that are not zero here
    shared: np.ndarray  # (m, u)

    @classmethod
    def of(cls, columns: np.ndarray, rows: slice | np.ndarray, own: np.ndarray, order: Order) -> "Part":
        """Extract a run's part from columns (n, p): its `own` columns and the common ones."""
        mine = columns[rows]
        shared = mine[:, order.common]
        used = np.flatnonzero(shared.any(axis=0))
        return cls(rows, mine[:, own], used, shared if len(used) == shared.shape[1] else shared[:, used])


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """Fitted amplitudes of some columns, and their reduction of chi-square."""

    reduction: float  # decrease of chi-square, the sum of squares
    amplitude: np.ndarray  # (k,)
    covariance: np.ndarray  # (k, k) for rows with standard deviation 1


def fit(gram: np.ndarray, against: np.ndarray, squares: np.ndarray | None = None, least: float = 1e-9) -> LeastSquares:
    """Fit columns with Gram matrix (k, k) to rows; `against` (k,) holds the inner products of the columns with the rows.

    Parameters
    ----------
    squares : (k,) squares of the columns before projection; default: the diagonal of `gram`
    least : smallest share of these squares at which a direction is fitted

    """
    squares = np.diag(gram) if squares is None else squares
    scale = np.sqrt(np.maximum(squares, np.finfo(float).tiny ** 0.5))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    kept = values > least
    half = (vectors[:, kept] / np.sqrt(values[kept])) / scale[:, None]
    half[squares <= 0.0] = 0.0  # a zero column gives only rounding errors
    inverse = half @ half.T
    amplitude = inverse @ against
    return LeastSquares(float(against @ amplitude), amplitude, inverse)
