"""Decides: forward selection among the library's mechanisms, what they cannot be told from, and whether structure remains."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import Variant, choice_of, parameter_of, refined
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.interest import effect
from wsp_env.diagnosis.search import Found, LibrarySearch, Scan, scan
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import rolling_radii

#: Minus log10 of the probability in a null recording from which on a mechanism counts; some twenty names are searched.
NEG_LOG10_P = 4.0
#: Size over the smallest effect of interest from which on a mechanism counts.
LEAST_MULTIPLE = 0.5
#: Reduction of chi-square over the largest one in null recordings, and itself, from which on a mechanism counts: whatever few
#: null recordings say of tails.
OVER_NULLS = 2.0
LEAST_REDUCTION = 25.0
#: Share of the runs' part of the reduction that must show on the runs to validate, but for what chance may take of it.
HELD_OUT_SHARE = 0.4
CHANCE = 1.645  # 5 % of true ones would show less
#: Another mechanism must reduce chi-square by this share of what the first did, times their squared cosine: less is the first
#: one's form.
LEAST_SHARE = 0.08
#: And this share whatever the cosine: in general; where no balance shows both, or the vehicle's shows it but not the first; and
#: where the first has but one form, so that next to nothing of it is left.
LEAST_SHARE_ANY = 0.03
LEAST_SHARE_APART = 0.005
LEAST_SHARE_EXACT = 0.002
#: Alternatives: reductions within this share of the best one's, or within `INDISTINCT`.
SHARE_OF_REDUCTION = 0.1
INDISTINCT = 9.0
MOST = 3
#: Mechanisms that are refitted in every round.
TRIED = 5


@dataclasses.dataclass(frozen=True)
class Accepted:
    """A mechanism that was accepted, and how."""

    found: Found
    listed: Variant  # as the scans have it
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
        alternatives, confidence = _alternatives(best, [one.found for one in passed[1:]] + others)
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
        if lost < _least(search, one.found, one.listed, [dataclasses.replace(last, found=whole)]):
            return _needed(balances, without, search, [*others[:-1], dataclasses.replace(last, found=whole)], weights)
    return accepted, fitted


@dataclasses.dataclass(frozen=True)
class Trial:
    """A mechanism refitted together with those accepted before."""

    found: Found  # with the reduction of the refit
    listed: Variant  # as the scans have it
    variant: Variant  # with what the refit moves free
    fitted: Fitted
    multiple: float
    tilt: np.ndarray


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
        if trial.found.reduction > _least(search, one, trial.listed, accepted) and held_out:
            there.append(trial)
    there.sort(key=lambda trial: -trial.found.net)
    passed = [
        t for i, t in enumerate(there) if t.multiple >= LEAST_MULTIPLE and not _normal(t) and not _shadow(search, t, there[:i])
    ]
    return passed, left


def _normal(trial: Trial) -> bool:
    """Whether sound vehicles vary as much."""
    name = trial.variant.name
    normal, values = ALL[name].signature.normal, trial.fitted.model.choice[name]
    return bool(normal) and all(abs(values[size] - parameter_of(name, size).null) < most for size, most in normal.items())


def _shadow(search: LibrarySearch, trial: Trial, better: Sequence[Trial]) -> bool:
    """Whether little is left of a mechanism beside one that explains more but is too small to matter."""
    index = search.data.columns_of(trial.found.which)
    small = [search.data.columns_of(one.found.which) for one in better if one.multiple < LEAST_MULTIPLE]
    least = _least(search, trial.found, trial.listed, ())
    return any(search.solve(index, beside=columns).reduction <= least for columns in small)


def _least(search: LibrarySearch, one: Found, listed: Variant, accepted: Sequence[Accepted]) -> float:
    """Return the reduction of chi-square that a mechanism must reach, beside those accepted before."""
    least = max(LEAST_REDUCTION, OVER_NULLS * float(one.nulls.max()))
    null = search.nulls[0]
    for other in accepted:
        cosine = largest_cosine(null.whole.gram, columns_in(null, listed), columns_in(null, other.listed))
        least = max(least, max(LEAST_SHARE * cosine**2, _floor(one.name, other.found.name)) * other.found.reduction)
    return least


def _floor(one: str, other: str) -> float:
    """Return the share of `other`'s reduction that `one` must reach beside it."""
    if ALL[other].signature.exact:
        return LEAST_SHARE_EXACT
    mine, its = (ALL[name].signature.balances for name in (one, other))
    # No wrong form of a contact's mechanism looks like a force on the vehicle.
    return LEAST_SHARE_APART if not mine & its or "vehicle" in mine - its else LEAST_SHARE_ANY


def least_held_out(expected: float) -> float:
    """Return the reduction on held-out runs from which on an effect counts as seen there (one of g scatters by 2 sqrt(g))."""
    return HELD_OUT_SHARE * expected - CHANCE * 2.0 * float(np.sqrt(max(expected, 0.0)))


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
    seen = search.held_out(index) >= least_held_out(_part(search, index) * search.solve(index).reduction)
    return {one.name for one in pair} if seen else set()


def expected(search: LibrarySearch, one: Found) -> float:
    """Share of the reduction that the runs to validate would have by their part of the columns' squares."""
    return _part(search, search.data.columns_of(one.which)) * one.reduction


def _part(search: LibrarySearch, index: np.ndarray) -> float:
    part = np.trace(search.data.validate.gram[np.ix_(index, index)]) / max(
        np.trace(search.data.whole.gram[np.ix_(index, index)]), 1e-12
    )
    return float(min(part, 1.0))


def _variant(search: LibrarySearch, one: Found) -> Variant:
    variant = search.data.candidates[one.which].variant
    if variant is None:
        raise ValueError(f"{one.name} is no mechanism")
    return variant


def _null(variant: Variant) -> np.ndarray:
    return np.array([parameter_of(variant.name, name).null for name in variant.sizes])


def columns_in(null: Scan, variant: Variant) -> np.ndarray:
    """Columns of a mechanism in a null scan: those of all its variants with the same fixed parameters, or the nearest."""
    members = [i for i, one in enumerate(null.candidates) if one.variant and one.variant.name == variant.name]
    same = [i for i in members if variant.fixed.items() <= (null.candidates[i].variant or variant).fixed.items()]
    return null.columns_of((same or members)[0])


def _alternatives(best: Trial, others: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names that explain nearly as much, best first, and the share of belief in the best."""
    top = best.found.net
    # Without a refit a name is worth its linear reduction, which cannot be more than the best refit's.
    net = {one.name: min(one.net, top) for one in others}
    margin = max(INDISTINCT, SHARE_OF_REDUCTION * top)
    near = sorted((name for name in net if net[name] >= top - margin), key=lambda name: -net[name])
    scale = max(2.0, 0.03 * top)
    belief = 1.0 / (1.0 + sum(float(np.exp((one - top) / (2.0 * scale))) for one in net.values()))
    return (best.found.name, *near), belief * (1.0 - 10.0 ** -min(best.found.neg_log10_p, 15.0))
