"""Decides: forward selection among the library's mechanisms, what they cannot be told from, and whether structure remains."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant, choice_of, refined
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.interest import effect
from wsp_env.diagnosis.search import Found, Scan, Search, scan
from wsp_env.plant.mechanisms import ALL

#: -log10 of the probability in a null recording from which on a mechanism counts; some twenty names are searched.
SURPRISE = 4.0
#: Size over the smallest effect of interest from which on a mechanism counts.
LEAST_MULTIPLE = 0.6
#: Share of the runs' part of the gain that must show on the runs to validate.
HELD_OUT_SHARE = 0.2
#: A second mechanism must gain this share of what the first gained: less is the first one's form.
LEAST_SHARE = 0.06
#: Alternatives: gains within this share of the best one's, or within `INDISTINCT`.
SHARE_OF_GAIN = 0.1
INDISTINCT = 9.0
MOST = 3


@dataclasses.dataclass(frozen=True)
class Accepted:
    """A mechanism that was accepted, and how."""

    found: Found
    variant: Variant  # with what the refit moves free
    alternatives: tuple[str, ...]
    confidence: float
    multiple: float


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The end of the forward selection."""

    fitted: Fitted
    accepted: tuple[Accepted, ...]
    first: Search  # about the baseline
    last: Search  # about the extended model
    screened: tuple[Found, ...]  # about the baseline
    rest: tuple[Found, ...]  # about the extended model


def select(
    balances: Balances, model: Model, weights: Weights, data: Scan, nulls: Sequence[Scan], tried: Sequence[Variant]
) -> Outcome:
    """Accept mechanisms one after the other, each refitted with all before it."""
    first = search = Search(data, nulls, np.zeros(0, dtype=int))
    screened = found = search.found()
    accepted: list[Accepted] = []
    fitted = refit(balances, model, (), weights)
    while len(accepted) < MOST:
        chosen = _best(balances, fitted.model, search, found, accepted)
        if chosen is None:
            break
        one, multiple = chosen
        variant = _variant(search, one)
        free, _ = refined(variant)
        amplitude = -one.fit.amplitude * search.data.candidates[one.which].steps
        at_start = choice_of(variant, _null(variant) + amplitude)
        begun = dataclasses.replace(fitted.model, choice={**fitted.model.choice, **at_start})
        variants = (*(a.variant for a in accepted), free)
        tried_fit = refit(balances, begun, variants, weights)
        if tried_fit.cost > fitted.cost:  # the linear step led astray: from a tenth of it
            begun = dataclasses.replace(
                fitted.model, choice={**fitted.model.choice, **choice_of(variant, _null(variant) + 0.1 * amplitude)}
            )
            tried_fit = min(tried_fit, refit(balances, begun, variants, weights), key=lambda fit: fit.cost)
        fitted = tried_fit
        alternatives, confidence = _alternatives(found, one)
        accepted.append(Accepted(one, free, alternatives, confidence, multiple))
        given = np.concatenate([_columns_in(nulls[0], a.variant) for a in accepted])
        rescan = scan(balances, fitted.model, weights.deviation, tried, [a.variant for a in accepted])
        search = Search(rescan, nulls, given)
        found = search.found()
    return Outcome(fitted, tuple(accepted), first, search, tuple(screened), tuple(found))


def _best(
    balances: Balances, model: Model, search: Search, found: Sequence[Found], accepted: Sequence[Accepted]
) -> tuple[Found, float] | None:
    """Return the mechanism that gains most among those that pass every test, with its size."""
    library = [one for one in found if search.data.candidates[one.which].variant and one.surprise >= SURPRISE]
    least = LEAST_SHARE * max((a.found.gain for a in accepted), default=0.0)
    for one in sorted(library, key=lambda one: float(one.nulls.mean()) - one.gain):
        if one.gain < least or one.held_out < HELD_OUT_SHARE * _expected(search, one):
            continue
        variant = _variant(search, one)
        values = _null(variant) - one.fit.amplitude * search.data.candidates[one.which].steps
        multiple = effect(balances, model, choice_of(variant, values)).multiple
        if multiple >= LEAST_MULTIPLE:
            return one, multiple
    return None


def _expected(search: Search, one: Found) -> float:
    """Share of the gain that the runs to validate would have by their part of the columns' squares."""
    index = search.data.columns_of(one.which)
    part = np.trace(search.data.validate.gram[np.ix_(index, index)]) / max(
        np.trace(search.data.whole.gram[np.ix_(index, index)]), 1e-12
    )
    return float(min(part, 1.0)) * one.gain


def _variant(search: Search, one: Found) -> Variant:
    variant = search.data.candidates[one.which].variant
    if variant is None:
        raise ValueError(f"{one.name} is no mechanism")
    return variant


def _null(variant: Variant) -> np.ndarray:
    nulls = {parameter.name: parameter.null for parameter in ALL[variant.name].parameters}
    return np.array([nulls[name] for name in variant.sizes])


def _columns_in(null: Scan, variant: Variant) -> np.ndarray:
    """Columns of a mechanism in a null scan: those of all its variants with the same fixed parameters, or the nearest."""
    members = [i for i, one in enumerate(null.candidates) if one.variant and one.variant.name == variant.name]
    same = [i for i in members if variant.fixed.items() <= (null.candidates[i].variant or variant).fixed.items()]
    return null.columns_of((same or members)[0])


def _alternatives(found: Sequence[Found], best: Found) -> tuple[tuple[str, ...], float]:
    """Return the names that gain nearly as much, best first, and the share of belief in the best."""
    net = {one.name: one.gain - float(one.nulls.mean()) for one in found if one.name in ALL}
    top = net[best.name]
    margin = max(INDISTINCT, SHARE_OF_GAIN * top)
    near = sorted((name for name, gain in net.items() if gain >= top - margin and name != best.name), key=lambda n: -net[n])
    scale = max(2.0, 0.03 * top)
    belief = 1.0 / sum(float(np.exp(min((gain - top) / (2.0 * scale), 0.0))) for gain in net.values())
    return (best.name, *near), belief * (1.0 - 10.0 ** -min(best.surprise, 15.0))
