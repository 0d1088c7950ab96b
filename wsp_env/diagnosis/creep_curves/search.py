"""The search on creep curves: null recordings, reductions of chi-square, cross-validation, acceptance.

As for stops, a mechanism is accepted under three conditions. With the same fits, null recordings of the model without it rarely
show as large a reduction by any candidate. It predicts held-out points better. Its effect is of interest.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from wsp_env.diagnosis.creep_curves.model import CreepModel, CurveFit

NULLS = 99  # null recordings at effort 1: the smallest probability that they can show is 1 in 100
RARE = 0.01  # probability in null recordings below which a candidate is accepted; above it, the forward search stops
FOLDS = 20  # blocks of neighbouring creepages, each held out once; with 10 or fewer, the outer blocks are extrapolated far
CLOSURE = "function of creepage"
_DEGREE = 5  # of the closure's polynomials in log creepage: the highest that points with 10 % scatter can show
_BLOCK = 5  # neighbouring points whose scatter has a common sign in a null recording
_LEAST_BLOCKS = 20  # with fewer blocks, there are too few different null recordings
_INTEREST = 0.01  # relative change of adhesion [-]; at constant creepage equal to that of the stopping distance


@dataclasses.dataclass(frozen=True)
class Reductions:
    """Reductions of chi-square by candidates, relative to a model, with the same in null recordings."""

    current: CurveFit
    names: tuple[tuple[str, ...], ...]  # each candidate: one or two mechanisms
    fits: tuple[CurveFit, ...]
    data: np.ndarray  # (candidates,) decrease of the sum of squares over the scatter's variance
    null: np.ndarray  # (replicates, candidates) the same in null recordings of `current`
    refits: tuple[CurveFit, ...]  # of `current` to each null recording

    def probability(self, i: int) -> float:
        """Probability of such a reduction in null recordings: by any mechanism, or for the closure by the closure itself."""
        rivals = self.null[:, i] if self.names[i] == (CLOSURE,) else self.null[:, :-1].max(axis=1)
        return float((1 + np.sum(rivals >= self.data[i])) / (1 + len(rivals)))


class CreepSearch:
    """Data and state shared by the steps of the search."""

    def __init__(self, model: CreepModel, replicates: int, seed: int, progress: Callable[[str], None]) -> None:
        self.model, self.replicates, self.progress = model, replicates, progress
        self.measured = model.measured
        self._random = np.random.default_rng(seed)
        self.candidates = model.searched
        self.baseline = model.fit((), self.measured)
        self.scatter = _scatter(model, model.fit(self.candidates, self.measured))
        self.variance = float(np.mean(self.scatter**2))
        order = np.lexsort((model.speed, model.creepage))
        self.folds = np.empty(len(order), dtype=np.int64)
        self.folds[order] = np.arange(len(order)) * FOLDS // len(order)

    def null(self, fit: CurveFit) -> np.ndarray:
        """Return adhesion coefficients (n,) of a null recording: the model's values plus scatter with random signs by block."""
        n = len(self.measured)
        block = max(1, min(_BLOCK, n // _LEAST_BLOCKS))
        signs = np.repeat(self._random.choice((-1.0, 1.0), n // block + 2), block)
        first = int(self._random.integers(block))  # where blocks begin
        result: np.ndarray = self.measured + fit.residual + self.scatter * signs[first : first + n]
        return result

    def reductions(self, current: CurveFit, added: Sequence[tuple[str, ...]], step: str) -> Reductions:
        """Return the candidates' reductions of chi-square from a model, for data and null recordings; the closure is last."""
        fits = [self.model.fit((*current.names, *names), self.measured, current) for names in added]
        data = [*(current.cost - one.cost for one in fits), self.closure_reduction(current)]
        null, refits = np.empty((self.replicates, len(data))), []
        for r in range(self.replicates):
            self.progress(f"{step}: null recording {r + 1} of {self.replicates}")
            y = self.null(current)
            base = self.model.fit(current.names, y, current)
            refits.append(base)
            for i, names in enumerate(added):
                null[r, i] = base.cost - self.model.fit((*current.names, *names), y, base).cost
            null[r, -1] = self.closure_reduction(base)
        scale = 1.0 / self.variance
        every = (*added, (CLOSURE,))
        found = np.maximum(np.array(data), 0.0) * scale
        return Reductions(current, every, tuple(fits), found, np.maximum(null, 0.0) * scale, tuple(refits))

    def closure_reduction(self, fit: CurveFit) -> float:
        """Decrease of the sum of squares by a smooth function of creepage, with the model's parameters free."""
        columns, _ = np.linalg.qr(np.column_stack([_smooth(self.model.creepage), *self.sensitivities(fit).T]))
        return float(np.sum((columns.T @ fit.residual) ** 2))

    def closure_held_out(self, fit: CurveFit) -> float:
        """Decrease of the held-out sum of squares by the closure, over the scatter's variance."""
        basis, fallen = _smooth(self.model.creepage), 0.0
        for fold in range(FOLDS):
            out = self.folds == fold
            found = np.linalg.lstsq(basis[~out], fit.residual[~out], rcond=None)[0]
            fallen += float(np.sum(fit.residual[out] ** 2) - np.sum((fit.residual[out] - basis[out] @ found) ** 2))
        return fallen / self.variance

    def sensitivities(self, fit: CurveFit) -> np.ndarray:
        """Return the derivatives (n, p) of the model by each of its values."""
        columns, adhesion = [], self.adhesion(fit.names, fit.values)
        for i, value in enumerate(fit.values):
            moved = fit.values.copy()
            moved[i] += 1e-4 * max(abs(value), 1e-3)
            columns.append((self.adhesion(fit.names, moved) - adhesion) / (moved[i] - value))
        return np.column_stack(columns)

    def adhesion(self, names: Sequence[str], values: np.ndarray) -> np.ndarray:
        """Return the model's adhesion coefficients at the points (n,) [-]."""
        return self.model.adhesion(float(values[0]), self.model.choice(names, values))

    def held_out(self, fit: CurveFit) -> np.ndarray:
        """Errors (n,) [-] at every point, of the same model fitted to the other blocks of creepage."""
        errors = np.empty(len(self.measured))
        for fold in range(FOLDS):
            out = self.folds == fold
            errors[out] = self.model.fit(fit.names, self.measured, fit, ~out).residual[out]
        return errors

    def multiple(self, with_it: CurveFit, without: CurveFit) -> float:
        """Relative change of adhesion over the smallest of interest; root mean square of lower or upper half of creepages."""
        lower = self.model.creepage <= np.median(self.model.creepage)
        change = (with_it.residual - without.residual) / (self.measured + without.residual)
        return max(float(np.sqrt(np.mean(change[half] ** 2))) for half in (lower, ~lower)) / _INTEREST

    def forward(self) -> tuple[CurveFit, Reductions, Reductions]:
        """Accept candidates, best first; return the model, the reductions from the baseline and those from the model."""
        current, first = self.baseline, None
        while True:
            step = f"round {len(current.names) + 1}"
            singles = [(name,) for name in self.candidates if name not in current.names]
            reductions = self.reductions(current, singles, step)
            first = first or reductions
            better = self._best(reductions)
            if better is None and not current.names:
                better = self._best(self.reductions(current, list(itertools.combinations(self.candidates, 2)), "pairs"))
            if better is None:
                return current, first, reductions
            current = self._settled(better)

    def _settled(self, fit: CurveFit) -> CurveFit:
        """Exchange a mechanism for a better one; each further parameter costs 2 of chi-square (Akaike)."""

        def score(one: CurveFit) -> float:
            return one.cost / self.variance + 2.0 * len(one.values)

        outside = [name for name in self.candidates if name not in fit.names]
        swaps = [tuple(new if one == old else one for one in fit.names) for old in fit.names for new in outside]
        best = min([fit, *(self.model.fit(names, self.measured) for names in swaps)], key=score)
        return fit if best is fit or score(fit) - score(best) < 0.1 else self._settled(best)

    def _best(self, reductions: Reductions) -> CurveFit | None:
        """Return the fit of the candidate with the largest reduction, or None if it is not accepted."""
        if not reductions.fits:
            return None
        i = int(np.argmax(reductions.data[:-1]))
        held_out = [float(np.sum(self.held_out(one) ** 2)) for one in (reductions.fits[i], reductions.current)]
        passes = reductions.probability(i) <= RARE and held_out[0] < held_out[1]
        return reductions.fits[i] if passes and self.multiple(reductions.fits[i], reductions.current) >= 1.0 else None


def _smooth(creepage: np.ndarray) -> np.ndarray:
    """Return orthonormal smooth functions of creepage (n, terms)."""
    logarithm = np.log(creepage)
    span = float(np.ptp(logarithm)) or 1.0
    columns: np.ndarray = np.linalg.qr(chebvander(2.0 * (logarithm - logarithm.min()) / span - 1.0, _DEGREE))[0]
    return columns


def _scatter(model: CreepModel, richest: CurveFit) -> np.ndarray:
    """Scatter (n,) [-] of the points about the richest fit plus a smooth function of creepage for each curve."""
    scatter = np.empty(len(richest.residual))
    for k in range(int(model.curve.max()) + 1):
        here = model.curve == k
        terms = max(1, min(_DEGREE + 1, int(here.sum()) // 3))
        columns = _smooth(model.creepage[here])[:, :terms]
        own = richest.residual[here]
        leverage = np.minimum(np.sum(columns**2, axis=1), 0.9)
        scatter[here] = (own - columns @ (columns.T @ own)) / np.sqrt(1.0 - leverage)
    return scatter
