"""The figures that are promised of the diagnosis, from answers and truths: the same for every set of campaigns."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from experiments.concealed.rates import Rate, rate, spread
from experiments.concealed.truths import KINDS, Truth
from wsp_env.plant.mechanisms import LIBRARY

Answer = Mapping[str, Any]
Cases = Sequence[tuple[Truth, Answer]]

#: Verdicts that say that something is missing or wrong.
ALARMS = ("named", "ambiguous", "discovered", "unknown", "data")
PARAMETER_TOLERANCE = 0.2


def sets(answer: Answer) -> list[set[str]]:
    """Return for every mechanism found the set that the data cannot tell from it, its own name included."""
    return [{one["name"], *one.get("alternatives", ())} for one in answer.get("mechanisms", ())]


def found(truths: Sequence[str], answer: Answer, largest_set: float = np.inf) -> int:
    """Return how many of the true names are found, each by another mechanism of the answer."""
    offered = [one for one in sets(answer) if len(one) <= largest_set]
    best = 0
    for chosen in itertools.permutations(range(len(offered)), min(len(offered), len(truths))):
        for picked in itertools.combinations(truths, len(chosen)):
            best = max(best, sum(name in offered[i] for name, i in zip(picked, chosen, strict=True)))
    return best


def first(answer: Answer) -> str:
    """Return the first name, or the verdict where there is none."""
    return str(answer["mechanisms"][0]["name"]) if answer.get("mechanisms") else str(answer["verdict"])


def not_there(truth: Truth, answer: Answer) -> bool:
    """Whether a name is given that is neither true nor in a set with a true one of its own."""
    return len(sets(answer)) > found(truth.names, answer)


def placed(truth: Truth, answer: Answer) -> bool:
    """Whether the first discovered term acts where the truth does: in its slot, or one told to be as good, and on its axles."""
    terms = answer.get("discovered") or ()
    if not terms:
        return False
    slots = {terms[0]["slot"], *terms[0].get("slots_not_separable", ())}
    return bool(slots & set(truth.slots)) and (not truth.axles or set(terms[0]["axles"]) == set(truth.axles))


def removed(answer: Answer) -> float | None:
    """Return the share of the removable held-out residual that an answer removes; None where nothing is to be removed.

    An answer that accepts nothing removes nothing.
    """
    fit = answer.get("fit") or {}
    left = (fit.get("baseline") or {}).get("validate")
    if left is not None and left <= fit["noise_floor"]:
        return None
    share = fit.get("removed_validate")
    return 0.0 if share is None else float(share)


def promised(cases: Cases) -> dict[str, Any]:
    """Compute all figures of some campaigns."""
    by: dict[str, list[tuple[Truth, Answer]]] = {kind: [] for kind in KINDS}
    for truth, answer in cases:
        by[truth.kind].append((truth, answer))
    mattering = [(t, a) for t, a in by["single"] if t.matters]
    beyond = by["outside"]
    library = [case for kind in ("single", "pair", "confounded") for case in by[kind]]
    return {
        "cases": {kind: len(members) for kind, members in by.items()},
        "false_alarms": rate(a["verdict"] in ALARMS for _, a in by["null"]),
        "singles_in_set_of_two": rate(found(t.names, a, 2) == 1 for t, a in mattering),
        "singles_first": rate((first(a),) == t.names for t, a in mattering),
        "singles_missed": rate(not a.get("mechanisms") for _, a in mattering),
        "not_there": rate(not_there(t, a) for t, a in cases),
        "not_there_library": rate(not_there(t, a) for t, a in library),
        "pairs_both": rate(found(t.names, a) == len(t.names) for t, a in by["pair"]),
        "mixed_kept": rate(found(t.names, a) == len(t.names) for t, a in by["mixed"]),
        "outside_named": rate(not_there(t, a) for t, a in beyond),
        "outside_seen": rate(a["verdict"] in ALARMS for _, a in beyond),
        "outside_placed": rate(placed(t, a) for t, a in beyond if t.slots),
        "outside_removed": spread([share for _, a in beyond if (share := removed(a)) is not None]),
        "parameters": parameters(cases),
        "calibration": calibration(cases),
        "faults": _faults(by["fault"]),
        "seconds": spread([float(a["seconds"]) for _, a in cases if "seconds" in a]),
    }


def by_group(cases: Cases) -> dict[str, dict[str, Any]]:
    """Compute the figures of every group of campaigns by itself; nothing where there is but one group."""
    groups = sorted({truth.group for truth, _ in cases})
    if len(groups) < 2:
        return {}
    return {group or "no group": promised([(t, a) for t, a in cases if t.group == group]) for group in groups}


def parameters(cases: Cases) -> dict[str, Any]:
    """Compare the sizes that truths give, where the right name is given; on a wrong axle there is nothing of them."""
    errors: dict[str, list[float]] = {}
    covered: dict[str, list[bool]] = {}
    for truth, answer in cases:
        for one in answer.get("mechanisms", ()):
            name, reported = one["name"], one.get("parameters", {})
            if not (given := truth.parameters.get(name)):
                continue
            on = "axle" not in given or "axle" not in reported or round(reported["axle"]["value"]) == round(given["axle"])
            for size in (parameter.name for parameter in LIBRARY[name].sizes):
                if not given.get(size) or size not in reported:
                    continue
                low, high = reported[size]["interval90"]
                errors.setdefault(name, []).append(abs(reported[size]["value"] / given[size] - 1.0) if on else 1.0)
                covered.setdefault(name, []).append(on and low <= given[size] <= high)

    def summary(errors: Iterable[float], covered: Iterable[bool]) -> dict[str, Any]:
        listed = list(errors)
        within = rate(error <= PARAMETER_TOLERANCE for error in listed)
        return {"relative_error": spread(listed), "within_tolerance": within, "interval90_covers": rate(covered)}

    return {
        **summary(itertools.chain(*errors.values()), itertools.chain(*covered.values())),
        "by_effect": {name: summary(errors[name], covered[name]) for name in sorted(errors)},
    }


def calibration(cases: Cases) -> dict[str, Any]:
    """Confidence of every mechanism named, against whether it is there."""
    claims = [(float(one["confidence"]), one["name"] in t.names) for t, a in cases for one in a.get("mechanisms", ())]
    if not claims:
        return {"claims": 0, "brier": None, "expected_error": None, "bins": []}
    confidence, right = np.array([c for c, _ in claims]), np.array([r for _, r in claims], dtype=float)
    which = np.minimum((confidence * 10).astype(int), 9)
    bins, expected = [], 0.0
    for i in np.unique(which):
        inside = which == i
        stated, true = float(confidence[inside].mean()), rate(right[inside] > 0.0)
        bins.append({"from": int(i) / 10, "confidence": stated, "rate": true})
        expected += abs(stated - true.events / true.of) * true.of / len(claims)
    return {"claims": len(claims), "brier": float(np.mean((confidence - right) ** 2)), "expected_error": expected, "bins": bins}


def _faults(cases: Cases) -> dict[str, dict[str, Rate]]:
    """Count by kind of faulty channel, all of them first; a name that is true beside the fault is no wrong one."""
    kinds = sorted({truth.fault for truth, _ in cases})
    groups = {"all": list(cases)} | {kind: [(t, a) for t, a in cases if t.fault == kind] for kind in kinds}
    return {
        kind: {
            "as_data": rate(a["verdict"] == "data" for _, a in members),
            "as_physics": rate(not_there(t, a) for t, a in members),
        }
        for kind, members in groups.items()
    }
