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
from wsp_env.recordings import rolling_radii

#: -log10 of the probability in a null recording from which on a mechanism counts; some twenty names are searched.
SURPRISE = 5.0
#: Size over the smallest effect of interest from which on a mechanism counts.
LEAST_MULTIPLE = 0.15
#: Gain over the largest one in null recordings, and gain, from which on it counts: whatever few null recordings say of tails.
OVER_NULLS = 2.0
LEAST_GAIN = 25.0
#: Share of the runs' part of the gain that must show on the runs to validate.
HELD_OUT_SHARE = 0.2
#: Another mechanism must gain this share of what the first gained, times their squared cosine: less is the first one's form.
LEAST_SHARE = 0.06
#: Alternatives: gains within this share of the best one's, or within `INDISTINCT`.
SHARE_OF_GAIN = 0.1
INDISTINCT = 9.0
MOST = 3
#: Mechanisms that are refitted in every round.
TRIED = 3
#: Wheel radius [-] off by more than this is no normal variation: three times its tolerance.
ABNORMAL_RADIUS = 1.5e-3


@dataclasses.dataclass(frozen=True)
class Accepted:
    """A mechanism that was accepted, and how."""

    found: Found
    variant: Variant  # with what the refit moves free
    alternatives: tuple[str, ...]
    confidence: float
    multiple: float
    tilt: np.ndarray  # see `refit`


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
        trials = _trials(balances, fitted, search, found, weights, accepted)
        if not trials:
            break
        best = trials[0]
        fitted = best.fitted
        alternatives, confidence = _alternatives(found, trials)
        accepted.append(Accepted(best.found, best.variant, alternatives, confidence, best.multiple, best.tilt))
        given = np.concatenate([columns_in(nulls[0], a.variant) for a in accepted])
        rescan = scan(balances, fitted.model, weights.deviation, tried, [a.variant for a in accepted])
        search = Search(rescan, nulls, given)
        found = search.found()
    return Outcome(fitted, tuple(accepted), first, search, tuple(screened), tuple(found))


@dataclasses.dataclass(frozen=True)
class Trial:
    """A mechanism refitted together with those accepted before."""

    found: Found  # with the gain of the refit
    variant: Variant
    fitted: Fitted
    multiple: float
    tilt: np.ndarray


def _trials(
    balances: Balances,
    fitted: Fitted,
    search: Search,
    found: Sequence[Found],
    weights: Weights,
    accepted: Sequence[Accepted],
) -> list[Trial]:
    """Refit the mechanisms that promise most; return those that pass every test, the one that gains most first."""
    library = [one for one in found if one.name in ALL and one.surprise >= SURPRISE]
    library.sort(key=lambda one: float(one.nulls.mean()) - one.gain)
    promising = library[:TRIED]
    starts = {one.which: _null(v) - one.fit.amplitude * search.data.candidates[one.which].steps
              for one in promising for v in [_variant(search, one)]}  # fmt: skip
    rolling = _rolling(balances, search, found)
    if rolling is not None and not any(a.variant.name == rolling[0].name for a in accepted):
        promising = [rolling[0], *(one for one in promising if one.name != rolling[0].name)]
        starts[rolling[0].which] = rolling[1]
    passed = []
    for one in promising:
        trial = _trial(balances, fitted, search, one, starts[one.which], weights, accepted)
        held_out = trial.found.held_out >= HELD_OUT_SHARE * expected(search, one) or rolling is not None
        if trial.found.gain > _least(search, one, accepted) and held_out and trial.multiple >= LEAST_MULTIPLE:
            passed.append(trial)
    return sorted(passed, key=lambda trial: float(trial.found.nulls.mean()) - trial.found.gain)


def _least(search: Search, one: Found, accepted: Sequence[Accepted]) -> float:
    """Return the gain that a mechanism must have, beside those accepted before."""
    least = max(LEAST_GAIN, OVER_NULLS * float(one.nulls.max()))
    null, its = search.nulls[0], search.twin[one.which]
    for other in accepted:
        cosine = largest_cosine(null.whole.gram, null.columns_of(its), columns_in(null, other.variant))
        least = max(least, LEAST_SHARE * cosine**2 * other.found.gain)
    return least


def largest_cosine(gram: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Largest cosine between what two sets of columns can do to the residuals, off the nuisances."""
    roots = []
    for index in (a, b):
        values, vectors = np.linalg.eigh(gram[np.ix_(index, index)])
        kept = values > 1e-9 * max(float(values[-1]), 1e-300)
        roots.append(vectors[:, kept] / np.sqrt(values[kept]))
    cosine = np.linalg.svd(roots[0].T @ gram[np.ix_(a, b)] @ roots[1], compute_uv=False).max(initial=0.0)
    return float(min(cosine, 1.0))


def _trial(
    balances: Balances,
    fitted: Fitted,
    search: Search,
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
    for share in (1.0, 0.2):  # the linear step may lead astray
        choice = {**fitted.model.choice, **choice_of(variant, null + share * (start - null))}
        again = refit(balances, dataclasses.replace(fitted.model, choice=choice), variants, weights, tilts=tilts)
        if best is None or again.cost < best.cost:
            best = again
        if best.cost < fitted.cost - 0.5 * one.gain:
            break
    assert best is not None
    gain = max(fitted.cost - best.cost, 0.0)
    added = effect(balances, fitted.model, {variant.name: best.model.choice[variant.name]})
    return Trial(dataclasses.replace(one, gain=gain), free, best, added.multiple, tilt)


def _rolling(balances: Balances, search: Search, found: Sequence[Found]) -> tuple[Found, np.ndarray] | None:
    """Return the wheel radius that free rolling contradicts most, if beyond what is normal."""
    change = rolling_radii(balances.campaign) / balances.radius - 1.0
    axle = int(np.argmax(np.abs(change)))
    if abs(change[axle]) < ABNORMAL_RADIUS:
        return None
    template = next((one for one in found if one.name == "wheel_radius"), None)
    if template is None:
        return None
    which = next(
        i
        for i, c in enumerate(search.data.candidates)
        if c.variant and c.name == "wheel_radius" and c.variant.fixed["axle"] == axle + 1
    )
    gain = search.gain(search.data.columns_of(which))
    return dataclasses.replace(template, which=which, fit=gain, gain=gain.gain), np.array([change[axle]])


def expected(search: Search, one: Found) -> float:
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


def columns_in(null: Scan, variant: Variant) -> np.ndarray:
    """Columns of a mechanism in a null scan: those of all its variants with the same fixed parameters, or the nearest."""
    members = [i for i, one in enumerate(null.candidates) if one.variant and one.variant.name == variant.name]
    same = [i for i in members if variant.fixed.items() <= (null.candidates[i].variant or variant).fixed.items()]
    return null.columns_of((same or members)[0])


def _alternatives(found: Sequence[Found], trials: Sequence[Trial]) -> tuple[tuple[str, ...], float]:
    """Return the names that gain nearly as much, best first, and the share of belief in the best."""
    best = trials[0].found
    net = {one.name: one.gain - float(one.nulls.mean()) for one in found if one.name in ALL}
    top = best.gain - float(best.nulls.mean())
    # Without a refit a name is worth its linear gain, which cannot be more than the best refit's.
    net = {name: min(gain, top) for name, gain in net.items()}
    net |= {one.found.name: one.found.gain - float(one.found.nulls.mean()) for one in trials}
    margin = max(INDISTINCT, SHARE_OF_GAIN * top)
    near = sorted((name for name, gain in net.items() if gain >= top - margin and name != best.name), key=lambda n: -net[n])
    scale = max(2.0, 0.03 * top)
    belief = 1.0 / sum(float(np.exp(min((gain - top) / (2.0 * scale), 0.0))) for gain in net.values())
    return (best.name, *near), belief * (1.0 - 10.0 ** -min(best.surprise, 15.0))
