"""Fits the baseline and its extensions to the balances, with all nuisances."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from wsp_env.diagnosis import candidates
from wsp_env.diagnosis.balances import ADHESION, Balances
from wsp_env.diagnosis.candidates import Variant, choice_of
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.gls import LeastSquares, Projector, fit
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, nuisances, unresolved

_TAU_START = 2e-4  # [m/J]
_ITERATIONS = 8
_LARGEST_STEP = 0.7  # [-] change of log tau or log mu_cd in one iteration
_HALVINGS = 4
_NEAR = 1.0  # mean square of the residuals' change, in deviations, within which the nuisances count as the same
_LITTLE = 0.02  # share of a mechanism that is taken as linear
_LEAST_ROWS = 20  # blocks of sliding that say something on a run's friction


@dataclasses.dataclass(frozen=True)
class Weights:
    """What residuals are compared with."""

    deviation: np.ndarray  # (n,)
    bias: np.ndarray  # (n,) what smoothing and noise leave on average in null recordings

    def __call__(self, raw: np.ndarray) -> np.ndarray:
        """Return residuals (n,) whitened."""
        result: np.ndarray = (raw - self.bias) / self.deviation
        return result


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A model fitted to some rows."""

    model: Model
    variants: tuple[Variant, ...]
    values: tuple[np.ndarray, ...]  # of each variant's free parameters
    covariance: tuple[np.ndarray, ...]  # of the same
    cost: float  # sum of squares with the nuisances' best part taken away, and what is due to noise in the columns


def baseline(balances: Balances) -> tuple[Model, Weights]:
    """LeastSquares tau and mu_cd of every run; returns the deviations by noise too, without bias."""
    model = Model(_TAU_START, tuple(stop.believed_mu_cd for stop in balances.stops))
    for _ in range(2):  # the deviations depend on the law, a little
        base = balances.raw(model)
        friction = nuisances(balances, model, base).friction
        weights = Weights(np.hypot(balances.deviation(model), unresolved(friction)), np.zeros(len(base)))
        model = refit(balances, model, (), weights).model
    return model, weights


def sliding(balances: Balances) -> np.ndarray:
    """Which runs (runs,) slide enough to show their friction."""
    rows = balances.rows
    slides = (rows.balance == ADHESION) & (rows.slip > 0.01 * rows.speed)
    return np.bincount(rows.run[slides], minlength=len(balances.stops)) >= _LEAST_ROWS


def refit(
    balances: Balances,
    model: Model,
    variants: Sequence[Variant],
    weights: Weights,
    keep: np.ndarray | None = None,
    free_law: bool = True,
    tilts: Sequence[np.ndarray] = (),
) -> Fitted:
    """LeastSquares tau, mu_cd and the free parameters of the variants from where `model` is, by Gauss and Newton.

    Parameters
    ----------
    keep : (n,) bool, rows to fit to
    free_law : whether tau moves; mu_cd of a run always does
    tilts : for every variant the mean inner product of its columns with the residual in null recordings (zeros: none). Columns
        and residual share their noise, so that without it a fit to noise would explain something.

    """
    keep = np.ones(len(balances.rows), dtype=bool) if keep is None else keep
    slides = sliding(balances)
    moves = np.array([free_law and bool(slides.any()), *slides])
    state = _State(balances, model, variants, weights, keep, tilts, moves)
    for _ in range(_ITERATIONS):
        move = state.newton()
        for halving in range(_HALVINGS):
            tried = _State(balances, move(0.5**halving), variants, weights, keep, tilts, moves, state)
            if tried.cost <= state.cost:
                break
        else:
            break
        better, state = state.cost - tried.cost, tried
        if better < 0.05:
            break
    return state.fitted()


class _State:
    """The fit at one model: its cost has the nuisances' best part taken away, but for the law's parameters that move."""

    def __init__(
        self,
        balances: Balances,
        model: Model,
        variants: Sequence[Variant],
        weights: Weights,
        keep: np.ndarray,
        tilts: Sequence[np.ndarray],
        moves: np.ndarray,
        before: "_State | None" = None,
    ) -> None:
        self.balances, self.model, self.variants, self.weights, self.keep = balances, model, tuple(variants), weights, keep
        self.base = balances.raw(model)
        self.y = weights(self.base)[keep]
        if before is None or np.mean((self.y - before.origin) ** 2) > _NEAR:
            self.origin: np.ndarray = self.y
            found = nuisances(balances, model, self.base)
            white = (found.columns / weights.deviation[:, None])[keep]
            names = np.array(found.names)
            law = np.zeros(len(names), dtype=bool)
            law[np.concatenate([np.flatnonzero(names == "tau"), np.flatnonzero(names == "mu_cd")])[moves]] = True
            self.law: np.ndarray = white[:, law]
            self.projector = Projector(white[:, ~law], found.prior[~law])
        else:  # they change little on the way
            self.law, self.projector, self.origin = before.law, before.projector, before.origin
        self.moves = moves  # (1 + runs,) whether tau and mu_cd move
        self.tilts = tilts if len(tilts) else [np.zeros(len(one.sizes)) for one in self.variants]
        self.cost = float(self.projector.inner(self.y[:, None], self.y[:, None])[0, 0])
        self.cost -= 2.0 * sum(self._noise(one, tilt) for one, tilt in zip(self.variants, self.tilts, strict=True))

    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        found = [candidates.columns(self.balances, self.model, self.base, one) for one in self.variants]
        matrix = np.column_stack([columns for columns, _ in found]) / self.weights.deviation[:, None]
        return matrix[self.keep], np.array([step for _, steps in found for step in steps])

    def _solve(self) -> tuple[LeastSquares, np.ndarray]:
        """LeastSquares the variants' columns and those of the law's parameters that move; returns the variants' steps too."""
        columns, steps, tilt = np.zeros((len(self.y), 0)), np.zeros(0), np.zeros(0)
        if self.variants:
            columns, steps = self._columns()
            tilt = np.concatenate(self.tilts)
        columns, law = np.column_stack([columns, self.law]), self.law.shape[1]
        gram, against = self.projector.inner(columns, columns), self.projector.inner(columns, self.y[:, None])[:, 0]
        gram[np.diag_indices_from(gram)] += np.concatenate([np.zeros(len(steps)), np.ones(law)])  # their priors
        return fit(gram, against - np.concatenate([tilt, np.zeros(law)])), steps

    def newton(self) -> Callable[[float], Model]:
        """Return the function that moves a share of the step."""
        found, steps = self._solve()
        change = -found.amplitude[: len(steps)] * steps
        step = np.zeros(len(self.moves))
        step[self.moves] = -found.amplitude[len(steps) :]
        step = np.clip(step * [LOG_TAU, *[MU_CD] * (len(step) - 1)], -_LARGEST_STEP, _LARGEST_STEP)
        highest = 0.9 * self.balances.campaign.contact.kinetic_friction_r

        def moved(share: float) -> Model:
            mu = tuple(float(min(m * np.exp(share * x), highest)) for m, x in zip(self.model.mu_cd, step[1:], strict=True))
            choice = dict(self.model.choice)
            first = 0
            for one in self.variants:
                values = self._values(one) + share * change[first : first + len(one.sizes)]
                first += len(one.sizes)
                choice |= choice_of(one, values)
            return Model(self.model.tau * float(np.exp(share * step[0])), mu, choice)

        return moved

    def _noise(self, variant: Variant, tilt: np.ndarray) -> float:
        """Mean inner product of what a variant changes with the residual in null recordings."""
        if not tilt.any():
            return 0.0
        values, steps = self._values(variant), np.array([candidates.step(variant.name, name)[1] for name in variant.sizes])
        null = self._nulls(variant)
        linear = float(tilt @ ((values - null) / steps * (tilt != 0.0)))
        if linear == 0.0:
            return 0.0

        def raw(share: float) -> np.ndarray:
            choice = choice_of(variant, np.where(tilt != 0.0, null + share * (values - null), values))
            return self.balances.raw(dataclasses.replace(self.model, choice={**self.model.choice, **choice}))

        # It grows with the size until the change itself does not any more.
        none = raw(0.0)
        changes = ((self.base - none, 1.0), (raw(_LITTLE) - none, _LITTLE))
        whole, little = (float(np.linalg.norm((c / self.weights.deviation)[self.keep])) / share for c, share in changes)
        return linear * min(whole / max(little, 1e-12), 1.0)

    def _nulls(self, variant: Variant) -> np.ndarray:
        return np.array([candidates.parameter_of(variant.name, name).null for name in variant.sizes])

    def _values(self, variant: Variant) -> np.ndarray:
        present = self.model.choice.get(variant.name, {})
        return np.array([present.get(name, candidates.parameter_of(variant.name, name).null) for name in variant.sizes])

    def fitted(self) -> Fitted:
        covariances = []
        if self.variants:
            found, steps = self._solve()
            whole = found.covariance[: len(steps), : len(steps)] * np.outer(steps, steps)
            first = 0
            for one in self.variants:
                part = slice(first, first + len(one.sizes))
                covariances.append(whole[part, part])
                first += len(one.sizes)
        return Fitted(self.model, self.variants, tuple(map(self._values, self.variants)), tuple(covariances), self.cost)
