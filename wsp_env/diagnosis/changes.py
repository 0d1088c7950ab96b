"""Differences between two campaigns: tau, mu_cd and mechanisms, each with an interval and whether the data show a change.

Uses: before and after a repair, two seasons, two vehicles of a fleet. A change is shown if the interval of the difference
excludes zero. Otherwise the interval gives the size that a change may have.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from wsp_env.diagnosis.answer import Diagnosis, Estimate
from wsp_env.diagnosis.words import mechanism_words, parameter_words, unit_words
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import Tuning

_Z95 = 1.960  # quantiles of the normal distribution, two-sided
_Z90 = 1.645
_CONFIDENCE = 0.95


class Change(NamedTuple):
    """One quantity in both campaigns, as text."""

    what: str
    first: str
    second: str
    difference: str  # second minus first, with its interval
    shown: bool | None  # whether the data show a change; None if they cannot decide
    words: str


def tau_change(first: Tuning, second: Tuning) -> Change:
    """Compare the recovery rates; their logarithms have approximately normal errors."""
    said_of = [f"{one.tau_m_per_J:.3e} ({one.interval95[0]:.2e} to {one.interval95[1]:.2e})" for one in (first, second)]
    if not (first.determined and second.determined):
        return Change("recovery rate tau [m/J]", said_of[0], said_of[1], "open", None, "tau is open in one of the campaigns")
    ratio = math.log(second.tau_m_per_J / first.tau_m_per_J)
    halves = [0.5 * math.log(one.interval95[1] / one.interval95[0]) for one in (first, second)]
    half = math.hypot(*halves)
    low, high = (100.0 * math.expm1(end) for end in (ratio - half, ratio + half))
    shown = abs(ratio) > half
    difference = f"{100.0 * math.expm1(ratio):+.0f} % ({low:+.0f} to {high:+.0f} %, 95 %)"
    words = f"the rail recovers {'faster' if ratio > 0.0 else 'slower'} by sliding: tau {difference}"
    return Change(
        "recovery rate tau [m/J]",
        said_of[0],
        said_of[1],
        difference,
        shown,
        words if shown else f"tau: no change shown, {difference}",
    )


def friction_change(first: Tuning, second: Tuning) -> Change:
    """Compare the means of mu_cd over the runs that slide, with Welch's interval; the runs are the sample."""
    samples = [np.array([score.mu_cd for score in one.runs.values() if score.slides]) for one in (first, second)]
    what = "friction of the degraded rail mu_cd [-], mean of the runs"
    said_of = [f"{values.mean():.4f} (runs {values.min():.4f} to {values.max():.4f})" if len(values) else "no run slides"
               for values in samples]  # fmt: skip
    if min(map(len, samples)) < 2:
        return Change(what, said_of[0], said_of[1], "open", None, "mu_cd: too few runs slide to compare it")
    parts = [float(values.var(ddof=1)) / len(values) for values in samples]
    difference, squared = float(samples[1].mean() - samples[0].mean()), sum(parts)
    if squared <= 0.0:
        half = 0.0
    else:  # Welch (1947) with Satterthwaite's degrees of freedom
        freedom = squared**2 / sum(part**2 / (len(values) - 1) for part, values in zip(parts, samples, strict=True))
        half = float(stdtrit(freedom, 0.5 + 0.5 * _CONFIDENCE)) * math.sqrt(squared)
    text = f"{difference:+.4f} ({difference - half:+.4f} to {difference + half:+.4f}, 95 %)"
    shown = abs(difference) > half
    words = f"the rail is {'less' if difference > 0.0 else 'more'} slippery: mu_cd {text}"
    return Change(what, said_of[0], said_of[1], text, shown, words if shown else f"mu_cd: no change shown, {text}")


def mechanism_changes(first: Diagnosis, second: Diagnosis) -> list[Change]:
    """Compare every mechanism that at least one diagnosis names, parameter by parameter."""
    named = [{one.name: one for one in found.mechanisms} for found in (first, second)]
    changes = []
    for name in dict.fromkeys([*named[0], *named[1]]):
        sides = [own.get(name) for own in named]
        if sides[0] is not None and sides[1] is not None:
            changes += _both(name, sides[0].parameters, sides[1].parameters)
            continue
        at = 0 if sides[0] is not None else 1
        one = sides[at]
        assert one is not None
        changes.append(_only(name, one.parameters, at, (second, first)[at]))
    return [*changes, *_terms(first, second)]


def _both(name: str, first: dict[str, Estimate], second: dict[str, Estimate]) -> list[Change]:
    changes = []
    for size, one in first.items():
        other = second.get(size)
        if other is None:
            continue
        what = f"{name.replace('_', ' ')}: {parameter_words(size)}"
        unit = "" if one.unit == "-" else f" {one.unit}"
        said_of = [_estimate(estimate) for estimate in (one, other)]
        if one.interval90[0] == one.interval90[1] or other.interval90[0] == other.interval90[1]:  # an axle or a place
            moved = one.value != other.value
            text = f"from {one.value:.4g} to {other.value:.4g}{unit}" if moved else "the same"
            changes.append(
                Change(what, said_of[0], said_of[1], text, moved, f"{what} moves {text}" if moved else f"{what}: the same")
            )
            continue
        half = math.hypot(*(0.5 * (e.interval90[1] - e.interval90[0]) for e in (one, other))) * _Z95 / _Z90
        difference = other.value - one.value
        text = f"{difference:+.3g}{unit} ({difference - half:+.3g} to {difference + half:+.3g}{unit}, 95 %)"
        shown = abs(difference) > half
        changes.append(
            Change(
                what,
                said_of[0],
                said_of[1],
                text,
                shown,
                f"{what} changes by {text}" if shown else f"{what}: no change shown, {text}",
            )
        )
    return changes


def _only(name: str, parameters: dict[str, Estimate], at: int, without: Diagnosis) -> Change:
    """Compare a mechanism that only one campaign names with the smallest change that the other could have shown."""
    seen = without.detectable.get(name, {})
    nulls = {one.name: one.null for one in ALL[name].parameters} if name in ALL else {}
    words, sides = mechanism_words(name, parameters), ("first", "second")
    would = [
        size for size, least in seen.items()
        if size in parameters and abs(parameters[size].value - nulls.get(size, 0.0)) > least > 0.0
    ]  # fmt: skip
    cells = [words, "not found"] if at == 0 else ["not found", words]
    there, missing = sides[at], sides[1 - at]
    what = name.replace("_", " ")
    if would and without.verdict not in ("data", "insufficient"):
        came = "is gone" if at == 0 else "is new"
        text = f"{came}: {words}; the {missing} campaign would have shown an effect of that size"
        return Change(what, cells[0], cells[1], came, True, text)
    return Change(
        what,
        cells[0],
        cells[1],
        "open",
        None,
        f"{words}: named in the {there} campaign alone; the {missing} one could not have shown it",
    )


def _terms(first: Diagnosis, second: Diagnosis) -> list[Change]:
    """List discovered terms of both campaigns side by side; equations are not compared."""
    found = [[one.equation for one in answer.discovered] for answer in (first, second)]
    if not any(found) and "unknown" not in (first.verdict, second.verdict):
        return []
    cells = ["; ".join(own) or ("something unexplained" if answer.verdict == "unknown" else "nothing")
             for own, answer in zip(found, (first, second), strict=True)]  # fmt: skip
    return [
        Change(
            "without a name in the library", cells[0], cells[1], "not compared", None, "terms without a name are not compared"
        )
    ]


def sentence(changes: Sequence[Change], first: str, second: str) -> str:
    """Return one sentence on the changes from the first to the second campaign."""
    shown = [change.words for change in changes if change.shown]
    if shown:
        return f"From {first} to {second}: {'; '.join(shown)}."
    open_ = [change.what for change in changes if change.shown is None]
    left = f" Open: {', '.join(open_)}." if open_ else ""
    return f"Nothing that these recordings show has changed from {first} to {second}.{left}"


def _estimate(one: Estimate) -> str:
    unit = "" if one.unit == "-" else f" {unit_words(one.unit)}"
    low, high = one.interval90
    return f"{one.value:.3g}{unit}" if low == high else f"{one.value:.3g}{unit} ({low:.3g} to {high:.3g}, 90 %)"
