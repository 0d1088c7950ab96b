"""Generalised least squares with nuisances that carry a prior: projection, reductions of chi-square, estimates.

Rows are whitened. A nuisance with a prior deviation d is a column scaled by d with one more row that says 0 +- 1; one without
is free. Projecting everything off the nuisances makes what any set of columns explains a matter of small
matrices: the reduction of chi-square, the sum of squares in the prior's metric, that the best amplitudes of the set give.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, Eliminated, Order, rows_of

_NOTHING = 1e-11  # of the largest square of a nuisance's column, below which a direction says nothing


class Projector:
    """Projects whitened rows off nuisances, most of which concern one run: they are solved run by run.

    Parameters
    ----------
    columns : (n, p) whitened, those with a prior scaled by its deviation
    prior : (p,) bool, which have one
    run : (n,) int of each row, where many columns concern one run alone

    """

    def __init__(self, columns: np.ndarray, prior: np.ndarray, run: np.ndarray | None = None) -> None:
        self._columns, self._prior = columns, prior
        run = np.zeros(len(columns), dtype=int) if run is None else run
        self._unit = np.ones(len(prior))
        if not prior.all():  # a free direction is one whose prior says next to nothing
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
        """Log of the determinant of the rows' covariance by nuisances that all have a prior and white noise of deviation 1."""
        return self._solved.logdet

    def _half(self, y: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the inverse root of the normal matrix times the inner products of the nuisances with rows (n, k)."""
        common = np.zeros((len(self._order.common), y.shape[1]))
        for part in self._parts:
            common[part.used] += part.shared.T @ y[part.rows]
        return self._solved.half([part.own.T @ y[part.rows] for part in self._parts], common)

    def inner(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Inner products (k, l) of columns (n, k) and (n, l), projected."""
        own, common = self._half(a)
        others, other = (own, common) if b is a else self._half(b)
        result: np.ndarray = a.T @ b - common.T @ other
        for left, right in zip(own, others, strict=True):
            result -= left.T @ right
        return result

    def rest(self, y: np.ndarray) -> np.ndarray:
        """Rows (n,) or (n, k) with the nuisances' best part taken away."""
        result: np.ndarray = y - self._columns @ self.amplitudes(y)
        return result

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (p,) or (p, k) of the nuisances, in units of their prior where they have one."""
        own, common = self._solved.back(*self._half(y.reshape(len(y), -1)))
        result = np.empty((len(self._prior), common.shape[1]))
        for mine, one in zip((*self._order.own, self._order.common), (*own, common), strict=True):
            result[mine] = one * self._unit[mine, None]
        return result.reshape(-1, *y.shape[1:])


class Part(NamedTuple):
    """The columns of one run's rows."""

    rows: slice | np.ndarray  # (m,) indices
    own: np.ndarray  # (m, k)
    used: np.ndarray  # (u,) of the common columns, those that are not zero here
    shared: np.ndarray  # (m, u)

    @classmethod
    def of(cls, columns: np.ndarray, rows: slice | np.ndarray, own: np.ndarray, order: Order) -> "Part":
        """Cut a run's part, `own` columns and common ones, out of columns (n, p)."""
        mine = columns[rows]
        shared = mine[:, order.common]
        used = np.flatnonzero(shared.any(axis=0))
        return cls(rows, mine[:, own], used, shared if len(used) == shared.shape[1] else shared[:, used])


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """Amplitudes of some columns and by how much they reduce chi-square."""

    reduction: float  # of chi-square, the sum of squares
    amplitude: np.ndarray  # (k,)
    covariance: np.ndarray  # (k, k) for rows of deviation 1


def fit(gram: np.ndarray, against: np.ndarray, squares: np.ndarray | None = None, least: float = 1e-9) -> LeastSquares:
    """Fit columns with Gram matrix (k, k) to rows with which their inner products are `against` (k,).

    Parameters
    ----------
    squares : (k,) of the columns before they were freed from others; default: as they are in `gram`
    least : share of these squares that a direction must have left to be fitted

    """
    squares = np.diag(gram) if squares is None else squares
    scale = np.sqrt(np.maximum(squares, np.finfo(float).tiny ** 0.5))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    kept = values > least
    half = (vectors[:, kept] / np.sqrt(values[kept])) / scale[:, None]
    half[squares <= 0.0] = 0.0  # of a column that is nothing, rounding over nothing
    inverse = half @ half.T
    amplitude = inverse @ against
    return LeastSquares(float(against @ amplitude), amplitude, inverse)
