"""Variance components of the recordings: sizes of nuisances and noise by restricted maximum likelihood.

Whitened rows y are modelled as y = X a + Z b + e. The columns Z form groups. The amplitudes b of group g have mean 0 and
standard deviation t_g; e has variance s_k in rows of kind k. Both are estimated from the recordings by restricted maximum
likelihood (Harville, Journal of the American Statistical Association 72, 1977, 320), with an inverse-gamma prior about the
values expected of sound recordings. The size of a discrepancy that differs between runs and axles thus follows from their
scatter. A mechanism gains only from what it explains beyond this scatter, in all runs alike.
"""

import copy
import dataclasses
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, Eliminated, Order, Part, combined
from wsp_env.diagnosis.balances import NOISES, Balances, Whitening
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Group, whitened

#: Number of observations to which the prior of a group's size is equivalent (assumption).
_PRIOR_WEIGHT = 4.0
#: Lower bound of a balance's noise, as a multiple of the noise that the channels show by themselves.
_LEAST_NOISE = 0.5
#: Relative change of the sizes below which they have converged (it changes a deviance by less than one), and the largest number
#: of iterations.
_CONVERGED, _ITERATIONS = 0.05, 30
#: Longest step of an iteration, over what it asks for (assumption): a size that is far too large shrinks slowly at first.
_LONGEST = 3.0


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Sizes of the nuisance groups and of each balance's noise."""

    groups: np.ndarray  # (G,) relative to the expected sizes
    noise: np.ndarray  # (5,) standard deviation of each kind of rows (`NOISES`), relative to the channels' own noise


class _Longer:
    """Lengthens the steps of an iteration by the secant method, for each size alone."""

    def __init__(self) -> None:
        self._change = self._step = np.zeros(0)

    def step(self, change: np.ndarray) -> np.ndarray:
        """Return the steps (k,) for the changes (k,) of log sizes for which an iteration asks: as long, or longer."""
        factor = np.ones(len(change))
        if len(self._step):
            slope = np.divide(change - self._change, self._step, out=-factor, where=self._step != 0.0)
            factor = np.clip(np.divide(-1.0, slope, out=np.full(len(change), _LONGEST), where=slope < 0.0), 1.0, _LONGEST)
        self._change, self._step = change, factor * change
        return self._step


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
        self._whitening = whitening
        white = whitened(groups, whitening, balances.rows.run)
        every = white.beside(np.column_stack([whitening(columns), whitening(base)]))
        self.nuisances = white.width
        self.order = every.order(1 + columns.shape[1] + (counts[-1] if last else 0))
        self.common = self.order.common[self.order.common < self.nuisances]  # nuisances of more than one run
        self._kind, self._parts = balances.rows.noise, every.parts(self.order)
        self.used = [k for k in range(len(NOISES)) if (self._kind == k).any()]
        self.rows = np.bincount(self._kind, minlength=len(NOISES)).astype(float)
        self.products = [Arrow.of(self._parts, len(self.order.common), self._kind == k) for k in self.used]

    def solve(self, start: Sizes | None = None) -> Sizes:
        """Estimate the sizes, from `start` or the expected sizes; candidate columns are ignored.

        Each size becomes the root of its squares over the number of amplitudes, or of rows, that the data determine.
        """
        here = np.append(np.arange(len(self.common)), len(self.order.common) - 1)
        products = [one.first(here) for one in self.products]
        begin = start or Sizes(np.ones(len(self.names)), np.ones(len(NOISES)))
        scale, noise = begin.groups, begin.noise.copy()
        counts = np.bincount(self.group, minlength=len(self.names))
        longer = _Longer()
        for _ in range(_ITERATIONS):
            before = np.append(scale, noise)
            own, common = self._deviations(scale)
            whole = combined(products, 1.0 / noise[self.used] ** 2).scaled(own, np.append(common, 1.0))
            solved = Eliminated(whole, len(common))
            units, unit = solved.solution(len(common))
            inverse = solved.inverse()
            squares, uncertain = (
                self._each([one**2 for one in units], unit**2),
                self._each(map(np.diag, inverse.own), np.diag(inverse.common)),
            )
            total = np.bincount(self.group, weights=squares, minlength=len(self.names)) * scale**2
            prior = np.bincount(self.group, weights=uncertain, minlength=len(self.names))
            new = np.sqrt((total + _PRIOR_WEIGHT) / (counts - prior + _PRIOR_WEIGHT))
            # A kind of rows: squares that the nuisances leave, and the number of rows that determine nuisances.
            amplitudes = [d * one for d, one in zip(own, units, strict=True)], np.append(common * unit, -1.0)
            covariance = inverse.scaled(own, common).widened()
            for k, one in zip(self.used, products, strict=True):
                given = one.inner(covariance) / noise[k] ** 2
                left = one.square(*amplitudes)
                noise[k] = max(np.sqrt((left + _PRIOR_WEIGHT) / (self.rows[k] - given + _PRIOR_WEIGHT)), _LEAST_NOISE)
            change = np.log(np.append(np.minimum(new, self.most), noise) / before)
            after = before * np.exp(longer.step(change))
            new, noise = np.minimum(after[: len(new)], self.most), np.maximum(after[len(new) :], _LEAST_NOISE)
            scale = np.where(self.fixed, np.sqrt(1.0 + self.adds * new[self.differences] ** 2), new)
            if np.abs(change[~np.append(self.fixed, np.zeros(len(noise), dtype=bool))]).max() < _CONVERGED:
                break
        return Sizes(scale, noise)

    def about(self, base: np.ndarray) -> "Evidence":
        """Return the same for other raw residuals (n,)."""
        white = self._whitening(base)
        other = copy.copy(self)
        other._parts = [part._replace(shared=np.column_stack([part.shared[:, :-1], white[part.rows]])) for part in self._parts]
        other.products = [one.with_last(other._parts, self._kind == k) for k, one in zip(self.used, self.products, strict=True)]
        return other

    def projector(self, sizes: Sizes, kept: np.ndarray) -> Projector:
        """Return the projector off the nuisances `kept` (p,) bool, for rows relative to the noise of their kind."""
        number = np.cumsum(kept) - 1
        own, common = self._deviations(sizes.groups)
        mine, shared = [kept[one] for one in self.order.own], np.flatnonzero(kept[self.common])
        place = np.full(len(self.order.common), -1)
        place[shared] = np.arange(len(shared))
        parts = []
        for part, inside, d in zip(self._parts, mine, own, strict=True):
            noise = sizes.noise[self._kind[part.rows], None]
            stays = place[part.used] >= 0
            columns = part.shared[:, stays] / noise * common[part.used[stays]]
            parts.append(Part(part.rows, part.own[:, inside] / noise * d[inside], place[part.used[stays]], columns))
        whole = combined([one.first(shared, mine) for one in self.products], 1.0 / sizes.noise[self.used] ** 2)
        arrow = whole.scaled([d[inside] for d, inside in zip(own, mine, strict=True)], common[shared])
        order = Order(
            tuple(number[one[inside]] for one, inside in zip(self.order.own, mine, strict=True)), number[self.common[shared]]
        )
        return Projector(parts, order, Eliminated(arrow, len(shared)))

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
        return self._each(units, unit) * sizes.groups[self.group]

    def _each(self, own: Iterable[np.ndarray], common: np.ndarray) -> np.ndarray:
        """Return the values (p,) of all nuisances, from those of each run's own ones and of the common ones."""
        result = np.empty(self.nuisances)
        for mine, one in zip((*self.order.own, self.common), (*own, common), strict=True):
            result[mine] = one
        return result

    def _deviations(self, scale: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the standard deviations of the runs' own nuisances and of the common ones."""
        return [scale[self.group[mine]] for mine in self.order.own], scale[self.group[self.common]]
