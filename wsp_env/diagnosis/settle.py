"""Makes replicas about an extended model, until the model fitted to the last one is the model that it was made about.

What a mechanism does bends: about the baseline it is linear over a part of its size only.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant, parameter_of, switched, values_in
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.replica import Replica

#: Replicas that are made, each about the fit to the one before: the first may be far from the recordings, and of a wheel that
#: is turned by a per cent so may the second. At least, and at most.
_REPLICAS = 2, 8
#: Deviations by which a size still moves from replica to replica, below which it has settled.
_SETTLED = 0.5
#: Share of the first move that the last one is at most where it comes to rest: a move that is not halved in so many has none
#: (assumption).
_COMES_TO_REST = 0.5
#: Deviations of a sum of squares by which a model fits worse about its own replica, from which on its mechanism has run away
#: (assumption: what chance alone reaches once in a thousand).
_AWAY = 3.0
#: Shares of a mechanism's size from which a fit that has run away begins anew: where it bends, the straight line about the
#: baseline ends short of its size or beyond it.
_SHARES = (0.5, 0.75, 1.25, 1.5)


class _Made(NamedTuple):
    """A replica, what it was made about, and the model fitted to it."""

    replica: Replica
    about: Fitted
    fitted: Fitted


def settle(recorded: Balances, fitted: Fitted, weights: Weights) -> tuple[Replica, Fitted]:
    """Return the replica about an extended model, and the model fitted to it: of infinite cost if it does not come to rest.

    Where the next replica fits the recordings worse, the way there was too long: half of it is gone.
    """
    moves: list[float] = []
    last, least = None, np.inf
    for made in range(1, _REPLICAS[1] + 1):
        replica = Replica(recorded, fitted.model)
        one = _Made(replica, fitted, refit(replica, fitted.model, fitted.variants, weights))
        if last is not None and has_run_away(one.fitted, least):
            if moved(last.about, fitted) < _SETTLED:
                break
            fitted = _halfway(last.about, fitted)
            continue
        last, fitted, least = one, one.fitted, min(least, one.fitted.cost)
        moves.append(moved(one.about, fitted))
        if made >= _REPLICAS[0] and moves[-1] < _SETTLED:
            return replica, fitted
    assert last is not None
    if len(moves) < made:  # further on it is worse
        return last.replica, _held(last, weights)
    rests = moves[-1] < _COMES_TO_REST * moves[0]
    return last.replica, fitted if rests else dataclasses.replace(fitted, cost=np.inf)


def _halfway(near: Fitted, far: Fitted) -> Fitted:
    """Return a fit between two, to be made a replica about."""
    tau, mu_cd = 0.5 * (near.model.tau + far.model.tau), 0.5 * (np.array(near.model.mu_cd) + np.array(far.model.mu_cd))
    model = dataclasses.replace(far.model, tau=tau, mu_cd=tuple(mu_cd.tolist()))
    values = tuple(0.5 * (one + other) for one, other in zip(near.values, far.values, strict=True))
    for variant, each in zip(far.variants, values, strict=True):
        model = switched(model, variant, each)
    return dataclasses.replace(far, model=model, values=values)


def _held(made: _Made, weights: Weights) -> Fitted:
    """Return the fit of the law alone, mechanisms as they are in the replica."""
    law = refit(made.replica, made.about.model, (), weights)
    return dataclasses.replace(made.fitted, model=law.model, values=made.about.values, cost=law.cost)


def has_run_away(fitted: Fitted, before: float) -> bool:
    """Whether a model about its own replica fits worse than a sum of squares `before`, by more than such a sum scatters.

    About its own replica a model is right by construction, so that what goes with it says nothing of a mechanism that ran away;
    how well the model fits there does.
    """
    return fitted.cost > before + _AWAY * float(np.sqrt(2.0 * before))


def moved(before: Fitted, after: Fitted) -> float:
    """Return by how many deviations the size of a mechanism moved at most."""
    return max(
        float(np.max(np.abs(new - old) / np.sqrt(np.maximum(np.diag(spread), 1e-300))))
        for new, old, spread in zip(after.values, before.values, after.covariance, strict=True)
    )


def settle_anew(recorded: Balances, fitted: Fitted, variant: Variant, weights: Weights) -> tuple[Replica, Fitted]:
    """Settle from that share of a mechanism's size about whose own replica the model fits best."""
    others = [one for one in fitted.variants if one is not variant]
    tried = []
    for share in _SHARES:
        model = switched(fitted.model, variant, _scaled(variant, values_in(fitted.model, variant), share))
        replica = Replica(recorded, model)
        tried.append((refit(replica, model, others, weights), replica))
    best, replica = min(tried, key=lambda one: one[0].cost)
    return settle(recorded, refit(replica, best.model, fitted.variants, weights), weights)


def _scaled(variant: Variant, values: np.ndarray, share: float) -> np.ndarray:
    """Return the values (k,) with a share of the sizes; what says where a mechanism acts stays."""
    null = variant.null()
    size = np.array([parameter_of(variant.name, name).kind == "size" for name in variant.sizes])
    result: np.ndarray = np.where(size, null + share * (values - null), values)
    return result
