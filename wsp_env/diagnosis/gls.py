"""Generalised least squares with nuisances that carry a prior: projection, gains, estimates.

Rows are whitened. A nuisance with a prior deviation d is a column scaled by d with one more row that says 0 +- 1; one without
is free. Projecting everything off the nuisances makes the gain of any set of columns a matter of small matrices:
the gain is the fall of the sum of squares, in the prior's metric, that the best amplitudes of the set give.
"""

import dataclasses

import numpy as np

_RIDGE = 1e-9  # share of a column's own square added to it, against columns that the nuisances explain wholly


class Projector:
    """Projects whitened rows off nuisances.

    Parameters
    ----------
    columns : (n, p) whitened, those with a prior scaled by its deviation
    prior : (p,) bool, which have one

    """

    def __init__(self, columns: np.ndarray, prior: np.ndarray) -> None:
        n, p = columns.shape
        rows = np.flatnonzero(prior)
        augmented = np.zeros((n + len(rows), p))
        augmented[:n] = columns
        augmented[n + np.arange(len(rows)), rows] = 1.0
        # By the normal matrix: its eigenvectors, the free directions that say nothing left out.
        normal = augmented.T @ augmented
        values, vectors = np.linalg.eigh(normal)
        kept = values > 1e-11 * values[-1]
        self._basis = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
        self._inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        self._columns = columns

    def inner(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Inner products (k, l) of columns (n, k) and (n, l), projected."""
        result: np.ndarray = a.T @ b - (self._basis.T @ a).T @ (self._basis.T @ b)
        return result

    def rest(self, y: np.ndarray) -> np.ndarray:
        """Rows (n,) or (n, k) with the nuisances' best part taken away."""
        result: np.ndarray = y - self._basis @ (self._basis.T @ y)
        return result

    def amplitudes(self, y: np.ndarray) -> np.ndarray:
        """Best amplitudes (p,) of the nuisances, in units of their prior where they have one."""
        result: np.ndarray = self._inverse @ (self._columns.T @ y)
        return result


@dataclasses.dataclass(frozen=True)
class Fit:
    """Amplitudes of some columns and what they gain."""

    gain: float  # fall of the sum of squares
    amplitude: np.ndarray  # (k,)
    covariance: np.ndarray  # (k, k) for rows of deviation 1


def fit(gram: np.ndarray, against: np.ndarray) -> Fit:
    """Fit columns with Gram matrix (k, k) to rows with which their inner products are `against` (k,)."""
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny ** 0.5))
    ridge = gram / np.outer(scale, scale) + _RIDGE * np.eye(len(gram))
    inverse = np.linalg.inv(ridge) / np.outer(scale, scale)
    amplitude = inverse @ against
    return Fit(float(against @ amplitude), amplitude, inverse)
