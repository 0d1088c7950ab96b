"""The search: what each candidate would explain, linearised about a model, beside all normal variation.

Sound recordings differ from any model in many small ways. All of these, the library's mechanisms included, are in the model at
sizes too small to matter (`SMALL` smallest effects of interest, see `interest`). A mechanism is missing if the recordings show
that it is larger. Its evidence is the log ratio of the likelihoods with its size free (prior deviation `LARGE`) and with its
size small (spike and slab, George and McCulloch 1993).
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from wsp_env.diagnosis.balances import Rows, Whitening
from wsp_env.diagnosis.candidates import Candidate, Variant, columns, parameter_of
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.net import Law, candidate, net_by_run
from wsp_env.diagnosis.noise import Noise, NoiseParameters, noise_from_parameters, noise_of
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.triangular import inverse_of
from wsp_env.diagnosis.variation import Group

#: Prior standard deviations of a mechanism that does not matter, and of one that does, in smallest effects of interest
#: (assumptions: many small ones together move a stop by less than one smallest effect of interest; effects that pass a
#: validation unnoticed are hardly larger than `LARGE`).
SMALL, LARGE = 0.15, 5.0
#: Evidence from which on a mechanism counts as detected: 95 % at prior odds of one in fifty.
SEEN = float(np.log(19.0 * 50.0))
#: Length of the stretches of a single run that are held out in turn [s]: a few slides.
_STRETCH_S = 4.0


@dataclasses.dataclass(frozen=True)
class Found:
    """Result of the search for one candidate."""

    candidate: Candidate  # without its columns
    evidence: float  # log likelihood ratio, size large over size small, less the log of the number of variants
    amplitude: np.ndarray  # (k,) of its columns
    multiple: np.ndarray  # (k,) in smallest effects of interest
    deviation: np.ndarray  # (k,) standard deviations of the multiples
    reduction: float  # of chi-square, against the same mechanism at its small size

    @property
    def name(self) -> str:
        """Name of the candidate."""
        return self.candidate.variant.title


@dataclasses.dataclass(frozen=True)
class Screen:
    """Result of the search for all candidates about a model."""

    model: Model
    about: Model  # model of the replica
    base: np.ndarray  # (n,) raw residuals of the recordings
    whitening: Whitening
    groups: tuple[Group, ...]  # nuisances
    small: Group  # mechanisms at sizes that do not matter
    small_names: tuple[str, ...]  # (k,) mechanisms of their columns
    times: Group  # the small mechanisms whose size is a time
    sizes: Sizes  # of the nuisances
    colour: np.ndarray  # (p,) autoregression of sliding wheels' rows
    found: tuple[Found, ...]  # best first
    second: Mapping[str, Found]  # the second-best variant of each name

    def small_of(self, variants: Sequence[Variant]) -> np.ndarray:
        """Return the columns (n, k) of the small mechanisms of the same names, scaled by their standard deviations."""
        names = {one.name for one in variants}
        mine = np.array([name in names for name in self.small_names], dtype=bool)
        result: np.ndarray = self.small.columns[:, mine] * self.small.expected
        return result

    @property
    def noise(self) -> Noise:
        """Normal variation about the model."""
        return Noise(self.groups, self.whitening, self.colour, self.sizes)

    @property
    def noise_parameters(self) -> NoiseParameters:
        """What it tells about the noise of similar residuals."""
        return NoiseParameters(self.sizes, self.colour)


def screen(
    replica: Replica, model: Model, tried: Sequence[Variant], accepted: Sequence[Variant] = (),
    noise_parameters: NoiseParameters | None = None,
) -> Screen:  # fmt: skip
    """Search all candidates about a model.

    Parameters
    ----------
    tried : mechanisms that are off
    accepted : mechanisms that are on
    noise_parameters : sizes and colour of the noise; None: they are estimated

    """
    base = replica.raw(model)
    nothing = np.zeros((len(base), 0))
    on = [columns(replica, model, base, one) for one in accepted]
    free = Group("accepted mechanisms", np.column_stack([nothing, *on]), np.inf, True)
    noise = (
        noise_of(replica, model, base, [free])
        if noise_parameters is None
        else noise_from_parameters(noise_parameters, replica, model, base)
    )
    groups, whitening = noise.groups, noise.whitening
    law = Law(replica, model, base, whitening)
    listed = side_by_side(lambda one: candidate(replica, model, base, law, one), tried)
    named = [one for one in listed if not one.variant.family]
    unnamed = [one for one in listed if one.variant.family]
    # The small prior applies to all variants of a mechanism together.
    shares = _shares(named)
    every = [one.columns / one.scale * share for one, share in zip(named, shares, strict=True)]
    small = Group("small mechanisms", net_by_run(law, np.column_stack([nothing, *every]), replica.rows.run), SMALL, True)
    names = tuple(one.variant.name for one in named for _ in one.variant.sizes)
    late = [parameter_of(one.variant.name, name).unit == "s" for one in named for name in one.variant.sizes]
    times = small._replace(columns=small.columns[:, np.array(late, dtype=bool)])
    terms = law.net(np.column_stack([nothing, *(one.columns / one.scale for one in unnamed)]))[0]
    evidence = Evidence(replica, whitening, [*groups, free, small], base, terms, last=True)
    sizes = evidence.solve(Sizes(np.append(noise.sizes.groups, [1.0, 1.0]), noise.sizes.noise))
    found, second = _judged(evidence, sizes, named, unnamed)
    kept = Sizes(sizes.groups[: len(groups)], sizes.noise)
    return Screen(model, replica.about, base, whitening, groups, small, names, times, kept, noise.colour, tuple(found), second)


def held_out_rows(rows: Rows) -> np.ndarray:
    """Return the mask (n,) of the rows to validate on.

    It is the validate group. If there is none, or nothing else, it is every other run; in a single run, every other stretch.
    """
    if rows.validate.any() and not rows.validate.all():
        return rows.validate
    turns = rows.run if rows.run.max(initial=0) > 0 else np.floor(rows.time / _STRETCH_S).astype(int)
    result: np.ndarray = turns % 2 == 1
    return result


def detectable(seen: Screen) -> dict[str, dict[str, float]]:
    """Return for each name the smallest detectable change of each size, at an evidence of `SEEN`.

    Sizes of which no possible change would have been seen are left out.
    """
    found: dict[str, dict[str, float]] = {}
    for one in seen.found:
        variant = one.candidate.variant
        if not variant.family:
            small, large = one.deviation**2 + SMALL**2, one.deviation**2 + LARGE**2
            multiple = np.sqrt(2.0 * small * (SEEN + 0.5 * np.log(large / small)))
            sizes = multiple / one.candidate.scale * np.abs(variant.moves())
            ends = [parameter_of(variant.name, name) for name in variant.sizes]
            found[variant.name] = {
                end.name: float(size) for end, size in zip(ends, sizes, strict=True) if size <= end.high - end.low
            }
    return found


def _judged(
    evidence: Evidence, sizes: Sizes, named: Sequence[Candidate], unnamed: Sequence[Candidate]
) -> tuple[list[Found], dict[str, Found]]:
    """Return the best variant of each name, best first, and the second-best of each.

    Names are judged with all others at small sizes. Terms without a name are many and similar; each is judged alone.
    """
    mean, covariance, alone = _posterior(evidence, sizes)
    first = len(mean) - sum(len(one.scale) for one in named)
    counts: dict[str, int] = {}
    for one in (*named, *unnamed):
        counts[one.variant.name] = counts.get(one.variant.name, 0) + 1
    found = []
    for one, share in zip(named, _shares(named), strict=True):
        mine = slice(first, first + len(one.scale))
        first += len(one.scale)
        small = SMALL * share
        found.append(_one(one, *_freed(mean[mine], covariance[mine, mine], small), counts[one.variant.name], small))
    last = 0
    for one in unnamed:
        mine = slice(last, last + len(one.scale))
        last += len(one.scale)
        found.append(_one(one, *alone(mine), counts[one.variant.name]))
    best: dict[str, Found] = {}
    second: dict[str, Found] = {}
    for each in sorted(found, key=lambda one: -one.evidence):
        if each.name in best:
            second.setdefault(each.name, each)
        best.setdefault(each.name, each)
    return list(best.values()), second


def _posterior(
    evidence: Evidence, sizes: Sizes
) -> tuple[np.ndarray, np.ndarray, Callable[[slice], tuple[np.ndarray, np.ndarray]]]:
    """Return mean (c,) and covariance (c, c) of common nuisances, in deviations, and a function for other columns alone.

    The last group of the nuisances comes last.
    """
    solved = evidence.eliminated(sizes)
    c = solved.nuisances
    mean = solved.solution(len(solved.rest) - 1)[1]
    across = solved.rest[:c, c:-1]
    gram = solved.rest[c:-1, c:-1] - across.T @ solved.of_common(across)
    against = solved.rest[c:-1, -1] - across.T @ mean

    def alone(mine: slice) -> tuple[np.ndarray, np.ndarray]:
        own = gram[mine, mine]
        spread = np.linalg.inv(own + 1e-9 * max(float(np.trace(own)), 1e-12) * np.eye(len(own)))
        return spread @ against[mine], spread

    return mean, inverse_of(solved.factor), alone


def _shares(named: Sequence[Candidate]) -> list[float]:
    """Return the share of the small size for one variant of each mechanism."""
    names = [one.variant.name for one in named]
    return [1.0 / float(np.sqrt(names.count(name))) for name in names]


def _freed(mean: np.ndarray, covariance: np.ndarray, small: float) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (k,) and covariance of the likelihood of sizes, from the posterior with small prior in units of `small`."""
    mean, covariance = small * mean, small**2 * covariance
    precision = np.linalg.inv(covariance) - np.eye(len(mean)) / small**2
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    spread = (vectors / np.maximum(values, 1e-9)) @ vectors.T
    return spread @ np.linalg.solve(covariance, mean), spread


def _one(one: Candidate, centre: np.ndarray, spread: np.ndarray, variants: int, least: float = SMALL) -> Found:
    """Judge one candidate from the likelihood of its size: centre (k,) and covariance (k, k)."""
    k = len(centre)
    small, large = np.eye(k) * least**2, np.eye(k) * LARGE**2

    def log_density(prior: np.ndarray) -> float:
        whole = spread + prior
        return float(-0.5 * centre @ np.linalg.solve(whole, centre) - 0.5 * np.linalg.slogdet(whole)[1])

    multiple = large @ np.linalg.solve(spread + large, centre)
    bare = dataclasses.replace(one, columns=np.zeros((0, k)))
    found = Found(
        bare, log_density(large) - log_density(small) - float(np.log(variants)), multiple / one.scale, multiple,
        np.sqrt(np.diag(spread)), float(centre @ np.linalg.solve(spread + small, centre)),
    )  # fmt: skip
    return found if is_possible(one, found.amplitude) else dataclasses.replace(found, evidence=-np.inf)


def is_possible(one: Candidate, amplitude: np.ndarray) -> bool:
    """Whether the fitted size is possible: if the null of a single size is a bound, only one side is (no brake pushes)."""
    if len(one.variant.sizes) != 1:
        return True
    size = parameter_of(one.variant.name, one.variant.sizes[0])
    moved = -float(amplitude[0]) * float(one.variant.moves()[0])
    may_fall = size.null > size.low and not one.variant.above
    return (may_fall or moved >= 0.0) and (size.null < size.high or moved <= 0.0)
