"""How large every discrepancy is in the recordings at hand, and how likely they are under a model: restricted likelihood.

Whitened rows y are taken as y = X a + Z b + e. The columns Z come in groups; b of group g has deviation t_g about 0, e has
variance s_k in balance k. Both are estimated from the recordings (EM for the restricted likelihood: Laird, Ware 1982; Searle,
Casella, McCulloch: Variance components, 1992, chapter 8), with an inverse-gamma prior about what is expected of sound
recordings. So a discrepancy that differs between runs and axles as it likes is learned from their disagreement, and a mechanism
gains only by what it explains beyond that, in all runs alike.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from wsp_env.diagnosis.balances import BALANCES, Balances, Whitening
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Group

#: Number of observations that the expected size of a group counts for: assumption.
_PRIOR_WEIGHT = 4.0
#: Times the noise that the channels show by themselves, below which a balance's noise is not taken.
_LEAST_NOISE = 0.5
_ITERATIONS = 12
#: Deviation of a free column, in its own unit of whitened rows of length 1.
_FREE = 1e3


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Sizes of groups and of each balance's noise."""

    groups: np.ndarray  # (G,) over the expected
    noise: np.ndarray  # (4,) deviation of the rows of each balance over the channels' own


class Evidence:
    """Rows, nuisances and candidate columns by their inner products.

    Parameters
    ----------
    columns : (n, K) raw candidate columns
    base : (n,) raw residuals

    """

    def __init__(
        self,
        balances: Balances | Replica,
        whitening: Whitening,
        groups: Sequence[Group],
        base: np.ndarray,
        columns: np.ndarray,
    ) -> None:
        self.names = [group.name for group in groups]
        self.fixed = np.array([group.fixed for group in groups])
        # (G,) which group's differences between runs a common one's mean is of, and what they add to its variance.
        self.differences = np.array([self.names.index(one.mean_of or one.name) for one in groups])
        sizes = np.array([group.expected for group in groups])
        ratio = np.where(np.isfinite(sizes), sizes[self.differences], 0.0) / np.where(np.isfinite(sizes), sizes, 1.0)
        of_mean = np.array([bool(group.mean_of) for group in groups])
        self.adds = of_mean * ratio**2 / len(balances.stops)
        counts = [group.columns.shape[1] for group in groups]
        self.group = np.repeat(np.arange(len(groups)), counts)  # (p,)
        white = whitening(np.column_stack([group.columns for group in groups]))
        for group, start in zip(groups, np.cumsum([0, *counts[:-1]]), strict=True):
            mine = slice(start, start + group.columns.shape[1])
            if np.isinf(group.expected):
                white[:, mine] *= _FREE / np.maximum(np.linalg.norm(white[:, mine], axis=0), 1e-12)
            else:
                white[:, mine] *= group.expected
        every = np.column_stack([white, whitening(columns), whitening(base)])
        balance = balances.rows.balance
        self.nuisances = white.shape[1]
        self.gram = np.zeros((len(BALANCES), every.shape[1], every.shape[1]))
        self.rows = np.bincount(balance, minlength=len(BALANCES)).astype(float)
        for k in range(len(BALANCES)):
            part = every[balance == k]
            if len(part):
                self.gram[k] = part.T @ part

    def solve(self, iterations: int = _ITERATIONS) -> Sizes:
        """Estimate the sizes in some iterations from the expected ones; the columns play no part."""
        p = self.nuisances
        index = np.append(np.arange(p), self.gram.shape[1] - 1)
        gram = self.gram[:, index[:, None], index]
        scale, noise = np.ones(len(self.names)), np.ones(len(BALANCES))
        counts = np.bincount(self.group, minlength=len(self.names))
        for _ in range(iterations):
            deviation = scale[self.group]
            whole = np.tensordot(1.0 / noise**2, gram, axes=1)
            scaled = whole[:-1, :-1] * np.outer(deviation, deviation)
            scaled[np.diag_indices_from(scaled)] += 1.0
            factor = linalg.cho_factor(scaled, lower=True, check_finite=False)
            unit = linalg.cho_solve(factor, deviation * whole[:-1, -1], check_finite=False)
            inverse = inverse_of(factor[0])
            second = (unit**2 + np.diag(inverse)) * deviation**2
            total = np.bincount(self.group, weights=second, minlength=len(self.names))
            new = np.sqrt((total + _PRIOR_WEIGHT) / (counts + _PRIOR_WEIGHT))
            scale = np.where(self.fixed, np.sqrt(1.0 + self.adds * new[self.differences] ** 2), new)
            amplitude, covariance = deviation * unit, inverse * np.outer(deviation, deviation)
            for k in map(int, np.flatnonzero(self.rows)):
                g = gram[k]
                left = g[-1, -1] - 2.0 * amplitude @ g[:-1, -1] + amplitude @ g[:-1, :-1] @ amplitude
                left += float(np.sum(covariance * g[:-1, :-1]))
                noise[k] = max(np.sqrt((left + _PRIOR_WEIGHT) / (self.rows[k] + _PRIOR_WEIGHT)), _LEAST_NOISE)
        return Sizes(scale, noise)

    def amplitudes(self, sizes: Sizes) -> np.ndarray:
        """Return the most likely amplitudes (p,) of the nuisances, over what is expected of each."""
        p = self.nuisances
        index = np.append(np.arange(p), self.gram.shape[1] - 1)
        whole = np.tensordot(1.0 / sizes.noise**2, self.gram[:, index[:, None], index], axes=1)
        precision = whole[:-1, :-1] + np.diag(1.0 / sizes.groups[self.group] ** 2)
        result: np.ndarray = linalg.solve(precision, whole[:-1, -1], assume_a="pos", check_finite=False)
        return result


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Return the inverse (p, p) of a matrix from its lower Cholesky factor: a third of the work of solving for it."""
    half = np.tril(lapack.dpotri(factor, lower=1)[0])
    result: np.ndarray = half + np.tril(half, -1).T
    return result
