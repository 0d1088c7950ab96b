"""What the points of creep curves leave open: intervals, correlations, and parameters that compensate each other."""

import copy
from collections.abc import Callable

import numpy as np
from scipy.stats import rankdata

from wsp_env.contact.polach import falling_friction
from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.creep_curves.answer import Inseparable
from wsp_env.diagnosis.creep_curves.model import CurveFit, creep_mechanisms
from wsp_env.diagnosis.creep_curves.search import CreepSearch, Reductions

_CLOSE = 0.9  # correlation from which on two parameters count as inseparable
_LOST = 2.71  # increase of chi-square (squares over the scatter's variance) at the ends of a parameter's 90 % interval
_PROFILE = 25  # number of values tried in a parameter's profile
_RADII = np.linspace(-0.02, 0.02, 9)  # relative errors of the wheel radius that are tried: assumption, unmeasured wear


def quantities(search: CreepSearch, fit: CurveFit) -> dict[str, float]:
    """Return the sizes of a fit, by "mechanism.parameter", and its kinetic friction."""
    keys = [f"{name}.{p.name}" for name in fit.names for p in search.model.sizes(name)]
    law = search.model.law(search.model.choice(fit.names, fit.values))
    kinetic = search.model.kinetic_friction(float(fit.values[0]), law)
    return {"kinetic_friction": kinetic, **dict(zip(keys, map(float, fit.values[1:]), strict=True))}


def mechanism_of(key: str) -> str:
    """Return the mechanism in a key "mechanism.parameter"."""
    return key.partition(".")[0]


def _meaning(search: CreepSearch, fit: CurveFit) -> dict[str, tuple[float, str]]:
    """Return properties of the fitted law by name, with value and unit."""
    model = search.model
    law = model.law(model.choice(fit.names, fit.values))
    mu = model.kinetic_friction(float(fit.values[0]), law)
    return {
        "friction at the mean slip speed": (float(fit.values[0]), "-"),
        "static friction": (float(falling_friction(0.0, mu, law.ratio_r, law.gamma_r)), "-"),
        "kinetic friction": (mu, "-"),
        "friction decrease rate": (law.gamma_r, "s/m"),
        "initial slope": (4.0 / np.pi * law.stiffness / model.contact.wheel_load_n, "-"),
    }


class Spread:
    """Fits that the points cannot distinguish from the best one: refits to null recordings, and each size's profile.

    A profile fixes one size at a value and fits the others. Values are kept while chi-square is within the 90 % interval. Null
    recordings alone would give too small an uncertainty if the best fit is at a bound.
    """

    def __init__(self, search: CreepSearch, fit: CurveFit, last: Reductions) -> None:
        self.search, self.fit, self.refits = search, fit, last.refits
        sizes = [(f"{name}.{p.name}", p) for name in fit.names for p in search.model.sizes(name)]
        self.bounds = {key: (p.low, p.high) for key, p in sizes}
        self.profiles = {key: self._profile(key, p.low, p.high) for key, p in sizes}

    def _profile(self, key: str, low: float, high: float) -> list[tuple[float, CurveFit]]:
        """Return the values of a size that fit as well, ascending, each with its fit."""
        search, fit = self.search, self.fit
        spaced = low + (high - low) * np.linspace(0.0, 1.0, _PROFILE) ** 2  # denser at small sizes
        kept = []
        for value in sorted({quantities(search, fit)[key], *map(float, spaced)}):
            held = search.model.fit(fit.names, search.measured, fit, held={key: value})
            if held.cost - fit.cost <= _LOST * search.variance:
                kept.append((value, held))
        return kept

    def interval(self, of: Callable[[CurveFit], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the 90 % interval of a function of the fit, elementwise: the union over null recordings and profiles."""
        low, high = np.quantile([of(one) for one in self.refits], (0.05, 0.95), axis=0)
        along = [of(self.fit), *(of(one) for profile in self.profiles.values() for _, one in profile)]
        return np.minimum(low, np.min(along, axis=0)), np.maximum(high, np.max(along, axis=0))


def estimates(spread: Spread) -> tuple[dict[str, dict[str, Estimate]], dict[str, Estimate]]:
    """Return every mechanism's parameters and the law's quantities, with 90 % intervals."""
    search, fit = spread.search, spread.fit
    low, high = spread.interval(lambda one: one.values)
    values = zip(map(float, fit.values[1:]), map(float, low[1:]), map(float, high[1:]), strict=True)
    found: dict[str, dict[str, Estimate]] = {}
    for name in fit.names:
        found[name] = {}
        for p in search.model.sizes(name):
            value, lowest, highest = next(values)
            found[name][p.name] = Estimate(value, p.unit, (lowest, highest))
    meaning = _meaning(search, fit)
    low, high = spread.interval(lambda one: np.array([value for value, _ in _meaning(search, one).values()]))
    law = {
        key: Estimate(value, unit, (float(low[i]), float(high[i]))) for i, (key, (value, unit)) in enumerate(meaning.items())
    }
    return found, law


def correlations(spread: Spread) -> dict[str, dict[str, float]]:
    """Return the rank correlations of all estimates over null recordings of the fit."""
    values = [quantities(spread.search, one) for one in spread.refits]
    names = list(values[0])
    ranks = np.column_stack([rankdata([one[name] for one in values]) for name in names])
    ranks -= ranks.mean(axis=0)
    lengths = np.linalg.norm(ranks, axis=0)
    matrix = ranks.T @ ranks / np.where(np.outer(lengths, lengths) > 0.0, np.outer(lengths, lengths), 1.0)
    return {a: {b: float(matrix[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)}


def inseparable(spread: Spread) -> tuple[Inseparable, ...]:
    """Return each size that other parameters compensate: its range, and the values of the others at the ends."""
    matrix, found = correlations(spread), []
    for key, profile in spread.profiles.items():
        tied = [other for other, r in matrix[key].items() if other != key and abs(r) >= _CLOSE]
        ends = [(value, quantities(spread.search, one)) for value, one in (profile[0], profile[-1])]
        open_ended = [value for value in spread.bounds[key] if value in (ends[0][0], ends[1][0])]
        if tied or open_ended:
            own = mechanism_of(key)
            others = [other for other in matrix if other in tied or (mechanism_of(other) == own and other != key)]
            found.append(_said(key, others or [other for other in matrix if other != key], ends, open_ended, matrix[key]))
    return tuple(found)


def _said(
    key: str, others: list[str], at: list[tuple[float, dict[str, float]]], open_ended: list[float], row: dict[str, float]
) -> Inseparable:
    (low, first), (high, last) = at
    ends = {other: (first[other], last[other]) for other in others}
    along = ", ".join(f"{other} {a:.3g} to {b:.3g} (rank correlation {row[other]:+.2f})" for other, (a, b) in ends.items())
    bound = f"; {' and '.join(f'{value:g}' for value in open_ended)} is its bound, the points set none" if open_ended else ""
    text = f"{key} anywhere from {low:.3g} to {high:.3g} fits as well{bound}; with it go {along}"
    return Inseparable((key, *others), (low, high), ends, text)


def radius_note(search: CreepSearch, fit: CurveFit) -> str:
    """Return a note on the sizes that an error of the wheel radius, and thus of all creepages, would change; "" if none."""
    moved = [f"{name}.{shows.moved_by_radius}" for name, shows in creep_mechanisms().items() if shows.moved_by_radius]
    moved = [key for key in moved if mechanism_of(key) in fit.names]
    if not moved:
        return ""
    kept = []
    for change in map(float, _RADII):
        other = copy.copy(search.model)
        other.creepage = 1.0 - (1.0 + change) * (1.0 - search.model.creepage)
        if other.creepage.min() > 0.0:
            found = other.fit(fit.names, search.measured, fit)
            kept.append((found.cost, change, quantities(search, found)))
    allowed = [one for one in kept if one[0] - fit.cost <= _LOST * search.variance]
    changes = [one[1] for one in allowed]
    sizes = ", ".join(f"{key} {allowed[0][2][key]:.2f} to {allowed[-1][2][key]:.2f}" for key in moved)
    return (
        "an error of the wheel radius shifts all creepages and is not searched: its trace is in free rolling, which points "
        f"that slide do not show; of radii up to {_RADII[-1]:.0%} off, those {min(changes):+.1%} to {max(changes):+.1%} off "
        f"fit as well, with {sizes}"
    )
