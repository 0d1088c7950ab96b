"""Screens all candidates at once about a model: reductions of chi-square in the data and in null recordings, by small matrices.

Every null recording passes the very same steps as the data, sensitivities included: a column is computed from noisy channels,
its inner product with the residual therefore has a mean of its own, and that mean, seen in the null recordings, is taken away.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from scipy.stats import gamma

from wsp_env.diagnosis import candidates
from wsp_env.diagnosis.balances import Balances, Rows
from wsp_env.diagnosis.candidates import Candidate, Variant, library, parameter_of
from wsp_env.diagnosis.closures import closures
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.gls import LeastSquares, Projector, fit
from wsp_env.diagnosis.variation import nuisances
from wsp_env.plant.mechanisms import ALL

#: Share of its square that a direction must have left: less is nothing that the null recordings' mean can be taken from.
_LEFT = 1e-3
#: Share of its square, before the nuisances are taken away, that a column must have left.
_SPANNED = 1e-6
#: Stretches of a single run that are held out in turn [s]: some slides long.
_STRETCH_S = 4.0
#: Pairs that reduce chi-square most, of which null recordings are asked too.
_PAIRS = 20
_NONE = np.zeros(0, dtype=int)
_LOG10 = float(np.log(10.0))


@dataclasses.dataclass(frozen=True)
class Products:
    """Inner products of all columns with each other and with the residual, off the nuisances, over some rows."""

    gram: np.ndarray  # (K, K)
    against: np.ndarray  # (K,)
    cost: float  # of the residual with itself
    rows: int


@dataclasses.dataclass(frozen=True)
class Scan:
    """All candidates in one campaign, recorded or null."""

    candidates: tuple[Candidate, ...]  # without their columns
    parts: tuple[slice, ...]
    accepted: int  # that many last columns belong to the mechanisms that are on
    whole: Products
    tune: Products
    validate: Products

    def columns_of(self, candidate: int) -> np.ndarray:
        """Return the indices of a candidate's columns."""
        part = self.parts[candidate]
        return np.arange(part.start, part.stop)


def scan(
    balances: Balances,
    model: Model,
    weights: Weights,
    tried: Sequence[Variant],
    accepted: Sequence[Variant] = (),
    held_out: bool = True,
) -> Scan:
    """Compute the inner products of all candidates about a model.

    Parameters
    ----------
    weights : with which rows are whitened
    tried : variants of the library
    accepted : mechanisms that are on in the model
    held_out : whether the halves, rows to tune on and to validate, are wanted too

    """
    rows = balances.rows
    base = balances.raw(model)
    nuisance = nuisances(balances, model, base)
    friction = nuisance.friction
    listed = library(balances, model, base, friction, tried) + closures(balances, model, friction)
    on = [candidates.columns(balances, model, base, one)[0] for one in accepted]
    scale = weights.deviation[:, None]
    x = np.column_stack([*(one.columns for one in listed), *on]) / scale
    free, y = nuisance.columns / scale, weights(base)
    ends = np.cumsum([one.columns.shape[1] for one in listed])
    parts = tuple(slice(int(end) - one.columns.shape[1], int(end)) for one, end in zip(listed, ends, strict=True))

    def products(keep: np.ndarray) -> Products:
        projector = Projector(free[keep], nuisance.prior)
        both = np.column_stack([x[keep], y[keep]])
        inner = projector.inner(both, both)
        # What the nuisances span leaves rounding errors.
        spanned = np.diag(inner) < _SPANNED * np.einsum("nk,nk->k", both, both)
        inner[spanned, :] = inner[:, spanned] = 0.0
        return Products(inner[:-1, :-1], inner[:-1, -1], float(inner[-1, -1]), int(keep.sum()))

    bare = tuple(dataclasses.replace(one, columns=np.zeros((0, one.columns.shape[1]))) for one in listed)
    every = np.ones(len(rows), dtype=bool)
    whole = products(every)
    halves = [whole, whole]
    if held_out:
        held = held_out_rows(rows)
        halves = [products(~held), products(held)]
    return Scan(bare, parts, sum(one.shape[1] for one in on), whole, halves[0], halves[1])


def held_out_rows(rows: Rows) -> np.ndarray:
    """Return the rows (n,) bool to validate on.

    Those of the validate group; where there is none, or nothing else, every other run, and in a single run every other stretch.
    """
    if rows.validate.any() and not rows.validate.all():
        return rows.validate
    turns = rows.run if rows.run.max(initial=0) > 0 else np.floor(rows.time / _STRETCH_S).astype(int)
    result: np.ndarray = turns % 2 == 1
    return result


def conditioned(
    products: Products, index: np.ndarray, given: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gram matrix and inner products of some columns, off others as well, and their squares before.

    `offset` is taken from the inner products.
    """
    gram, against = products.gram, products.against - offset
    squares = np.diag(gram)[index]
    if not len(given):
        return gram[np.ix_(index, index)], against[index], squares
    inverse = fit(gram[np.ix_(given, given)], against[given], least=_LEFT).covariance
    cross = gram[np.ix_(index, given)]
    freed = gram[np.ix_(index, index)] - cross @ inverse @ cross.T
    return freed, against[index] - cross @ inverse @ against[given], squares


@dataclasses.dataclass(frozen=True)
class Found:
    """The best variant of one name in the data, and the name's reductions in null recordings."""

    name: str
    reduction: float  # of chi-square, the sum of squares
    nulls: np.ndarray  # (R,) of the best variant in each
    held_out: float  # reduction on the runs to validate of amplitudes fitted to those to tune on
    which: int  # candidate of the scan
    fit: LeastSquares

    @property
    def net(self) -> float:
        """Gain over that in null recordings."""
        return self.reduction - float(self.nulls.mean())

    @property
    def neg_log10_p(self) -> float:
        """Minus log10 of the probability of such a reduction in a null recording."""
        return neg_log10_p(self.reduction, self.nulls)


def neg_log10_p(reduction: float, nulls: np.ndarray) -> float:
    """Minus log10 of the probability of a reduction under the gamma distribution of the nulls' mean and variance."""
    # A reduction is at least a chi-square of one degree of freedom, whatever few null recordings say.
    mean = max(float(nulls.mean()), 1.0)
    variance = max(float(nulls.var(ddof=1)) if len(nulls) > 1 else 0.0, 2.0 * mean)
    # Beyond some 300 the tail is nothing a float holds.
    return float(min(-gamma.logsf(reduction, mean**2 / variance, scale=variance / mean) / _LOG10, 300.0))


def can_be(one: Candidate, fitted: LeastSquares) -> bool:
    """Whether a mechanism of one size whose null is a bound (no brake pushes) was fitted to its possible side."""
    if one.variant is None or len(one.variant.sizes) != 1:
        return True
    size = parameter_of(one.name, one.variant.sizes[0])
    change = -float(fitted.amplitude[0]) * one.steps[0]
    return (size.null > size.low or change >= 0.0) and (size.null < size.high or change <= 0.0)


class LibrarySearch:
    """Reductions of chi-square by all candidates in the data against those in null recordings.

    Parameters
    ----------
    data : scan about the present model
    nulls : scans of null recordings about the baseline
    given : for every null scan the columns of the mechanisms accepted so far
    tilt : mean inner product of the accepted mechanisms' columns, in the data's scan, with residuals of null recordings

    """

    def __init__(self, data: Scan, nulls: Sequence[Scan], given: np.ndarray, tilt: np.ndarray) -> None:
        self.data, self.nulls, self.given = data, nulls, given
        k = len(data.whole.against)
        self.own = np.arange(k - data.accepted, k)  # columns of the accepted mechanisms in the data's scan
        names = {self._key(one): i for i, one in enumerate(nulls[0].candidates)}
        self.twin = [names.get(self._key(one), -1) for one in data.candidates]
        self.mean = np.mean([null.whole.against for null in nulls], axis=0)
        whole = self._offset()
        whole[self.own] = tilt
        # The halves' own means would need the halves of all null recordings: by their share of the columns' squares.
        shares = [np.diag(half.gram) / np.maximum(np.diag(data.whole.gram), 1e-12) for half in (data.tune, data.validate)]
        self.offsets = {"whole": whole, "tune": whole * shares[0], "validate": whole * shares[1]}

    @staticmethod
    def _key(one: Candidate) -> tuple[object, ...]:
        variant = one.variant
        return (one.name, one.columns.shape[1], *(sorted(variant.fixed.items()) if variant else ()))

    def _offset(self) -> np.ndarray:
        """Mean inner product (K,) of the data's columns in null recordings."""
        square = np.mean([np.diag(null.whole.gram) for null in self.nulls], axis=0)
        offset = np.zeros(len(self.data.whole.against))
        for mine, its in enumerate(self.twin):
            if its >= 0:
                own, index = self.data.columns_of(mine), self.nulls[0].columns_of(its)
                # About an extended model a column may have become smaller, and its mean with it.
                share = np.sqrt(np.diag(self.data.whole.gram)[own] / np.maximum(square[index], 1e-12))
                offset[own] = np.minimum(share, 1.0) * self.mean[index]
        return offset

    def solve(self, index: np.ndarray, part: str = "whole", beside: np.ndarray = _NONE) -> LeastSquares:
        """Fit some columns to the data, off those of the accepted mechanisms and some others'."""
        given = np.concatenate([self.own, beside])
        return fit(*conditioned(getattr(self.data, part), index, given, self.offsets[part]), _LEFT)

    def held_out(self, index: np.ndarray) -> float:
        """Gain on the rows to validate of amplitudes fitted to the others."""
        amplitude = self.solve(index, "tune").amplitude
        gram, against, _ = conditioned(self.data.validate, index, self.own, self.offsets["validate"])
        return float(2.0 * amplitude @ against - amplitude @ gram @ amplitude)

    def null_reductions(self, *which: int) -> np.ndarray:
        """Gains (R,) of a candidate of the data's scan, or of some together, in the null recordings."""
        twins = [self.twin[one] for one in which if self.twin[one] >= 0]
        if not twins:
            return np.zeros(len(self.nulls))
        index = np.concatenate([self.nulls[0].columns_of(its) for its in twins])
        # Each is freed from the mean of the others: its own would make it look smaller than the data's.
        mean, count = self.mean, len(self.nulls)
        reductions = []
        for null in self.nulls:
            offset = (count * mean - null.whole.against) / max(count - 1, 1)
            one = fit(*conditioned(null.whole, index, self.given, offset), _LEFT)
            reductions.append(one.reduction if len(twins) > 1 or can_be(null.candidates[twins[0]], one) else 0.0)
        return np.array(reductions)

    def pairs(self, found: Sequence[Found]) -> list[tuple[float, float, Found, Found]]:
        """Return net reduction, mean reduction in null recordings and members of pairs of mechanisms, the best pair first."""
        library = [one for one in found if one.name in ALL and one.reduction > 0.0]
        joint = []
        for a, b in itertools.combinations(library, 2):
            columns = np.concatenate([self.data.columns_of(one.which) for one in (a, b)])
            joint.append((self.solve(columns).reduction, a, b))
        joint.sort(key=lambda pair: -pair[0])
        result = []
        for reduction, a, b in joint[:_PAIRS]:
            null = float(self.null_reductions(a.which, b.which).mean())
            result.append((reduction - null, null, a, b))
        return sorted(result, key=lambda pair: -pair[0])

    def found(self) -> list[Found]:
        """Return the best variant of every name with the name's null reductions, least probable first."""
        by_name: dict[str, list[int]] = {}
        for i, one in enumerate(self.data.candidates):
            by_name.setdefault(one.name, []).append(i)
        result = []
        for name, members in by_name.items():
            fits = [self.solve(self.data.columns_of(i)) for i in members]
            reductions = [one.reduction * can_be(self.data.candidates[i], one) for i, one in zip(members, fits, strict=True)]
            best = int(np.argmax(reductions))
            nulls = np.max([self.null_reductions(i) for i in members], axis=0)
            which = members[best]
            held_out = self.held_out(self.data.columns_of(which))
            result.append(Found(name, reductions[best], nulls, held_out, which, fits[best]))
        return sorted(result, key=lambda one: -one.neg_log10_p)
