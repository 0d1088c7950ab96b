"""The rules of the decision, each a function of its own: what counts, what is normal variation or a shadow, what is as good."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.candidates import Variant, parameter_of
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.search import Found, LibrarySearch, Scan
from wsp_env.plant.mechanisms import ALL

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
class Trial:
    """A mechanism refitted together with those accepted before."""

    found: Found  # with the reduction of the refit
    listed: Variant  # as the scans have it
    variant: Variant  # with what the refit moves free
    fitted: Fitted
    multiple: float
    tilt: np.ndarray


def is_normal(trial: Trial) -> bool:
    """Whether sound vehicles vary as much."""
    name = trial.variant.name
    normal, values = ALL[name].signature.normal, trial.fitted.model.choice[name]
    return bool(normal) and all(abs(values[size] - parameter_of(name, size).null) < most for size, most in normal.items())


def is_shadow(search: LibrarySearch, trial: Trial, better: Sequence[Trial]) -> bool:
    """Whether little is left of a mechanism beside one that explains more but is too small to matter."""
    index = search.data.columns_of(trial.found.which)
    small = [search.data.columns_of(one.found.which) for one in better if one.multiple < LEAST_MULTIPLE]
    least = least_reduction(search, trial.found, trial.listed, ())
    return any(search.solve(index, beside=columns).reduction <= least for columns in small)


def least_reduction(search: LibrarySearch, one: Found, listed: Variant, accepted: Sequence[Accepted]) -> float:
    """Return the reduction of chi-square that a mechanism must reach, beside those accepted before."""
    least = max(LEAST_REDUCTION, OVER_NULLS * float(one.nulls.max()))
    null = search.nulls[0]
    for other in accepted:
        cosine = largest_cosine(null.whole.gram, columns_in(null, listed), columns_in(null, other.listed))
        least = max(least, max(LEAST_SHARE * cosine**2, least_share(one.name, other.found.name)) * other.found.reduction)
    return least


def least_share(one: str, other: str) -> float:
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


def expected(search: LibrarySearch, one: Found) -> float:
    """Share of the reduction that the runs to validate would have by their part of the columns' squares."""
    return held_out_part(search, search.data.columns_of(one.which)) * one.reduction


def held_out_part(search: LibrarySearch, index: np.ndarray) -> float:
    """Share of some columns' squares that lies in the runs to validate [-]."""
    part = np.trace(search.data.validate.gram[np.ix_(index, index)]) / max(
        np.trace(search.data.whole.gram[np.ix_(index, index)]), 1e-12
    )
    return float(min(part, 1.0))


def columns_in(null: Scan, variant: Variant) -> np.ndarray:
    """Columns of a mechanism in a null scan: those of all its variants with the same fixed parameters, or the nearest."""
    members = [i for i, one in enumerate(null.candidates) if one.variant and one.variant.name == variant.name]
    same = [i for i in members if variant.fixed.items() <= (null.candidates[i].variant or variant).fixed.items()]
    return null.columns_of((same or members)[0])


def alternatives_to(best: Trial, others: Sequence[Found]) -> tuple[tuple[str, ...], float]:
    """Return the names that explain nearly as much, best first, and the share of belief in the best."""
    top = best.found.net
    # Without a refit a name is worth its linear reduction, which cannot be more than the best refit's.
    net = {one.name: min(one.net, top) for one in others}
    margin = max(INDISTINCT, SHARE_OF_REDUCTION * top)
    near = sorted((name for name in net if net[name] >= top - margin), key=lambda name: -net[name])
    scale = max(2.0, 0.03 * top)
    belief = 1.0 / (1.0 + sum(float(np.exp((one - top) / (2.0 * scale))) for one in net.values()))
    return (best.found.name, *near), belief * (1.0 - 10.0 ** -min(best.found.neg_log10_p, 15.0))
