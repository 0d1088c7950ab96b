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
from wsp_env.diagnosis.candidates import Candidate, Variant, columns, located, parameter_of, switched, without
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.evaluate import Evaluation, Model
from wsp_env.diagnosis.interest import Compared, StopChange, only_sensors
from wsp_env.diagnosis.noise import Noise, NoiseParameters, noise_from_parameters, noise_of
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.triangular import inverse_of
from wsp_env.diagnosis.variation import Group, Net, law_columns, segment_columns
from wsp_env.plant.mechanisms import ALL

#: Prior standard deviations of a mechanism that does not matter, and of one that does, in smallest effects of interest
#: (assumptions: many small ones together move a stop by less than one smallest effect of interest; effects that pass a
#: validation unnoticed are hardly larger than `LARGE`).
SMALL, LARGE = 0.15, 5.0
#: Lower bound of the smallest effect of interest of a time, in samples; of a rolled distance, at the stops' median speed.
#: Channels of one logger are read within a sample of each other; the small size is then 0.6 of a sample.
_SAMPLES = 4.0
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


class _Law:
    """Derivatives of residuals and adhesion by the law's parameters, for net effects."""

    def __init__(self, replica: Replica, model: Model, base: np.ndarray, whitening: Whitening) -> None:
        segments = segment_columns(replica)
        self._segments = segments.shape[1]
        self.compared = Compared(replica, replica.evaluate(model))
        self._net, self._whitening = Net(whitening, np.column_stack([segments, law_columns(replica, model, base)])), whitening
        self._rest = whitening(self.net(base[:, None])[0])[:, 0]
        little = 1e-3
        tau = replica.evaluate(dataclasses.replace(model, tau=model.tau * float(np.exp(little))))
        mu = replica.evaluate(dataclasses.replace(model, mu_cd=tuple(m * float(np.exp(little)) for m in model.mu_cd)))
        self._by = [
            ((a.adhesion - one.adhesion) / little, (b.adhesion - one.adhesion) / little)
            for one, a, b in zip(self.compared.before, tau, mu, strict=True)
        ]

    def grows(self, column: np.ndarray) -> bool:
        """Whether the weighted residual grows along a column (n,) after refitting the law."""
        return bool(self._whitening(self.net(column[:, None])[0])[:, 0] @ self._rest > 0.0)

    def net(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return columns (n, k) after refitting the law, and the changes (1 + runs, k) of log tau and log mu_cd by it."""
        left, amplitudes = self._net(columns)
        return left, amplitudes[self._segments :]

    def without(self, after: Sequence[Evaluation], logs: np.ndarray) -> list[Evaluation]:
        """Return evaluations with changes (1 + runs,) of log tau and log mu_cd subtracted."""
        return [
            dataclasses.replace(one, adhesion=one.adhesion - logs[0] * by_tau - logs[1 + i] * by_mu)
            for i, (one, (by_tau, by_mu)) in enumerate(zip(after, self._by, strict=True))
        ]


def candidate(replica: Replica, model: Model, base: np.ndarray, law: _Law, variant: Variant) -> Candidate:
    """Return a mechanism that is off, with its columns about a model and their net size in smallest effects of interest."""
    found, scale, moves = [], [], variant.moves()
    sensor, swings = only_sensors({variant.name: {}}), ALL[variant.name].signature.swings

    def step_by(i: int, move: float) -> tuple[np.ndarray, np.ndarray, Sequence[Evaluation]]:
        values = variant.null()
        values[i] += move
        moved = switched(model, variant, values)
        column = replica.raw(moved) - base
        return column, law.net(column[:, None])[1][:, 0], replica.evaluate(moved)

    for i, move in enumerate(moves):
        column, logs, after = step_by(i, move)
        size = parameter_of(variant.name, variant.sizes[i])
        # A nonlinear effect is stepped to the side that the residual asks for. A term is linear, and so is what acts at a
        # place: a patch of more or less friction has the same column within 4 % of its length.
        if size.null > size.low and not variant.family and not located(variant) and law.grows(column):
            moves[i] = -move
            column, logs, after = step_by(i, -move)
        found.append(column)
        multiple = law.compared.change(after if sensor else law.without(after, logs), sensor, swings).multiple
        scale.append(min(multiple, _samples(replica, variant.name, variant.sizes[i], move) / _SAMPLES))
    return Candidate(dataclasses.replace(variant, steps=tuple(moves)), np.column_stack(found), np.array(scale))


def _samples(replica: Replica, name: str, size: str, move: float) -> float:
    """Return a change of a time in samples, or of a rolled distance at the stops' median speed; infinity for other sizes."""
    parameter = parameter_of(name, size)
    if parameter.unit != "s" and not parameter.rolled:
        return np.inf
    seconds = abs(move) / (float(np.median(replica.rows.speed)) if parameter.rolled else 1.0)
    return seconds / replica.sample_s


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
    law = _Law(replica, model, base, whitening)
    listed = side_by_side(lambda one: candidate(replica, model, base, law, one), tried)
    named = [one for one in listed if not one.variant.family]
    unnamed = [one for one in listed if one.variant.family]
    # The small prior applies to all variants of a mechanism together.
    shares = _shares(named)
    every = [one.columns / one.scale * share for one, share in zip(named, shares, strict=True)]
    small = Group("small mechanisms", _net_by_run(law, np.column_stack([nothing, *every]), replica.rows.run), SMALL, True)
    names = tuple(one.variant.name for one in named for _ in one.variant.sizes)
    late = [parameter_of(one.variant.name, name).unit == "s" for one in named for name in one.variant.sizes]
    times = small._replace(columns=small.columns[:, np.array(late, dtype=bool)])
    terms = law.net(np.column_stack([nothing, *(one.columns / one.scale for one in unnamed)]))[0]
    evidence = Evidence(replica, whitening, [*groups, free, small], base, terms, last=True)
    sizes = evidence.solve(Sizes(np.append(noise.sizes.groups, [1.0, 1.0]), noise.sizes.noise))
    found, second = _judged(evidence, sizes, named, unnamed)
    kept = Sizes(sizes.groups[: len(groups)], sizes.noise)
    return Screen(model, replica.about, base, whitening, groups, small, names, times, kept, noise.colour, tuple(found), second)


def _net_by_run(law: _Law, columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return columns (n, k) after refitting the law; what acts in one run only stays in it, although tau is common."""
    runs, place = np.unique(run, return_inverse=True)
    touched = np.array([columns[run == one].any(axis=0) for one in runs])
    return np.where(touched[place] | (touched.sum(axis=0) != 1), law.net(columns)[0], 0.0)


def net_effect(replica: Replica, model: Model, variant: Variant, whitening: Whitening) -> StopChange:
    """Return the change of the stops by a mechanism that is on, against the law refitted without it."""
    sensor, swings = only_sensors({variant.name: {}}), ALL[variant.name].signature.swings
    return net_change(replica, model, without(model, variant), whitening, sensor, swings)


def net_change(
    replica: Replica, model: Model, off: Model, whitening: Whitening, sensor: bool = False, swings: bool = False
) -> StopChange:  # fmt: skip
    """Return the change of the stops by a model, against another model `off` with refitted law."""
    after, base = replica.evaluate(model), replica.raw(off)
    law = _Law(replica, off, base, whitening)
    if sensor:
        return law.compared.change(after, True)
    logs = law.net((replica.raw(model) - base)[:, None])[1][:, 0]
    return law.compared.change(law.without(after, logs), swings=swings)


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
