"""Fits the law and mechanisms to the balances, with all nuisances."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis import candidates
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.gls import Projector, fit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, law_columns
from wsp_env.diagnosis.weights import Weights, free_parameters

TAU = 2e-4  # [m/J] prior median, within a factor e^LOG_TAU; the seed paper's measured rails have 1.9e-4
_ITERATIONS = 20
_CONVERGED = 0.05  # change of the sum of squares that counts for nothing
_LONGEST = 3.0  # longest step that a parabola is believed [of a whole step] (assumption)
_LARGEST_STEP = 0.7  # [-] largest change of log tau or log mu_cd in one iteration
_DAMPINGS = 0.0, 0.01, 0.1, 1.0, 10.0, 100.0  # damping, as shares of a parameter's own square


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A model fitted to some rows."""

    model: Model
    variants: tuple[Variant, ...]
    values: tuple[np.ndarray, ...]  # of each variant's free parameters
    covariance: tuple[np.ndarray, ...]  # of these parameters
    cost: float  # sum of squares after projection off the nuisances, and the determinant of the rows (`Replica.determinant`)


def refit(
    balances: Balances | Replica,
    model: Model,
    variants: Sequence[Variant],
    weights: Weights,
    keep: np.ndarray | None = None,
) -> Fitted:
    """Fit tau, mu_cd and the variants' free parameters, starting from `model` (Levenberg and Marquardt).

    Parameters
    ----------
    keep : (n,) bool, rows to fit to; the weights' projector must be made for the same rows

    """
    keep = np.ones(len(balances.rows), dtype=bool) if keep is None else keep
    state = _State(balances, model, tuple(variants), weights, keep, free_parameters(balances))
    least = 0
    for _ in range(_ITERATIONS):
        system = state.system()
        expected = state.gain(system)
        if expected < _CONVERGED:
            break
        for level in range(least, len(_DAMPINGS)):
            tried = state.after(system, _DAMPINGS[level])
            if tried.cost <= state.cost:
                break
        else:
            break
        # A level that has just failed is tried again only after a step without a failure.
        decrease, state, least = state.cost - tried.cost, tried, level if level > least else max(level - 1, 0)
        # A step that gains nothing ends a fit. A whole step from which the cost decreased as expected of a linear model has
        # reached the best one.
        if decrease < _CONVERGED or (level == 0 and abs(decrease - expected) < _CONVERGED):
            break
    return state.fitted(system)


def cost(balances: Balances | Replica, model: Model, weights: Weights) -> float:
    """Return the sum of squares that a model leaves after projection off the nuisances, as `Fitted.cost`."""
    y = weights(balances.raw(model))[:, None]
    return float(weights.projector.inner(y, y)[0, 0]) + balances.determinant


class _System(NamedTuple):
    """Normal equations of a fit: the variants' columns come first, then those of the law."""

    gram: np.ndarray  # (k, k)
    against: np.ndarray  # (k,) products of the columns with the rows
    columns: np.ndarray  # (n, k) whitened
    steps: np.ndarray  # of the variants' parameters


@dataclasses.dataclass
class _State:
    """The fit at one model: residuals, cost and normal equations."""

    balances: Balances | Replica
    model: Model
    variants: tuple[Variant, ...]
    weights: Weights
    keep: np.ndarray
    moves: np.ndarray  # (1 + runs,) bool, whether tau and mu_cd move

    def __post_init__(self) -> None:
        self.base = self.balances.raw(self.model)
        self.y = self.weights(self.base)[self.keep]
        # Prior of log tau: if other effects change the friction, the likelihood alone may drive tau to a range without effect.
        self.tau = float(np.log(self.model.tau / TAU)) / LOG_TAU * bool(self.moves[0])
        self.cost = self._squares(self.weights.projector)

    def _squares(self, projector: Projector) -> float:
        """Return the sum of squares that is left, with the prior of tau and the determinant of the rows."""
        rows = self.y[:, None]
        return float(projector.inner(rows, rows)[0, 0]) + self.tau**2 + self.balances.determinant

    def at(self, model: Model) -> "_State":
        """Return the same fit at another model."""
        return dataclasses.replace(self, model=model)

    def system(self) -> _System:
        """Return the normal equations."""
        columns, steps = [np.zeros((len(self.base), 0))], [np.zeros(0)]
        for one in self.variants:
            columns.append(candidates.columns(self.balances, self.model, self.base, one))
            steps.append(one.moves())
        law = (law_columns(self.balances, self.model, self.base) * [LOG_TAU, *[MU_CD] * len(self.balances.stops)])[
            :, self.moves
        ]
        white = np.column_stack([self.weights(np.column_stack([*columns, law]))[self.keep], self.y])
        known = self.weights.projector.inner(white, white)
        gram, against = known[:-1, :-1], known[:-1, -1]
        own = sum(len(step) for step in steps)
        gram[np.diag_indices_from(gram)] += self._prior(own, len(gram))
        if self.moves[0]:
            against[own] += self.tau
        return _System(gram, against, white[:, :-1], np.concatenate(steps))

    @staticmethod
    def _prior(own: int, several: int) -> np.ndarray:
        """Return the precisions of the priors: none of the variants' parameters, those of the law."""
        return np.where(np.arange(several) < own, 0.0, 1.0)

    def gain(self, system: _System) -> float:
        """Return the decrease of the cost by an undamped step, if the model were linear."""
        return float(system.against @ self._step(system, 0.0))

    def _step(self, system: _System, damping: float) -> np.ndarray:
        """Return the amplitudes (k,) of a Gauss-Newton step, to be subtracted.

        A parameter that is at a bound and would move beyond it stays there, and the others move as without it (projected Newton
        method, D. P. Bertsekas, SIAM Journal on Control and Optimization 20, 1982).
        """
        steps, damped = system.steps, system.gram + damping * np.diag(np.diag(system.gram))
        amplitude, free = fit(damped, system.against).amplitude, np.ones(len(damped), dtype=bool)
        while (beyond := self._beyond(-amplitude[: len(steps)] * steps)).any():
            free[: len(steps)] &= ~beyond
            amplitude = np.zeros(len(damped))
            amplitude[free] = fit(damped[np.ix_(free, free)], system.against[free]).amplitude
        return amplitude

    def after(self, system: _System, damping: float) -> "_State":
        """Return the fit after a Gauss-Newton step, or after the share of it to which the parabola through its cost leads.

        Where residuals stay large, the curvature of the model counts, too: each whole step is too long, or too short.
        """
        amplitude = self._step(system, damping)
        whole, slope = self.at(self._moved(system.steps, amplitude)), float(system.against @ amplitude)
        decrease = self.cost - whole.cost
        curvature = 2.0 * slope - decrease
        if slope <= 0.0 or curvature <= 0.0 or slope**2 / curvature - decrease < _CONVERGED:
            return whole
        share = min(slope / curvature, _LONGEST)
        return min(whole, self.at(self._moved(system.steps, share * amplitude)), key=lambda one: one.cost)

    def _moved(self, steps: np.ndarray, amplitude: np.ndarray) -> Model:
        """Return the model after a step of amplitudes (k,); a long step is shortened in its direction."""
        highest = 0.9 * self.balances.campaign.contact.kinetic_friction_r
        change, step = -amplitude[: len(steps)] * steps, np.zeros(len(self.moves))
        step[self.moves] = -amplitude[len(steps) :]
        step *= [LOG_TAU, *[MU_CD] * (len(step) - 1)]
        share = min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        mu = tuple(float(min(m * np.exp(share * x), highest)) for m, x in zip(self.model.mu_cd, step[1:], strict=True))
        found = dataclasses.replace(self.model, tau=self.model.tau * float(np.exp(share * step[0])), mu_cd=mu)
        first = 0
        for one in self.variants:
            values = candidates.values_in(self.model, one) + share * change[first : first + len(one.sizes)]
            first += len(one.sizes)
            found = candidates.switched(found, one, values)
        return found

    def _beyond(self, change: np.ndarray) -> np.ndarray:
        """Return which of the variants' parameters (k,) are at a bound that a change (k,) exceeds."""
        found = []
        for one in self.variants:
            ends = [candidates.parameter_of(one.name, name) for name in one.sizes]
            values = candidates.values_in(self.model, one)
            found += [(value <= end.low, value >= end.high) for value, end in zip(values, ends, strict=True)]
        at = np.array(found, dtype=bool).reshape(-1, 2)
        result: np.ndarray = (at[:, 0] & (change < 0.0)) | (at[:, 1] & (change > 0.0))
        return result

    def fitted(self, system: _System) -> Fitted:
        """Return the fit, with the covariances at the beginning of the last step, which is small unless iterations ran out."""
        covariances = []
        if self.variants:
            steps, gram = system.steps, system.gram
            if self.weights.whole is not None:
                gram = self.weights.whole.inner(system.columns, system.columns)
                gram[np.diag_indices_from(gram)] += self._prior(len(steps), len(gram))
            whole = fit(gram, system.against).covariance[: len(steps), : len(steps)] * np.outer(steps, steps)
            first = 0
            for one in self.variants:
                part = slice(first, first + len(one.sizes))
                covariances.append(whole[part, part])
                first += len(one.sizes)
        return Fitted(
            self.model,
            self.variants,
            tuple(candidates.values_in(self.model, one) for one in self.variants),
            tuple(covariances),
            self._squares(self.weights.whole) if self.weights.whole is not None else self.cost,
        )
