"""The law alone fitted to the recordings, and replicas that fit them best."""

import dataclasses

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import TAU, refit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import Weights, sliding, weigh

#: Quantile of the adhesion of wheels that grip, and the largest multiple of it that is tried as friction of their rail
#: (assumptions); numbers of values that are tried, and of finer grids.
_GRIPPED, _MOST_GRIP, _TRIED, _FINER = 0.95, 1.5, 13, 3


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
