"""Weights of the balances' rows: noise, and nuisances of given sizes."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.balances import Balances, Whitening
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Group, whitened

_LEAST_ROWS = 20  # blocks of sliding that are needed to estimate a run's friction


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weights of the residuals: noise, and nuisances of given sizes."""

    whitening: Whitening
    noise: np.ndarray  # (n,) factor on each row's standard deviation
    projector: Projector  # removes all nuisances except the law's parameters
    constant: float = 0.0  # -2 log likelihood less the sum of squares, without the channels' own noise
    whole: Projector | None = None  # with all nuisances, if the best fit is sought without some of them

    def deviance(self, cost: float) -> float:
        """Return -2 log likelihood of a fit with a cost (`Fitted.cost`), without the terms of the channels' own noise.

        Where a wheel is on the creep curve, each row has a true slip of its own to estimate. Its noise then has no determinant
        term (functional relation with errors in variables, A. Villegas, Annals of Mathematical Statistics 32, 1961).
        """
        return cost + self.constant

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


def sliding(balances: Balances | Replica) -> np.ndarray:
    """Mask (runs,) of runs that slide enough to determine their friction."""
    rows = balances.rows
    return np.bincount(rows.run[rows.slides], minlength=len(balances.stops)) >= _LEAST_ROWS


def free_parameters(balances: Balances | Replica) -> np.ndarray:
    """Mask (1 + runs,) of the law's parameters that a refit moves: tau, mu_cd of each run. Without slides the prior holds."""
    slides = sliding(balances)
    return np.array([bool(slides.any()), *slides])
