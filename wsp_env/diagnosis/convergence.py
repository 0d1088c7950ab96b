"""Iterates replicas of an extended model until the model fitted to a replica equals the model of this replica.

Effects of mechanisms are nonlinear: about the baseline they are linear only for small sizes.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import replica_of
from wsp_env.diagnosis.candidates import Variant, parameter_of, switched, values_in
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, refit
from wsp_env.diagnosis.noise import NoiseParameters, noise_of
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.weights import Weights, weigh

#: Least and largest number of replicas, each made from the fit to the previous one. The first may be far from the recordings;
#: after a change of wheel radius of a per cent, the second too.
_REPLICAS = 2, 8
#: Change of a size between replicas, in standard deviations, below which it has converged.
_CONVERGED = 0.5
#: Largest ratio of last to first change at which the iteration counts as converging: if the changes are not halved within the
#: largest number of replicas, it does not converge (assumption).
_CONTRACTION = 0.5
#: Standard deviations of a sum of squares by which a model must fit worse than another (assumption: by chance, this happens
#: once in a thousand).
WORSE = 3.0
#: Largest numbers of estimates of the nuisance sizes about the law alone, and of replicas under each of them.
_SIZE_ESTIMATES, _LAW_REPLICAS = 2, 4
#: Relative change of tau and mu_cd at which the law alone has converged: it moves a stop by some 0.1 % (assumption).
_LAW_CONVERGED = 0.01


class _Iterate(NamedTuple):
    """A replica, the fit from which it was made, and the model fitted to it."""

    replica: Replica
    about: Fitted
    fitted: Fitted


def converge_law(replica: Replica, start: Sizes | None = None) -> tuple[Replica, NoiseParameters]:
    """Return a replica about the law fitted with nuisance sizes estimated from the recordings, and what is known of the noise.

    With other sizes, the likeliest tau differs, and a replica about another law has other residuals. A mechanism is compared on
    its own replica. If the law alone has not converged, every mechanism is compared with a replica that does not fit.

    Parameters
    ----------
    start : as for `noise_of`

    """
    noise_parameters: NoiseParameters | None = None
    for _ in range(_SIZE_ESTIMATES):
        begun = replica.baseline
        noise = noise_of(replica, begun, replica.raw(begun), start=noise_parameters.sizes if noise_parameters else start)
        noise_parameters, weights = noise.parameters, weigh(replica, noise.whitening, noise.groups, noise.sizes)
        for _ in range(_LAW_REPLICAS):
            before = replica.baseline
            replica = Replica(replica.recorded, refit(replica, before, (), weights).model)
            if _law_change(before, replica.baseline) < _LAW_CONVERGED:
                break
        if _law_change(begun, replica.baseline) < _LAW_CONVERGED:
            break
    assert noise_parameters is not None
    return replica, noise_parameters


def _law_change(before: Model, after: Model) -> float:
    """Return the largest relative change of tau and mu_cd."""
    old, new = (np.log([one.tau, *one.mu_cd]) for one in (before, after))
    return float(np.max(np.abs(new - old)))


def converge(recorded: Balances, fitted: Fitted, weights: Weights) -> tuple[Replica, Fitted]:
    """Return the replica of an extended model and the model fitted to it, with infinite cost if it does not converge.

    If a replica fits the recordings worse than the best one before, the step to it is halved.
    """
    changes: list[float] = []
    last, least = None, np.inf
    for made in range(1, _REPLICAS[1] + 1):
        replica = replica_of(recorded, fitted.model, weights)
        one = _Iterate(replica, fitted, refit(replica, fitted.model, fitted.variants, weights))
        if last is not None and fits_worse(one.fitted.cost, least, len(replica.rows)):
            if largest_change(last.about, fitted) < _CONVERGED:
                break
            fitted = midpoint(last.about, fitted)
            continue
        last, fitted, least = one, one.fitted, min(least, one.fitted.cost)
        changes.append(largest_change(one.about, fitted))
        if made >= _REPLICAS[0] and changes[-1] < _CONVERGED:
            return replica, fitted
    assert last is not None
    if len(changes) < made:  # the steps beyond this replica fit worse
        return last.replica, _law_fit(last, weights)
    contracts = changes[-1] < _CONTRACTION * changes[0]
    return last.replica, fitted if contracts else dataclasses.replace(fitted, cost=np.inf)


def midpoint(near: Fitted, far: Fitted) -> Fitted:
    """Return the midpoint of two fits, from which the next replica is made."""
    tau, mu_cd = 0.5 * (near.model.tau + far.model.tau), 0.5 * (np.array(near.model.mu_cd) + np.array(far.model.mu_cd))
    model = dataclasses.replace(far.model, tau=tau, mu_cd=tuple(mu_cd.tolist()))
    values = tuple(0.5 * (one + other) for one, other in zip(near.values, far.values, strict=True))
    for variant, each in zip(far.variants, values, strict=True):
        model = switched(model, variant, each)
    return dataclasses.replace(far, model=model, values=values)


def _law_fit(iterate: _Iterate, weights: Weights) -> Fitted:
    """Return the fit of the law alone, with the mechanisms as they are in the replica."""
    law = refit(iterate.replica, iterate.about.model, (), weights)
    return dataclasses.replace(iterate.fitted, model=law.model, values=iterate.about.values, cost=law.cost)


def fits_worse(cost: float, other: float, rows: int, deviations: float = WORSE) -> bool:
    """Whether a model on its own replica has a larger cost than another one on its own, by more than sums of squares scatter.

    On its own replica, any model is right by construction. The evidence there does not show a diverged mechanism, the fit does.
    """
    return cost > other + deviations * float(np.sqrt(2.0 * rows))


def moves(before: Fitted, after: Fitted) -> np.ndarray:
    """Return the changes (1 + k,) of all mechanisms' parameters between two fits, in standard deviations, after a 0."""
    return np.concatenate([np.zeros(1)] + [
        (new - old) / np.sqrt(np.maximum(np.diag(spread), 1e-300))
        for new, old, spread in zip(after.values, before.values, after.covariance, strict=True)
    ])  # fmt: skip


def largest_change(before: Fitted, after: Fitted) -> float:
    """Return the largest change of a mechanism's parameters between two fits, in standard deviations."""
    return float(np.abs(moves(before, after)).max())


def rescaled(recorded: Balances, fitted: Fitted, variant: Variant, weights: Weights, shares: Sequence[float]) -> Fitted:
    """Return a model fitted on that replica of its own, with a share of a mechanism's size, on which it fits best.

    The shares are tried one after the other, as long as each fits better than the one before.
    """
    others = [one for one in fitted.variants if one != variant]
    best: tuple[Fitted, Replica] | None = None
    for share in shares:
        model = switched(fitted.model, variant, _scaled(variant, values_in(fitted.model, variant), share))
        replica = replica_of(recorded, model, weights)
        tried = refit(replica, model, others, weights)
        if best and tried.cost >= best[0].cost:
            break
        best = tried, replica
    assert best is not None
    return refit(best[1], best[0].model, fitted.variants, weights)


def _scaled(variant: Variant, values: np.ndarray, share: float) -> np.ndarray:
    """Return the values (k,) with the sizes scaled by a share; parameters that locate the mechanism are unchanged."""
    null = variant.null()
    size = np.array([parameter_of(variant.name, name).kind == "size" for name in variant.sizes])
    result: np.ndarray = np.where(size, null + share * (values - null), values)
    return result
