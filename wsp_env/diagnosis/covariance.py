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


@dataclasses.dataclass(frozen=True)
class Solution:
    """Columns fitted under some sizes."""

    sizes: Sizes
    log_likelihood: float  # restricted
    amplitudes: np.ndarray  # (p + k,) of nuisances, in their expected deviations, then of the columns
    covariance: np.ndarray  # (k, k) of the columns
    pulled: np.ndarray  # (p,) nuisances over their own size


class Evidence:
    """Rows, nuisances and candidate columns by their inner products.

    Parameters
    ----------
    columns : (n, K) raw candidate columns
    base : (n,) raw residuals
    keep : (n,) bool, rows that count

    """

    def __init__(
        self,
        balances: Balances | Replica,
        whitening: Whitening,
        groups: Sequence[Group],
        base: np.ndarray,
        columns: np.ndarray,
        keep: np.ndarray | None = None,
    ) -> None:
        keep = np.ones(len(base), dtype=bool) if keep is None else keep
        self.names = [group.name for group in groups]
        self.fixed = np.array([group.fixed for group in groups])
        counts = [group.columns.shape[1] for group in groups]
        self.group = np.repeat(np.arange(len(groups)), counts)  # (p,)
        white = whitening(np.column_stack([group.columns for group in groups]))
        for group, start in zip(groups, np.cumsum([0, *counts[:-1]]), strict=True):
            mine = slice(start, start + group.columns.shape[1])
            if np.isinf(group.expected):
                white[:, mine] *= _FREE / np.maximum(np.linalg.norm(white[:, mine], axis=0), 1e-12)
            else:
                white[:, mine] *= group.expected
        every = np.column_stack([white, whitening(columns), whitening(base)])[keep]
        balance = balances.rows.balance[keep]
        self.nuisances, self.columns = white.shape[1], columns.shape[1]
        self.gram = np.zeros((len(BALANCES), every.shape[1], every.shape[1]))
        self.rows = np.bincount(balance, minlength=len(BALANCES)).astype(float)
        for k in range(len(BALANCES)):
            part = every[balance == k]
            if len(part):
                self.gram[k] = part.T @ part

    def start(self) -> Sizes:
        """Return the expected sizes."""
        return Sizes(np.ones(len(self.names)), np.ones(len(BALANCES)))

    def solve(self, chosen: np.ndarray, sizes: Sizes, wide: np.ndarray, iterations: int = _ITERATIONS) -> Solution:
        """Fit some candidate columns with the nuisances; sizes are estimated in some iterations from where they are.

        Parameters
        ----------
        chosen : (k,) indices of candidate columns
        wide : (k,) prior deviation of their amplitudes

        """
        p = self.nuisances
        index = np.concatenate([np.arange(p), p + chosen, [p + self.columns]])
        gram = self.gram[:, index[:, None], index]
        scale, noise = sizes.groups.copy(), sizes.noise.copy()
        counted = self.rows > 0.0
        for iteration in range(iterations + 1):
            deviation = np.concatenate([scale[self.group], wide])
            weight = 1.0 / noise**2
            whole = np.tensordot(weight, gram, axes=1)
            inner, against, square = whole[:-1, :-1], whole[:-1, -1], whole[-1, -1]
            scaled = inner * np.outer(deviation, deviation)
            scaled[np.diag_indices_from(scaled)] += 1.0
            factor = linalg.cho_factor(scaled, lower=True, check_finite=False)
            unit = linalg.cho_solve(factor, deviation * against, check_finite=False)
            quadratic = float(square - (deviation * against) @ unit)
            if iteration == iterations:
                break
            inverse = linalg.cho_solve(factor, np.eye(len(deviation)), check_finite=False)
            second = (unit**2 + np.diag(inverse)) * deviation**2
            total = np.bincount(self.group, weights=second[:p], minlength=len(self.names))
            counts = np.bincount(self.group, minlength=len(self.names))
            new = np.sqrt((total + _PRIOR_WEIGHT) / (counts + _PRIOR_WEIGHT))
            scale = np.where(self.fixed, scale, new)
            amplitude = deviation * unit
            covariance = inverse * np.outer(deviation, deviation)
            for k in map(int, np.flatnonzero(counted)):
                g = gram[k]
                left = g[-1, -1] - 2.0 * amplitude @ g[:-1, -1] + amplitude @ g[:-1, :-1] @ amplitude
                left += float(np.sum(covariance * g[:-1, :-1]))
                noise[k] = max(np.sqrt((left + _PRIOR_WEIGHT) / (self.rows[k] + _PRIOR_WEIGHT)), _LEAST_NOISE)
        free = ~self.fixed
        prior = -0.5 * _PRIOR_WEIGHT * float((1.0 / scale[free] ** 2 + 2.0 * np.log(scale[free]) - 1.0).sum())
        logs = float(np.log(np.diag(factor[0])).sum() + (self.rows * np.log(noise)).sum())
        count = len(chosen)
        solved = linalg.cho_solve(factor, np.eye(len(deviation))[:, p:], check_finite=False)
        covariance = solved[p:] * np.outer(wide, wide)
        return Solution(
            Sizes(scale, noise), -0.5 * quadratic - logs + prior, deviation * unit, covariance.reshape(count, count), unit[:p]
        )
