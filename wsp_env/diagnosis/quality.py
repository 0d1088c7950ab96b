"""How well baseline and extension fit: to the runs to tune on, then, frozen but for the runs' friction, to the others."""

import dataclasses

import numpy as np

from wsp_env.diagnosis.answer import FitQuality
from wsp_env.diagnosis.candidates import without
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights, refit, weigh
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen, held_out_rows

_LEAST_PAIRS = 20  # neighbouring rows of a balance that say whether one follows the other
_BEYOND = 2.0  # deviations of chi-square by which the baseline must misfit, that a share of it can be removed: assumption


@dataclasses.dataclass(frozen=True)
class Quality:
    """How well baseline and extension fit."""

    fit: FitQuality
    before: Model  # as fitted to the runs to tune on
    after: Model
    held_out: tuple[float, ...]  # by how much each accepted mechanism reduces chi-square of the runs to validate
    weights: Weights  # of all rows
    expected: Weights  # the same with the sizes and the noise that are expected of sound recordings


def quality(replica: Replica, outcome: Outcome) -> Quality:
    """Return mean squares relative to what noise and nuisances of their sizes leave, of tuned and of held-out runs."""
    held = held_out_rows(replica.rows)
    last = outcome.last
    nuisances = outcome.first.groups
    groups = [*nuisances, outcome.first.times]  # by how much channels may be early or late counts as noise
    sizes = Sizes(np.append(last.sizes.groups[: len(nuisances)], 1.0), last.sizes.noise)

    def weights(keep: np.ndarray | None) -> Weights:
        return weigh(replica, outcome.first.whitening, groups, sizes, keep)

    tuned, scored = weights(~held), weights(held)
    start = refit(replica, replica.baseline, (), tuned, ~held)
    before, base = start.model, {"tune": start.cost / int((~held).sum())}
    fitted = refit(replica, outcome.fitted.model, outcome.fitted.variants, tuned, ~held) if outcome.fitted.variants else start
    extended = {"tune": fitted.cost / int((~held).sum())}

    def score(model: Model) -> float:
        return refit(replica, model, (), scored, held, free_law=False).cost

    gains: tuple[float, ...] = ()
    removed = None
    if held.any():
        rows = int(held.sum())
        own = score(fitted.model)
        base["validate"], extended["validate"] = score(before) / rows, own / rows
        gains = tuple(score(without(fitted.model, one.trial.variant)) - own for one in outcome.accepted)
        if base["validate"] > 1.0 + _BEYOND * float(np.sqrt(2.0 / rows)):
            removed = (base["validate"] - extended["validate"]) / (base["validate"] - 1.0)
    return Quality(
        FitQuality(1.0, base, extended, removed),
        before,
        fitted.model,
        gains,
        weights(None),
        weigh(replica, outcome.first.whitening, groups),
    )


def structured(replica: Replica, seen: Screen) -> float:
    """Return how large, over the channels' noise, what goes on from row to row is in what the model of a search leaves.

    Noise of any size says that channels are noisy; what a row shares with the next one of the same axle and run is physics that
    neither model nor nuisances describe. The largest root of the rows' autocovariance, over the balances.
    """
    sizes = Sizes(np.append(seen.sizes.groups, 1.0), seen.sizes.noise)
    weights = weigh(replica, seen.whitening, [*seen.groups, seen.small], sizes)
    rows = replica.rows
    left = weights.projector.rest(weights(seen.base)) * seen.sizes.noise[rows.balance]
    order = np.lexsort((rows.time, rows.axle, rows.run, rows.balance))
    one, two = order[:-1], order[1:]
    follows = (rows.balance[one] == rows.balance[two]) & (rows.run[one] == rows.run[two]) & (rows.axle[one] == rows.axle[two])
    shared = []
    for balance in np.unique(rows.balance):
        mine = follows & (rows.balance[one] == balance)
        if mine.sum() >= _LEAST_PAIRS:
            shared.append(float(np.mean(left[one[mine]] * left[two[mine]])))
    return float(np.sqrt(max([0.0, *shared])))
