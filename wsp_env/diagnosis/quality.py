"""How well baseline and extension fit: to the runs to tune on, then, frozen but for the runs' friction, to the others.

Each is asked about a replica of its own, as mechanisms bend (`wsp_env.diagnosis.settle`); what a mechanism is worth to the
held-out runs, about that of the extension.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.answer import FitQuality
from wsp_env.diagnosis.balances import BALANCES, Whitening
from wsp_env.diagnosis.candidates import Variant, at_bound, columns, without
from wsp_env.diagnosis.colour import bleach
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights, refit, weigh
from wsp_env.diagnosis.gls import fit
from wsp_env.diagnosis.readings import on_sensors
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import held_out_rows
from wsp_env.diagnosis.trials import SURE, on_a_sensor
from wsp_env.diagnosis.variation import Group, law_columns

_BEYOND = 2.0  # deviations of chi-square by which the baseline must misfit, that a share of it can be removed: assumption
#: Rows that are asked, by those (n,) bool that are held out; None: all.
_ROWS: Mapping[str, Callable[[np.ndarray], np.ndarray | None]] = {
    "tuned": np.logical_not, "held out": np.asarray, "all": lambda held: None
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Quality:
    """How well baseline and extension fit."""

    fit: FitQuality
    before: Model  # as fitted to the runs to tune on
    after: Model
    held_out: tuple[float, ...]  # by how much each accepted mechanism reduces chi-square of the runs to validate
    removed_of: Mapping[str, float | None]  # share gone of what can be removed of them, by balance; None: nothing can be
    repeated: tuple[bool, ...]  # whether they make it sure by themselves, if any is held out, at a size that can be
    weights: Weights  # of all rows
    expected: Weights  # the same with the sizes and the noise that are expected of sound recordings


class Left(NamedTuple):
    """Mean squares of some rows."""

    before: float
    after: float
    best: float  # with the mechanisms' sizes fitted to these very rows


def quality(replica: Replica, outcome: Outcome) -> Quality:
    """Return mean squares relative to what noise and nuisances of their sizes leave, of tuned and of held-out runs."""
    held = held_out_rows(replica.rows)
    last = outcome.last
    first = outcome.first
    sizes = Sizes(np.append(last.sizes.groups[: len(first.groups)], 1.0), last.sizes.noise)
    own, variants = outcome.replica, outcome.fitted.variants

    def whitening_and_groups(about: Replica) -> tuple[Whitening, list[Group]]:
        """Return what the rows vary by where wheels slide as sensors then say; channels' times count as noise."""
        seen = last if on_sensors(about.about) else first
        colour = bleach(about.rows, last.colour)
        return dataclasses.replace(seen.whitening, colour=colour), [*seen.groups, seen.times]

    @functools.cache
    def weights(about: Replica, rows: str) -> Weights:
        return weigh(about, *whitening_and_groups(about), sizes, _ROWS[rows](held))

    def held_out(about: Replica, model: Model) -> np.ndarray:
        """Return deviances (2,) of the held-out runs: alone, and predicted from the others with all that is common to both."""

        def of(rows: str) -> float:
            weighed = weights(about, rows)
            return weighed.deviance(refit(about, model, (), weighed, _ROWS[rows](held), free_law=False))

        return np.array([of("held out"), of("all") - of("tuned")])

    before = refit(replica, replica.baseline, (), weights(replica, "tuned"), ~held).model
    tuned = weights(own, "tuned")
    after = refit(own, outcome.fitted.model, variants, tuned, ~held).model if variants else before
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
            # Alone they show what nuisances take over once it is learned, predicted what these take over in a few runs.
            gains += (float(np.max(held_out(about, off) - whole)),)
    repeated = tuple(
        0.5 * gain > SURE and not at_bound(one.trial.variant, outcome.fitted.model)
        for gain, one in zip(gains or (np.inf,) * len(outcome.accepted), outcome.accepted, strict=True)
    )
    kept = [one.trial.variant for one, sure in zip(outcome.accepted, repeated, strict=True) if sure]
    if len(kept) < len(variants):
        for one, sure in zip(outcome.accepted, repeated, strict=True):
            after = after if sure else without(after, one.trial.variant)
        own = Replica(replica.recorded, refit(own, after, kept, weights(own, "all")).model) if kept else replica
        # What was fitted beside the others stands by itself now.
        after = refit(own, after, kept, weights(own, "tuned"), ~held).model
    every = weights(replica, "all")
    parts = {"tune": ~held} | ({"validate": held} if held.any() else {})
    each = {name: held & (replica.rows.balance == balance) for balance, name in enumerate(BALANCES)}
    parts_and_balances = parts | {name: rows for name, rows in each.items() if rows.any()}
    figures = left(own, after, kept, weights(own, "all"), parts_and_balances, before)
    if kept:  # the baseline about its own replica
        bare = left(replica, after, kept, every, parts_and_balances, before)
        figures = {name: one._replace(before=bare[name].before) for name, one in figures.items()}
    base, extended = ({name: figures[name][i] for name in parts} for i in (0, 1))
    return Quality(
        FitQuality(1.0, base, extended, _removed(figures.get("validate"), int(held.sum()))),
        before,
        after,
        gains,
        {name: _removed(figures.get(name), int(rows.sum())) for name, rows in each.items()},
        repeated,
        every,
        weigh(replica, dataclasses.replace(first.whitening, colour=None), [*first.groups, first.times]),
    )


def left(
    replica: Replica,
    model: Model,
    variants: Sequence[Variant],
    weights: Weights,
    parts: Mapping[str, np.ndarray],
    baseline: Model,
) -> dict[str, Left]:
    """Return what parts of the rows (n,) bool leave of the baseline and of a model with mechanisms.

    The law of each is the one fitted with it, but for the friction of the runs, which is fitted anew. All other nuisances stay
    as they are found beside mechanisms of any size, so that neither is favoured: were they fitted to either, they would take
    over what is missing.
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
    unlikely = float(amplitudes @ amplitudes) / len(y)  # in the nuisances' own deviations: the same beside any model

    def mean(rows: np.ndarray, level: np.ndarray, keep: np.ndarray) -> float:
        mine, level = rows[keep], level[keep, 1:]
        rest = mine - level @ np.linalg.lstsq(level, mine, rcond=1e-9)[0]
        return float(rest @ rest) / len(mine) + unlikely

    before, after, best = weights(bare) - sound, y - sound, y - fitted - sound
    return {name: Left(mean(before, own, keep), mean(after, law, keep), mean(best, law, keep)) for name, keep in parts.items()}


def _removed(held: Left | None, rows: int) -> float | None:
    """Return the share that is gone of what can be removed; None where nothing can be."""
    if held is None or held.before <= max(held.best, 1.0) + _BEYOND * float(np.sqrt(2.0 / rows)):
        return None
    return (held.before - held.after) / (held.before - min(held.best, 1.0))
