"""Fits the baseline and its extensions to the balances, with all nuisances."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis import candidates
from wsp_env.diagnosis.balances import ADHESION, Balances
from wsp_env.diagnosis.candidates import Variant, choice_of
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.gls import Projector, fit
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, Nuisances, nuisances, unresolved
from wsp_env.plant.mechanisms import ALL

_TAU_START = 2e-4  # [m/J]
_ITERATIONS = 5
_LARGEST_STEP = 0.7  # [-] change of log tau or log mu_cd in one iteration
_HALVINGS = 4
_NEAR = 1.0  # mean square of the residuals' change, in deviations, within which the nuisances count as the same
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
    """Fit tau and mu_cd of every run; returns the deviations by noise too, without bias."""
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
    """Fit tau, mu_cd and the free parameters of the variants from where `model` is, by Gauss and Newton.

    Parameters
    ----------
    keep : (n,) bool, rows to fit to
    free_law : whether tau moves; mu_cd of a run always does
    tilts : for every variant the mean inner product of its columns with the residual in null recordings (zeros: none). Columns
        and residual share their noise, so that without it a fit to noise gains.

    """
    keep = np.ones(len(balances.rows), dtype=bool) if keep is None else keep
    slides = sliding(balances)
    state = _State(balances, model, variants, weights, keep, tilts)
    for _ in range(_ITERATIONS):
        move = state.newton(slides, free_law)
        for halving in range(_HALVINGS):
            tried = _State(balances, move(0.5**halving), variants, weights, keep, tilts, state)
            if tried.cost <= state.cost:
                break
        else:
            break
        better, state = state.cost - tried.cost, tried
        if better < 0.05:
            break
    return state.fitted()


class _State:
    """The fit at one model."""

    def __init__(
        self,
        balances: Balances,
        model: Model,
        variants: Sequence[Variant],
        weights: Weights,
        keep: np.ndarray,
        tilts: Sequence[np.ndarray],
        before: "_State | None" = None,
    ) -> None:
        self.balances, self.model, self.variants, self.weights, self.keep = balances, model, tuple(variants), weights, keep
        self.base = balances.raw(model)
        self.y = weights(self.base)[keep]
        if before is None or np.mean((self.y - before.origin) ** 2) > _NEAR:
            self.origin: np.ndarray = self.y
            self.nuisances: Nuisances = nuisances(balances, model, self.base)
            self.projector = Projector((self.nuisances.columns / weights.deviation[:, None])[keep], self.nuisances.prior)
        else:  # they change little on the way
            self.nuisances, self.projector, self.origin = before.nuisances, before.projector, before.origin
        self.tilt = np.concatenate(tilts) if len(tilts) else np.zeros(sum(len(one.sizes) for one in self.variants))
        moved = [self._moved(one) for one in self.variants]
        self.cost = float(self.projector.inner(self.y[:, None], self.y[:, None])[0, 0])
        self.cost -= 2.0 * float(self.tilt @ np.concatenate(moved)) if moved else 0.0

    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        found = [candidates.columns(self.balances, self.model, self.base, one) for one in self.variants]
        matrix = np.column_stack([columns for columns, _ in found]) / self.weights.deviation[:, None]
        return matrix[self.keep], np.array([step for _, steps in found for step in steps])

    def newton(self, slides: np.ndarray, free_law: bool):  # type: ignore[no-untyped-def]  # a closure, typed by its use
        """Return the function that moves a share of the step."""
        y, change = self.y, np.zeros(0)
        if self.variants:
            columns, steps = self._columns()
            found = fit(self.projector.inner(columns, columns), self.projector.inner(columns, y[:, None])[:, 0] - self.tilt)
            y = y - columns @ found.amplitude
            change = -found.amplitude * steps
        amplitudes = self.projector.amplitudes(-y)
        names = np.array(self.nuisances.names)
        log_tau = float(np.clip(amplitudes[names == "tau"][0] * LOG_TAU, -_LARGEST_STEP, _LARGEST_STEP))
        log_mu = np.clip(amplitudes[names == "mu_cd"] * MU_CD, -_LARGEST_STEP, _LARGEST_STEP) * slides
        if not (free_law and slides.any()):
            log_tau = 0.0
        highest = 0.9 * self.balances.campaign.contact.kinetic_friction_r

        def moved(share: float) -> Model:
            mu = tuple(float(min(m * np.exp(share * x), highest)) for m, x in zip(self.model.mu_cd, log_mu, strict=True))
            choice = dict(self.model.choice)
            first = 0
            for one in self.variants:
                values = self._values(one) + share * change[first : first + len(one.sizes)]
                first += len(one.sizes)
                choice |= choice_of(one, values)
            return Model(self.model.tau * float(np.exp(share * log_tau)), mu, choice)

        return moved

    def _moved(self, variant: Variant) -> np.ndarray:
        """How many steps the free parameters are from their null; 0 for those that say where."""
        steps = [candidates.step(variant.name, name) for name in variant.sizes]
        null = np.array([null for null, _ in steps])
        result: np.ndarray = (self._values(variant) - null) / np.array([change for _, change in steps])
        return result

    def _values(self, variant: Variant) -> np.ndarray:
        present = self.model.choice.get(variant.name, {})
        nulls = {parameter.name: parameter.null for parameter in ALL[variant.name].parameters}
        return np.array([present.get(name, nulls[name]) for name in variant.sizes])

    def fitted(self) -> Fitted:
        covariances = []
        if self.variants:
            columns, steps = self._columns()
            found = fit(self.projector.inner(columns, columns), np.zeros(len(steps)))
            whole = found.covariance * np.outer(steps, steps)
            first = 0
            for one in self.variants:
                part = slice(first, first + len(one.sizes))
                covariances.append(whole[part, part])
                first += len(one.sizes)
        return Fitted(self.model, self.variants, tuple(map(self._values, self.variants)), tuple(covariances), self.cost)
