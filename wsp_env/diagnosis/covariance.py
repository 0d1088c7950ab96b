"""Variance components of the recordings: sizes of nuisances and noise by restricted maximum likelihood.

Whitened rows y are modelled as y = X a + Z b + e. The columns Z form groups. The amplitudes b of group g have mean 0 and
standard deviation t_g; e has variance s_k in rows of kind k. Both are estimated from the recordings (EM for the restricted
likelihood: Laird, Ware 1982; Searle, Casella, McCulloch: Variance components, 1992, chapter 8), with an inverse-gamma prior
about the values expected of sound recordings. The size of a discrepancy that differs between runs and axles thus follows from
their scatter. A mechanism gains only from what it explains beyond this scatter, in all runs alike.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, Eliminated, combined
from wsp_env.diagnosis.balances import NOISES, Balances, Whitening
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Group, whitened

#: Number of observations to which the prior of a group's size is equivalent (assumption).
_PRIOR_WEIGHT = 4.0
#: Lower bound of a balance's noise, as a multiple of the noise that the channels show by themselves.
_LEAST_NOISE = 0.5
_ITERATIONS = 12


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Sizes of the nuisance groups and of each balance's noise."""

    groups: np.ndarray  # (G,) relative to the expected sizes
    noise: np.ndarray  # (5,) standard deviation of each kind of rows (`NOISES`), relative to the channels' own noise


class Evidence:
    """Inner products of rows, nuisances and candidate columns, by kind of noise and run.

    Parameters
    ----------
    columns : (n, K) raw candidate columns
    base : (n,) raw residuals
    last : whether the last group counts as common, so that its posterior is available

    """

    def __init__(
        self,
        balances: Balances | Replica,
        whitening: Whitening,
        groups: Sequence[Group],
        base: np.ndarray,
        columns: np.ndarray | None = None,
        last: bool = False,
    ) -> None:
        columns = np.zeros((len(base), 0)) if columns is None else columns
        self.names = [group.name for group in groups]
        self.fixed = np.array([group.fixed for group in groups])
        self.most = np.array([group.most for group in groups])
        # (G,) For the mean of a quantity over runs: the group of its differences between runs, and what they add to its
        # variance.
        self.differences = np.array([self.names.index(one.mean_of or one.name) for one in groups])
        sizes = np.array([group.expected for group in groups])
        ratio = np.where(np.isfinite(sizes), sizes[self.differences], 0.0) / np.where(np.isfinite(sizes), sizes, 1.0)
        of_mean = np.array([bool(group.mean_of) for group in groups])
        self.adds = of_mean * ratio**2 / len(balances.stops)
        counts = [group.columns.shape[1] for group in groups]
        self.group = np.repeat(np.arange(len(groups)), counts)  # (p,)
        white = whitened(groups, whitening, balances.rows.run)
        every = white.beside(np.column_stack([whitening(columns), whitening(base)]))
        self.nuisances = white.width
        self.order = every.order(1 + columns.shape[1] + (counts[-1] if last else 0))
        self.common = self.order.common[self.order.common < self.nuisances]  # nuisances of more than one run
        self._kind, self._parts = balances.rows.noise, every.parts(self.order)
        self.used = [k for k in range(len(NOISES)) if (self._kind == k).any()]
        self.rows = np.bincount(self._kind, minlength=len(NOISES)).astype(float)
        self.products = [Arrow.of(self._parts, len(self.order.common), self._kind == k) for k in self.used]

    def solve(self, iterations: int = _ITERATIONS, start: Sizes | None = None) -> Sizes:
        """Estimate the sizes by EM iterations, from `start` or the expected sizes; candidate columns are ignored."""
        here = np.append(np.arange(len(self.common)), len(self.order.common) - 1)
        products = [one.first(here) for one in self.products]
        begin = start or Sizes(np.ones(len(self.names)), np.ones(len(NOISES)))
        scale, noise = begin.groups, begin.noise.copy()
        counts = np.bincount(self.group, minlength=len(self.names))
        for _ in range(iterations):
            own, common = self._deviations(scale)
            whole = combined(products, 1.0 / noise[self.used] ** 2).scaled(own, np.append(common, 1.0))
            solved = Eliminated(whole, len(common))
            units, unit = solved.solution(len(common))
            inverse = solved.inverse()
            second = np.empty(self.nuisances)
            second[self.common] = (unit**2 + np.diag(inverse.common)) * common**2
            for mine, amplitude, block, d in zip(self.order.own, units, inverse.own, own, strict=True):
                second[mine] = (amplitude**2 + np.diag(block)) * d**2
            total = np.bincount(self.group, weights=second, minlength=len(self.names))
            new = np.minimum(np.sqrt((total + _PRIOR_WEIGHT) / (counts + _PRIOR_WEIGHT)), self.most)
            scale = np.where(self.fixed, np.sqrt(1.0 + self.adds * new[self.differences] ** 2), new)
            # Residual variance of a kind of rows: squares that the nuisances leave, plus the uncertainty of these.
            left = _moment([d * one for d, one in zip(own, units, strict=True)], common * unit, inverse.scaled(own, common))
            for k, one in zip(self.used, products, strict=True):
                noise[k] = max(np.sqrt((one.inner(left) + _PRIOR_WEIGHT) / (self.rows[k] + _PRIOR_WEIGHT)), _LEAST_NOISE)
        return Sizes(scale, noise)

    def eliminated(self, sizes: Sizes) -> Eliminated:
        """Return the normal equations of all columns for given sizes, with the runs' own columns eliminated."""
        own, common = self._deviations(sizes.groups)
        several = np.append(common, np.ones(len(self.order.common) - len(common)))
        whole = combined(self.products, 1.0 / sizes.noise[self.used] ** 2)
        return Eliminated(whole.scaled(own, several), len(common))

    def left(self, sizes: Sizes) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield for each run its rows (m,), their residuals (m,) after the nuisances, and the uncertainty of these residuals.

        The uncertainty is a root (m, k) of their covariance. All are relative to the noise of their kind.
        """
        solved = self.eliminated(sizes)
        own, common = self._deviations(sizes.groups)
        units, unit = solved.solution(len(self.order.common) - 1)
        numbers = np.arange(len(self._kind))
        for i, part in enumerate(self._parts):
            rows, noise = numbers[part.rows], sizes.noise[self._kind[part.rows], None]
            mine, shared = part.own / noise * own[i], np.zeros((len(rows), len(self.common)))
            nuisance = part.used < len(self.common)
            shared[:, part.used[nuisance]] = part.shared[:, nuisance] / noise * common[part.used[nuisance]]
            base = part.shared[:, -1] / noise[:, 0]  # the last column
            yield rows, base - mine @ units[i] - shared @ unit, solved.spread(i, mine, shared)

    def amplitudes(self, sizes: Sizes) -> np.ndarray:
        """Return the posterior means (p,) of the nuisances' amplitudes, relative to their expected standard deviations."""
        units, unit = self.eliminated(sizes).solution(len(self.order.common) - 1)
        result = np.empty(self.nuisances)
        for mine, one in zip((*self.order.own, self.common), (*units, unit), strict=True):
            result[mine] = one * sizes.groups[self.group[mine]]
        return result

    def _deviations(self, scale: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the standard deviations of the runs' own nuisances and of the common ones."""
        return [scale[self.group[mine]] for mine in self.order.own], scale[self.group[self.common]]


def _moment(own: Sequence[np.ndarray], common: np.ndarray, covariance: Arrow) -> Arrow:
    """Return E[(b, -1)(b, -1)'] of the amplitudes b; its inner product with the rows' products is the residual square sum."""
    last = np.append(common, -1.0)
    wide = np.pad(covariance.common, (0, 1))
    return Arrow(
        tuple(block + np.outer(one, one) for block, one in zip(covariance.own, own, strict=True)),
        tuple(np.pad(block, ((0, 0), (0, 1))) + np.outer(one, last) for block, one in zip(covariance.cross, own, strict=True)),
        wide + np.outer(last, last),
    )
