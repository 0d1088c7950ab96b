"""Decides: forward selection among the library's mechanisms, by the rules of `wsp_env.diagnosis.rules`."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant, choice_of, parameter_of, refined
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.interest import effect
from wsp_env.diagnosis.rules import (
    LEAST_MULTIPLE,
    NEG_LOG10_P,
    Accepted,
    Trial,
    alternatives_to,
    columns_in,
    expected,
    held_out_part,
    is_normal,
    is_shadow,
    least_held_out,
    least_reduction,
)
from wsp_env.diagnosis.search import Found, LibrarySearch, Scan, scan
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import rolling_radii

#: Mechanisms that are accepted at most.
MOST = 3
#: Mechanisms that are refitted in every round.
TRIED = 5


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The end of the forward selection."""

    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: LibrarySearch  # about the baseline
    last: LibrarySearch  # about the extended model
    screened: tuple[Found, ...]  # about the baseline
    rest: tuple[Found, ...]  # about the extended model


def select(
    balances: Balances,
    model: Model,
    weights: Weights,
    data: Scan,
    nulls: Sequence[Scan],
    tried: Sequence[Variant],
    pool: Executor,
) -> Outcome:
    """Accept mechanisms one after the other, each refitted with all before it; what competes is refitted side by side."""
    first = search = LibrarySearch(data, nulls, np.zeros(0, dtype=int), np.zeros(0))
    screened = found = search.found()
    accepted: list[Accepted] = []
    fitted = refit(balances, model, (), weights)
    for _ in range(MOST):
        passed, others = _trials(balances, fitted, search, found, weights, accepted, pool)
        if not passed:
            break
        best = passed[0]
        alternatives, confidence = alternatives_to(best, [one.found for one in passed[1:]] + others)
        accepted.append(Accepted(best.found, best.listed, best.variant, alternatives, confidence, best.multiple, best.tilt))
        accepted, fitted = _needed(balances, best.fitted, search, accepted, weights)
        given = np.concatenate([columns_in(nulls[0], a.listed) for a in accepted])
        rescan = scan(balances, fitted.model, weights, tried, [a.variant for a in accepted])
        search = LibrarySearch(rescan, nulls, given, np.concatenate([a.tilt for a in accepted]))
        found = search.found()
    accepted.sort(key=lambda one: -one.found.net)
    order = [[v.name for v in fitted.variants].index(one.variant.name) for one in accepted]
    fitted = dataclasses.replace(
        fitted,
        variants=tuple(fitted.variants[i] for i in order),
        values=tuple(fitted.values[i] for i in order),
        covariance=tuple(fitted.covariance[i] for i in order),
    )
    return Outcome(fitted, tuple(accepted), first, search, tuple(screened), tuple(found))


def _needed(
    balances: Balances, fitted: Fitted, search: LibrarySearch, accepted: list[Accepted], weights: Weights
) -> tuple[list[Accepted], Fitted]:
    """Drop what is not needed any more beside the last, which then has the reduction of both: it was the last's form."""
    last = accepted[-1]
    for one in accepted[:-1]:
        others = [other for other in accepted if other is not one]
        choice = {name: values for name, values in fitted.model.choice.items() if name != one.variant.name}
        model = dataclasses.replace(fitted.model, choice=choice)
        without = refit(balances, model, [a.variant for a in others], weights, tilts=[a.tilt for a in others])
        lost = without.cost - fitted.cost
        whole = dataclasses.replace(last.found, reduction=last.found.reduction + one.found.reduction - lost)
        if lost < least_reduction(search, one.found, one.listed, [dataclasses.replace(last, found=whole)]):
            return _needed(balances, without, search, [*others[:-1], dataclasses.replace(last, found=whole)], weights)
    return accepted, fitted


def _trials(
    balances: Balances,
    fitted: Fitted,
    search: LibrarySearch,
    found: Sequence[Found],
    weights: Weights,
    accepted: Sequence[Accepted],
    pool: Executor,
) -> tuple[list[Trial], list[Found]]:
    """Refit the mechanisms that promise most.

    Returns those that pass every test, the one that explains most first, and the promising ones that were not refitted.
    """
    library = [one for one in found if one.name in ALL and one.neg_log10_p >= NEG_LOG10_P]
    library.sort(key=lambda one: -one.net)
    promising, together = library[:TRIED], set()
    if not accepted and (pairs := search.pairs(found)):  # two together may show what neither does alone
        promising += [one for one in pairs[0][2:] if one.name not in {other.name for other in promising}]
        together = _held_out_together(search, pairs[0][2:])
    left = [one for one in library if one.name not in {other.name for other in promising}]
    starts = {one.which: _null(v) - one.fit.amplitude * search.data.candidates[one.which].steps
              for one in promising for v in [_variant(search, one)]}  # fmt: skip
    rolling = _rolling(balances, search, found)
    if rolling is not None and not any(a.variant.name == rolling[0].name for a in accepted):
        promising = [rolling[0], *(one for one in promising if one.name != rolling[0].name)]
        starts[rolling[0].which] = rolling[1]

    def refitted(one: Found) -> Trial:
        return _trial(balances, fitted, search, one, starts[one.which], weights, accepted)

    there = []
    for one, trial in zip(promising, pool.map(refitted, promising), strict=True):
        held_out = one.name in together or one.held_out >= least_held_out(expected(search, one)) or rolling is not None
        if trial.found.reduction > least_reduction(search, one, trial.listed, accepted) and held_out:
            there.append(trial)
    there.sort(key=lambda trial: -trial.found.net)
    sized = [(i, trial) for i, trial in enumerate(there) if trial.multiple >= LEAST_MULTIPLE]
    passed = [trial for i, trial in sized if not is_normal(trial) and not is_shadow(search, trial, there[:i])]
    return passed, left


def _trial(
    balances: Balances,
    fitted: Fitted,
    search: LibrarySearch,
    one: Found,
    start: np.ndarray,
    weights: Weights,
    accepted: Sequence[Accepted],
) -> Trial:
    variant = _variant(search, one)
    free, _ = refined(variant)
    variants = (*(a.variant for a in accepted), free)
    null, best = _null(variant), None
    offset = search.offsets["whole"][search.data.columns_of(one.which)]
    tilt = np.concatenate([offset, np.zeros(len(free.sizes) - len(variant.sizes))])
    tilts = [*(a.tilt for a in accepted), tilt]
    for share in (1.0, 0.3, 0.05):  # the linear step may lead astray
        choice = {**fitted.model.choice, **choice_of(variant, null + share * (start - null))}
        again = refit(balances, dataclasses.replace(fitted.model, choice=choice), variants, weights, tilts=tilts)
        if best is None or again.cost < best.cost:
            best = again
        if best.cost < fitted.cost - 0.5 * one.reduction:
            break
    assert best is not None
    reduction = max(fitted.cost - best.cost, 0.0)
    added = effect(balances, fitted.model, {variant.name: best.model.choice[variant.name]})
    return Trial(dataclasses.replace(one, reduction=reduction), variant, free, best, added.multiple, tilt)


def _rolling(balances: Balances, search: LibrarySearch, found: Sequence[Found]) -> tuple[Found, np.ndarray] | None:
    """Return the wheelset that free rolling contradicts most, if beyond what is normal, as the mechanism that it shows."""
    measures = {name: card.signature.rolls_freely for name, card in ALL.items()}
    template = next((one for one in found if measures.get(one.name)), None)
    if template is None or (measured := measures[template.name]) is None:
        return None
    change = rolling_radii(balances.campaign) / balances.radius - 1.0
    axle = int(np.argmax(np.abs(change)))
    if abs(change[axle]) < measured.least:
        return None
    which = next(
        i
        for i, c in enumerate(search.data.candidates)
        if c.variant and c.name == template.name and c.variant.fixed["axle"] == axle + 1
    )
    alone = search.solve(search.data.columns_of(which))
    variant = _variant(search, dataclasses.replace(template, which=which))
    start = np.where(np.array(variant.sizes) == measured.size, change[axle], _null(variant))
    return dataclasses.replace(template, which=which, fit=alone, reduction=alone.reduction), start


def _held_out_together(search: LibrarySearch, pair: Sequence[Found]) -> set[str]:
    """Return the names of a pair that explains of the runs to validate what it should: there one may hide without the other."""
    index = np.concatenate([search.data.columns_of(one.which) for one in pair])
    seen = search.held_out(index) >= least_held_out(held_out_part(search, index) * search.solve(index).reduction)
    return {one.name for one in pair} if seen else set()


def _variant(search: LibrarySearch, one: Found) -> Variant:
    variant = search.data.candidates[one.which].variant
    if variant is None:
        raise ValueError(f"{one.name} is no mechanism")
    return variant


def _null(variant: Variant) -> np.ndarray:
    return np.array([parameter_of(variant.name, name).null for name in variant.sizes])
