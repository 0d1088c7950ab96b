"""Fits the law and mechanisms to the balances, with all nuisances."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis import candidates
from wsp_env.diagnosis.balances import Balances, Whitening
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.gls import Projector, fit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, Group, law_columns, nuisances, whitened

TAU = 2e-4  # [m/J] prior median, within a factor e^LOG_TAU; the seed paper's measured rails have 1.9e-4
_ITERATIONS = 20
_CONVERGED = 0.05  # change of the sum of squares that counts for nothing
_LONGEST = 3.0  # longest step that a parabola is believed [of a whole step] (assumption)
_LARGEST_STEP = 0.7  # [-] largest change of log tau or log mu_cd in one iteration
_DAMPINGS = 0.0, 0.01, 0.1, 1.0, 10.0, 100.0  # damping, as shares of a parameter's own square
_LEAST_ROWS = 20  # blocks of sliding that are needed to estimate a run's friction
#: Quantile of the adhesion of wheels that grip, and the largest multiple of it that is tried as friction of their rail
#: (assumptions); numbers of values that are tried, and of finer grids.
_GRIPPED, _MOST_GRIP, _TRIED, _FINER = 0.95, 1.5, 13, 3


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weights of the residuals: noise, and nuisances of given sizes."""

    whitening: Whitening
    noise: np.ndarray  # (n,) factor on each row's standard deviation
    projector: Projector  # removes all nuisances except the law's parameters
    constant: float = 0.0  # -2 log likelihood less the sum of squares, without the channels' own noise
    whole: Projector | None = None  # with all nuisances, if the best fit is sought without some of them

    def deviance(self, fitted: "Fitted") -> float:
        """Return -2 log likelihood of a fit, without the terms of the channels' own noise.

        Where a wheel is on the creep curve, each row has a true slip of its own to estimate. Its noise then has no determinant
        term (functional relation with errors in variables, A. Villegas, Annals of Mathematical Statistics 32, 1961).
        """
        return fitted.cost + self.constant

    def beside(self, columns: np.ndarray) -> "Weights":
        """Return the same with a few further nuisances (n, k), scaled by their standard deviations."""
        projector = self.projector.beside(self(columns))
        return dataclasses.replace(self, projector=projector, constant=self.constant + projector.logdet - self.projector.logdet)

    def freed(self, columns: np.ndarray) -> "Weights":
        """Return the same without some of the nuisances (n, k), scaled by their standard deviations, to seek the best fit.

        They are small sizes of the mechanisms that are fitted. As these may have any size, they change no fit of a linear
        effect. About another size of a nonlinear effect they are no size of it, but another form, and keep the fit where it
        begins. The fit's cost and covariances contain them, so that it can be compared with fits of other mechanisms.
        """
        if not columns.shape[1]:
            return self
        return dataclasses.replace(self, projector=self.projector.without(self(columns)), whole=self.projector)

    def __call__(self, raw: np.ndarray) -> np.ndarray:
        """Return rows (n,) or (n, k) whitened."""
        white = self.whitening(raw)
        result: np.ndarray = white / (self.noise if raw.ndim == 1 else self.noise[:, None])
        return result


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A model fitted to some rows."""

    model: Model
    variants: tuple[Variant, ...]
    values: tuple[np.ndarray, ...]  # of each variant's free parameters
    covariance: tuple[np.ndarray, ...]  # of these parameters
    cost: float  # sum of squares after projection off the nuisances, and the determinant of the rows (`Replica.determinant`)


def weigh(
    balances: Balances | Replica, whitening: Whitening, groups: Sequence[Group], sizes: Sizes | None = None
) -> Weights:  # fmt: skip
    """Return the weights of all rows for given sizes of groups and noise; None: the expected ones."""
    return Weighing(balances, whitening, groups, sizes)(None)


def weights_from(
    balances: Balances | Replica, whitening: Whitening, groups: Sequence[Group], sizes: Sizes, evidence: Evidence
) -> Weights:  # fmt: skip
    """Return the same weights of all rows, computed from the inner products of rows and `groups`."""
    kept = np.concatenate([left_to_weights(balances, group) for group in groups])
    return _weights(whitening, sizes.noise[balances.rows.noise], evidence.projector(sizes, kept))


class Weighing:
    """Weights of some rows, for given sizes of groups and noise; None: the expected ones."""

    def __init__(
        self, balances: Balances | Replica, whitening: Whitening, groups: Sequence[Group], sizes: Sizes | None = None
    ) -> None:  # fmt: skip
        self._whitening = whitening
        self._noise = np.ones(len(balances.rows)) if sizes is None else sizes.noise[balances.rows.noise]
        groups = [group._replace(columns=group.columns[:, left_to_weights(balances, group)]) for group in groups]
        self._columns = whitened(groups, whitening, balances.rows.run, self._noise, None if sizes is None else sizes.groups)

    def __call__(self, keep: np.ndarray | None) -> Weights:
        """Return the weights of the rows `keep` (n,) bool; None: all."""
        columns = self._columns if keep is None else self._columns.kept(keep)
        return _weights(self._whitening, self._noise, Projector.of(columns, np.ones(columns.width, dtype=bool)), keep)


def _weights(whitening: Whitening, noise: np.ndarray, projector: Projector, keep: np.ndarray | None = None) -> Weights:
    """Return weights with the constant of their deviance."""
    scale = noise if whitening.colour is None else noise / whitening.colour.diagonal()
    constant = 2.0 * float(np.log(scale if keep is None else scale[keep]).sum()) + projector.logdet
    return Weights(whitening, noise, projector, constant)


def left_to_weights(balances: Balances | Replica, group: Group) -> np.ndarray:
    """Mask (k,) of a group's columns that a refit does not fit; mu_cd of a run that hardly slides stays a nuisance."""
    if group.name not in ("tau", "mu_cd"):
        return np.ones(group.columns.shape[1], dtype=bool)
    free = free_parameters(balances)
    run = balances.rows.run[(group.columns != 0.0).argmax(axis=0)]  # of each column; each mu_cd belongs to one run
    result: np.ndarray = ~(np.repeat(free[:1], len(run)) if group.name == "tau" else free[1 + run])
    return result


def baseline(recorded: Balances) -> Replica:
    """Fit tau and mu_cd of every run to the recordings; return the replica at these values.

    `wsp_env.diagnosis.convergence.converge_law` fits them to replicas.
    """
    model = _as_gripped(recorded, Model(TAU, tuple(stop.believed_mu_cd for stop in recorded.stops)))
    whitening = recorded.whitening(model)
    groups = nuisances(recorded, model, recorded.raw(model), whitening)
    return Replica(recorded, refit(recorded, model, (), weigh(recorded, whitening, groups)).model)


def _as_gripped(recorded: Balances, model: Model) -> Model:
    """Return a model with the likeliest friction in runs without slides in which the wheels' forces exceed what is believed.

    Without slides mu_cd stays as it is believed. But a rail may have been dry, unlike the others of a campaign: its wheels
    grip with more than the friction that is believed.
    """
    slides = sliding(recorded)
    believed, needed = np.array(model.mu_cd), np.zeros(len(recorded.stops))
    for i, (part, one) in enumerate(zip(recorded.parts, recorded.evaluate(model), strict=True)):
        if not slides[i] and part.used.any():
            needed[i] = np.quantile(part.wheel_rows(one.force / (2.0 * one.load)), _GRIPPED)
    lifted = needed > believed
    low, high = np.log(believed), np.log(np.where(lifted, _MOST_GRIP * needed, believed))
    for _ in range(_FINER if lifted.any() else 0):
        grid = np.linspace(low, high, _TRIED)
        best = np.argmin([_surprise(recorded, dataclasses.replace(model, mu_cd=tuple(np.exp(one)))) for one in grid], axis=0)
        low, high = (grid[np.clip(best + side, 0, _TRIED - 1), np.arange(len(believed))] for side in (-1, 1))
    mu_cd = np.where(lifted, np.exp(0.5 * (low + high)), believed)
    return dataclasses.replace(model, mu_cd=tuple(mu_cd.tolist()))


def _surprise(recorded: Balances, model: Model) -> np.ndarray:
    """Return -2 log likelihood (runs,) of the wheels' rows under the channels' own noise, without a constant."""
    whitening, rows = recorded.whitening(model), recorded.rows
    each = rows.wheels * (whitening(recorded.raw(model)) ** 2 + 2.0 * np.log(whitening.deviation))
    return np.bincount(rows.run, weights=each, minlength=len(recorded.stops))


def replica_of(recorded: Balances, model: Model, weights: Weights) -> Replica:
    """Return the replica of a model with mechanisms, whose effect has the share of the unpredicted part that fits best.

    The share is between 0 and 1. It is estimated anew for each replica, and never by a refit.
    """
    replica = Replica(recorded, model)
    if replica.unpredicted is None:
        return replica
    rows = weights(np.column_stack([replica.raw(replica.about), replica.unpredicted]))
    known = weights.projector.inner(rows, rows)
    return replica.without(float(np.clip(known[0, 1] / max(known[1, 1], np.finfo(float).tiny), 0.0, 1.0)))


def sliding(balances: Balances | Replica) -> np.ndarray:
    """Mask (runs,) of runs that slide enough to determine their friction."""
    rows = balances.rows
    return np.bincount(rows.run[rows.slides], minlength=len(balances.stops)) >= _LEAST_ROWS


def free_parameters(balances: Balances | Replica) -> np.ndarray:
    """Mask (1 + runs,) of the law's parameters that a refit moves: tau, mu_cd of each run. Without slides the prior holds."""
    slides = sliding(balances)
    return np.array([bool(slides.any()), *slides])


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
        decrease, state, least = state.cost - tried.cost, tried, max(level - 1, 0)
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
