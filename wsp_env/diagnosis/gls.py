"""Generalised least squares with nuisances that carry a prior: projection, reductions of chi-square, estimates.

Rows are whitened. A nuisance with a prior deviation d is a column scaled by d with one more row that says 0 +- 1; one without
is free. Projecting everything off the nuisances makes what any set of columns explains a matter of small
matrices: the reduction of chi-square, the sum of squares in the prior's metric, that the best amplitudes of the set give.
"""

import dataclasses
import functools

import numpy as np
from scipy import linalg

_NOTHING = 1e-11  # of the largest square of a nuisance's column, below which a direction says nothing


def gram_of(columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return the inner products (p, p) of columns (n, p), most of which concern one run: the others' zeros cost nothing.

    Parameters
    ----------
    run : (n,) int of each row

    """
    result = np.zeros((columns.shape[1],) * 2)
    for one in np.unique(run):
        part = columns[run == one]
        used = np.flatnonzero(part.any(axis=0))
        part = part[:, used]
        result[np.ix_(used, used)] += part.T @ part
    return result


class Projector:
    """Projects whitened rows off nuisances.

    Parameters
    ----------
    columns : (n, p) whitened, those with a prior scaled by its deviation
    prior : (p,) bool, which have one
    run : (n,) int of each row, where many columns concern one run alone

    """

    def __init__(self, columns: np.ndarray, prior: np.ndarray, run: np.ndarray | None = None) -> None:
        self._columns, self._prior = columns, prior
        self._run = np.zeros(len(columns), dtype=int) if run is None else run
        normal = gram_of(columns, self._run)
        # Free directions that say nothing get next to nothing to say.
        least = _NOTHING * max(float(np.diag(normal).max(initial=0.0)), 1.0)
        normal[np.diag_indices_from(normal)] += np.where(prior, 1.0, least)
        self._root = linalg.cholesky(normal, lower=True, overwrite_a=True, check_finite=False)

    @functools.cached_property
    def by_run(self) -> "tuple[tuple[np.ndarray, Projector], ...]":
        """What takes away the nuisances from the rows (n,) bool of every run alone: there they are free of the other runs'."""
        found = []
        for run in np.unique(self._run):
            rows = self._run == run
            columns = self._columns[rows]
            used = columns.any(axis=0)
            found.append((rows, Projector(columns[:, used], self._prior[used], self._run[rows])))
        return tuple(found)

    def inner(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Inner products (k, l) of columns (n, k) and (n, l), projected."""
        left, right = (self._solved(self._columns.T @ one) for one in (a, b))
        result: np.ndarray = a.T @ b - left.T @ right
        return result

    def _solved(self, y: np.ndarray, transposed: bool = False) -> np.ndarray:
        result: np.ndarray = linalg.solve_triangular(self._root, y, lower=True, trans=int(transposed), check_finite=False)
        return result

    def rest(self, y: np.ndarray) -> np.ndarray:
        """Rows (n,) or (n, k) with the nuisances' best part taken away."""
        result: np.ndarray = y - self._columns @ self.amplitudes(y)
        return result

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (p,) of the nuisances, in units of their prior where they have one."""
        return self._solved(self._solved(self._columns.T @ y), transposed=True)


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
    inverse = half @ half.T
    amplitude = inverse @ against
    return LeastSquares(float(against @ amplitude), amplitude, inverse)
