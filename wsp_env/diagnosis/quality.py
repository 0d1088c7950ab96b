"""Quality of fit of baseline and extended model on the tuning runs and on the held-out runs.

The sizes of mechanisms are fitted to the tuning runs. The law, tau and mu_cd, is fitted to all runs for both models: a few runs
may hardly determine tau, and then it is not the mechanism that decides whether other runs fit.
Each model is evaluated on its own replica, because effects are nonlinear (`wsp_env.diagnosis.convergence`). The value of a
mechanism for the held-out runs is evaluated on the replica of the extended model.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.answer import FitQuality
from wsp_env.diagnosis.balances import BALANCES, Whitening
from wsp_env.diagnosis.baseline import replica_of
from wsp_env.diagnosis.candidates import Variant, at_bound, columns, without
from wsp_env.diagnosis.colour import slide_whitening
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import refit
from wsp_env.diagnosis.gls import fit
from wsp_env.diagnosis.readings import of_noise
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import held_out_rows
from wsp_env.diagnosis.trials import SURE, on_a_sensor
from wsp_env.diagnosis.variation import Group, law_columns
from wsp_env.diagnosis.weights import Weighing, Weights, weigh

_BEYOND = 2.0  # standard deviations of its scatter by which a mean square misfits: assumption
#: Rows of each part, from the mask (n,) of held-out rows; None: all rows.
_ROWS: Mapping[str, Callable[[np.ndarray], np.ndarray | None]] = {
    "tuned": np.logical_not, "held out": np.asarray, "all": lambda held: None
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Quality:
    """Quality of fit of baseline and extended model."""

    fit: FitQuality
    before: Model  # law fitted to all runs
    after: Model  # the same with mechanisms, whose sizes are fitted to the tuning runs
    held_out: tuple[float, ...]  # reduction of chi-square of the validation runs by each accepted mechanism
    misfits: bool  # whether the baseline leaves more of the held-out runs than noise and nuisances do, in all of them alike
    removed_of: Mapping[str, float | None]  # removed share of the removable held-out residual, by balance; None: none removable
    repeated: tuple[bool, ...]  # whether the held-out runs confirm each mechanism; False if a size ends at a bound
    squares: Mapping[str, np.ndarray]  # (n,) of all rows, "before" and "after", beside the nuisances of `fit`
    weights: Weights  # of all rows
    expected: Weights  # the same with the sizes and noise expected of sound recordings


class Left(NamedTuple):
    """Mean squares of some rows, before and after adding the mechanisms."""

    before: float
    after: float
    best: float  # with the mechanisms' sizes fitted to these rows


def quality(replica: Replica, outcome: Outcome) -> Quality:
    """Return mean squares relative to those that noise and nuisances leave, for tuning and held-out runs."""
    held = held_out_rows(replica.rows)
    last = outcome.last
    first = outcome.first
    sizes = Sizes(np.append(last.sizes.groups[: len(first.groups)], 1.0), last.sizes.noise)
    own, variants = outcome.replica, outcome.fitted.variants

    def whitening_and_groups(about: Replica) -> tuple[Whitening, list[Group]]:
        """Return whitening and nuisances for slides and noise of this replica; delays of channels count as noise."""
        seen = last if of_noise(about.about) else first
        colour = slide_whitening(about.rows, last.colour)
        return dataclasses.replace(seen.whitening, colour=colour), [*seen.groups, seen.times]

    @functools.cache
    def weighing(about: Replica) -> Weighing:
        return Weighing(about, *whitening_and_groups(about), sizes)

    @functools.cache
    def weights(about: Replica, rows: str) -> Weights:
        return weighing(about)(_ROWS[rows](held))

    def held_out(about: Replica, model: Model) -> np.ndarray:
        """Return deviances (2,) of the held-out runs: alone, and predicted from the other runs, with the law fitted to each."""

        def of(rows: str) -> float:
            weighed = weights(about, rows)
            return weighed.deviance(refit(about, model, (), weighed, _ROWS[rows](held)).cost)

        return np.array([of("held out"), of("all") - of("tuned")])

    def fitted(about: Replica, model: Model, free: Sequence[Variant]) -> Model:
        """Return a model with sizes of mechanisms fitted to the tuning runs, and the law to all."""
        sized = refit(about, model, free, weights(about, "tuned"), ~held).model if free else model
        return refit(about, sized, (), weights(about, "all")).model

    before, tuned = fitted(replica, replica.baseline, ()), weights(own, "tuned")
    after = fitted(own, outcome.fitted.model, variants) if variants else before
    gains: tuple[float, ...] = ()
    if held.any() and variants:
        whole = held_out(own, after)
        for one in outcome.accepted:
            others = [variant for variant in variants if variant is not one.trial.variant]
            off, about, weighed = without(after, one.trial.variant), own, tuned
            if on_a_sensor(one.trial.variant):
                about = Replica(replica.recorded, off) if others else replica
                weighed = weights(about, "tuned")
            off = refit(about, off, others, weighed, ~held).model
            # Nuisances may absorb the effect: after learning it from the tuning runs (predicted), or in a few runs (alone). The
            # larger gain counts.
            gains += (float(np.max(held_out(about, off) - whole)),)
    repeated = tuple(
        0.5 * gain > SURE and not at_bound(one.trial.variant, outcome.fitted.model)
        for gain, one in zip(gains or (np.inf,) * len(outcome.accepted), outcome.accepted, strict=True)
    )
    kept = [one.trial.variant for one, sure in zip(outcome.accepted, repeated, strict=True) if sure]
    if len(kept) < len(variants):
        for one, sure in zip(outcome.accepted, repeated, strict=True):
            after = after if sure else without(after, one.trial.variant)
        if kept:
            every = weights(own, "all")
            own = replica_of(replica.recorded, refit(own, after, kept, every).model, every)
        else:
            own = replica
        # A mechanism fitted together with others is now fitted without the rejected ones.
        after = fitted(own, after, kept)
    every = weights(replica, "all")
    parts = {"tune": ~held} | ({"validate": held} if held.any() else {})
    each = {name: held & (replica.rows.balance == balance) for balance, name in enumerate(BALANCES)}
    parts_and_balances = parts | {name: rows for name, rows in each.items() if rows.any()}
    rests = level(own, after, kept, weights(own, "all"), before)
    if kept:  # the baseline on its own replica
        rests = rests._replace(before=level(replica, after, kept, every, before).before)
    figures = {name: rests.left(rows) for name, rows in parts_and_balances.items()}
    base, extended = ({name: figures[name][i] for name in parts} for i in (0, 1))
    return Quality(
        FitQuality(1.0, base, extended, _removed(figures.get("validate"), int(held.sum()))),
        before,
        after,
        gains,
        bool(held.any()) and misfits(rests.before.squares(held) + rests.before.unlikely, replica.rows.run[held]),
        {name: _removed(figures.get(name), int(rows.sum())) for name, rows in each.items()},
        repeated,
        {"before": rests.before.squares(slice(None)), "after": rests.after.squares(slice(None))},
        every,
        weigh(replica, dataclasses.replace(first.whitening, colour=None), [*first.groups, first.times]),
    )


class Side(NamedTuple):
    """Residuals of one model."""

    rest: np.ndarray  # (n,) whitened
    friction: np.ndarray  # (n, runs) whitened changes by mu_cd of each run, which is fitted to the rows in question
    unlikely: float  # prior term of the nuisances, by row

    def squares(self, rows: np.ndarray | slice) -> np.ndarray:
        """Return the squares of the rows, a mask (n,) or a slice, with mu_cd of the runs fitted to them."""
        mine, friction = self.rest[rows], self.friction[rows]
        rest: np.ndarray = mine - friction @ np.linalg.lstsq(friction, mine, rcond=1e-9)[0]
        return rest**2


class Level(NamedTuple):
    """Residuals of all rows beside the same nuisances."""

    before: Side
    after: Side
    best: Side  # with the mechanisms' sizes fitted to the rows

    def left(self, rows: np.ndarray) -> Left:
        """Return the mean squares of the rows (n,) bool."""
        return Left(*(float(np.mean(one.squares(rows))) + one.unlikely for one in self))


def level(
    replica: Replica, model: Model, variants: Sequence[Variant], weights: Weights, baseline: Model
) -> Level:  # fmt: skip
    """Return the residuals of the baseline and of a model with mechanisms, beside equal nuisances.

    Only mu_cd of the runs is fitted again. All other nuisances are
    estimated once, with mechanisms of free size, and used for both models, so that neither is favoured. Fitted to one model,
    they would absorb a part of what it lacks.
    """
    base, bare = replica.raw(model), replica.raw(baseline)
    y = weights(base)
    moves = np.column_stack([np.zeros((len(base), 0)), *(columns(replica, model, base, one) for one in variants)])
    law, own = (weights(law_columns(replica, *one)) for one in ((model, base), (baseline, bare)))
    free = np.column_stack([weights(moves), law])
    projector = weights.projector
    fitted = free @ fit(projector.inner(free, free), projector.inner(free, y[:, None])[:, 0]).amplitude
    amplitudes = projector.amplitudes(y - fitted)
    sound = (y - fitted) - projector.rest(y - fitted)
    unlikely = float(amplitudes @ amplitudes) / len(y)
    return Level(
        Side(weights(bare) - sound, own[:, 1:], unlikely),
        Side(y - sound, law[:, 1:], unlikely),
        Side(y - fitted - sound, law[:, 1:], unlikely),
    )


def _removed(held: Left | None, rows: int) -> float | None:
    """Return the removed share of what can be removed; None if nothing can."""
    if held is None or held.before <= max(held.best, 1.0) + _BEYOND * _scatter(rows):
        return None
    return (held.before - held.after) / (held.before - min(held.best, 1.0))


def _scatter(rows: int) -> float:
    """Return the standard deviation of the mean of so many squares of white noise."""
    return float(np.sqrt(2.0 / max(rows, 1)))


def misfits(squares: np.ndarray, run: np.ndarray) -> bool:
    """Whether squares (n,) exceed those of white noise by more than they scatter, from row to row and from run to run.

    Runs differ by more than their rows: rails and slides of their own. Their sums about the common mean tell by how much
    (cluster-robust variance, K.-Y. Liang, S. L. Zeger, Biometrika 73, 1986, with the factor m / (m - 1) of m runs).

    Parameters
    ----------
    run : (n,) of each row

    """
    mean, scatter = float(np.mean(squares)), _scatter(len(squares))
    sums = np.bincount(np.unique(run, return_inverse=True)[1], squares - mean)
    if len(sums) > 1:
        between = float(np.sqrt(len(sums) / (len(sums) - 1) * (sums @ sums))) / len(squares)
        scatter = max(scatter, between)
    return mean > 1.0 + _BEYOND * scatter
