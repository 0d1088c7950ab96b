"""Generalised least squares with nuisances that have a prior: projection, reductions of chi-square, estimates.

Rows are whitened. A nuisance with prior standard deviation d is a column scaled by d plus one pseudo-observation 0 +- 1. A
nuisance without a prior is free. After projection off the nuisances, fits of any set of columns need only small matrices. The
reduction of chi-square is the decrease of the sum of squares, in the prior's metric, at the best amplitudes of the set.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, ByRun, Eliminated, Order, Part
from wsp_env.diagnosis.triangular import cholesky, solved

_ROUNDING = 10.0 * np.finfo(float).eps  # error of a difference of sums of squares, over the largest of them (assumption)
_NOTHING = 1e-11  # share of a nuisance column's largest square below which a direction carries no information


class Projector:
    """Projects whitened rows off nuisances. Most nuisances concern one run only; the equations are solved run by run.

    Parameters
    ----------
    parts : the nuisances' columns run by run, whitened; those with a prior are scaled by its standard deviation
    order : of the columns
    solved : their normal equations
    unit : (p,) factors by which the columns were scaled beyond that; None: 1

    """

    def __init__(self, parts: Sequence[Part], order: Order, solved: Eliminated, unit: np.ndarray | None = None) -> None:
        self._parts, self._order, self._solved = parts, order, solved
        self._unit = np.ones(sum(map(len, order.own)) + len(order.common)) if unit is None else unit

    @classmethod
    def of(cls, columns: np.ndarray | ByRun, prior: np.ndarray, run: np.ndarray | None = None) -> "Projector":
        """Return the projector off whitened columns (n, p), of which those of `prior` (p,) bool have a prior.

        Parameters
        ----------
        run : (n,) int, the run of each row; used if many columns concern one run only; not needed if stored by run

        """
        if not isinstance(columns, ByRun):
            columns = ByRun.of(columns, np.zeros(len(columns), dtype=int) if run is None else run)
        unit = np.ones(len(prior))
        if not prior.all():  # a free direction gets a prior so wide that it carries almost no information
            unit[~prior] = (_NOTHING * max(float(columns.squares().max(initial=0.0)), 1.0)) ** -0.5
            columns = columns.scaled(unit)
        order = columns.order(0)
        parts = columns.parts(order)
        common = len(order.common)
        return cls(parts, order, Eliminated(Arrow.of(parts, common), common), unit)

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
        result = np.array(y, dtype=float).reshape(len(y), -1)
        own, common = self._solved.back(*self._half(result))
        for part, mine in zip(self._parts, own, strict=True):
            result[part.rows] -= part.own @ mine + part.shared @ common[part.used]
        return result.reshape(y.shape)

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (p,) or (p, k) of the nuisances; with a prior, in units of its standard deviation."""
        own, common = self._solved.back(*self._half(y.reshape(len(y), -1)))
        result = np.empty((len(self._unit), common.shape[1]))
        for mine, one in zip((*self._order.own, self._order.common), (*own, common), strict=True):
            result[mine] = one * self._unit[mine, None]
        return result.reshape(-1, *y.shape[1:])

    def beside(self, columns: np.ndarray) -> "Beside":
        """Return the projector that also removes a few further columns (n, k), with a prior of deviation 1."""
        return Beside(self, columns)

    def without(self, columns: np.ndarray) -> "Beside":
        """Return the projector that does not remove a few of its nuisances (n, k), with a prior of deviation 1."""
        return Beside(self, columns, -1.0)


class Beside(Projector):
    """A projector off the nuisances of another one and a few further columns, which come last.

    With `sign` -1, the further columns are nuisances of the other one, and removed from it: added with variance -1, they cancel
    those with variance 1, and their amplitudes too.
    """

    def __init__(self, projector: Projector, columns: np.ndarray, sign: float = 1.0) -> None:
        self._projector, self._columns, self._freed, self._sign = projector, columns, projector.rest(columns), sign
        rounding = _ROUNDING * max(float(np.einsum("nk,nk->k", columns, columns).max(initial=0.0)), 1.0)
        self._factor = _root(sign * columns.T @ self._freed + np.eye(columns.shape[1]), rounding)

    @property
    def logdet(self) -> float:
        """As for the projector."""
        return self._projector.logdet + 2.0 * float(np.log(np.diag(self._factor)).sum())

    def inner(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """As for the projector."""
        left, right = (solved(self._factor, self._freed.T @ one) for one in (a, b))
        result: np.ndarray = self._projector.inner(a, b) - self._sign * left.T @ right
        return result

    def rest(self, y: np.ndarray) -> np.ndarray:
        """As for the projector."""
        return self._projector.rest(y - self._columns @ self._further(y))

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """As for the projector."""
        further = self._further(y)
        return np.concatenate([self._projector.amplitudes(y - self._columns @ further), further])

    def _further(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (k,) or (k, m) of the further columns."""
        return self._sign * solved(self._factor, solved(self._factor, self._freed.T @ y), True)


def _root(matrix: np.ndarray, rounding: float) -> np.ndarray:
    """Return the lower Cholesky factor (k, k) of a matrix that is positive definite but for rounding.

    Its eigenvalues are variances after the rows over those before them. One below the rounding cannot be told from none.
    """
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return cholesky((vectors * np.maximum(values, rounding)) @ vectors.T)


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
