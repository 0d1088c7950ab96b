"""Compares the answers of a diagnosis with the labels of a bank and computes the figures of the proof."""

import itertools
import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from experiments.concealed.bank import BankError
from experiments.concealed.effects import SENSOR_FAULTS
from experiments.concealed.setup import GAIN_SPREAD, RADIUS_SPREAD, TRACK_SPREAD

Label = dict[str, Any]
Answer = dict[str, Any]
Cases = list[tuple[Label, Answer]]

#: Verdicts that say that something is missing.
ALARMS = ("named", "ambiguous", "unknown")
#: Edges of the classes of size, in multiples of the smallest effect of interest as it is in the case.
SIZES = (0.0, 0.75, 1.5, 3.0, 6.0, np.inf)
#: Singles from this multiple on count as separable: the other classes hold what is confounded, and nobody looks at answers.
SEPARABLE = 2.0 * (1.0 - 1e-9)
#: What two sound axles, or stretches of track, may differ by: an effect within it is normal variation to look at.
NORMAL_DIFFERENCE = {
    "brake_gain_imbalance": 2.0 * GAIN_SPREAD, "wheel_radius": 2.0 * RADIUS_SPREAD, "adhesion_patch": 2.0 * TRACK_SPREAD,
}  # fmt: skip
#: Effects whose parameter means the same in any form: the library's name for it, and its value over the effect's size.
COMPARABLE = {
    "track_gradient": ("rise", 1.0), "aerodynamic_drag": ("c_ns2_per_m2", 1.0), "vehicle_mass": ("extra", 1.0),
    "wheel_radius": ("change", 1.0), "brake_gain_imbalance": ("gain", 1.0), "wheel_speed_lag": ("lag_s", 1.0),
    "clock_offset": ("offset_s", -1.0),  # a vehicle's speed sampled later than stamped is one that is late by less than 0
}  # fmt: skip
#: Drag that comes with rolling terms, (100 N, 5 N s/m, 1 N s2/m2) times its size, is compared by its force at 30 m/s.
DRAG_WITH_ROLLING = 1.0 + 5.0 / 30.0 + 100.0 / 30.0**2
PARAMETER_TOLERANCE = 0.2


class Rate(NamedTuple):
    """How often something happened, with the 95 % bounds of Clopper and Pearson, each one-sided."""

    events: int
    of: int
    share: float | None
    lower95: float
    upper95: float


def rate(happened: Iterable[bool]) -> Rate:
    """Count."""
    events = [bool(event) for event in happened]
    k, n = sum(events), len(events)
    lower = float(beta.ppf(0.05, k, n - k + 1)) if k > 0 else 0.0
    upper = float(beta.ppf(0.95, k + 1, n - k)) if k < n else 1.0
    return Rate(k, n, k / n if n else None, lower, upper)


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


def score(labels: dict[str, Label], answers: dict[str, Answer]) -> dict[str, Any]:
    """Compute all figures.

    Parameters
    ----------
    labels, answers : by case; the answers in the format of diagnosis.json

    Raises
    ------
    BankError
        when a case has no answer

    """
    if missing := sorted(set(labels) - set(answers)):
        raise BankError(f"no answer for {len(missing)} of {len(labels)} cases, the first is {missing[0]}: diagnose them first")
    by: dict[str, Cases] = {kind: [] for kind in ("null", "single", "pair", "confounded", "foreign")}
    for name, label in labels.items():
        by[label["class"]].append((label, answers[name]))
    singles, pairs = by["single"], by["pair"]
    separable = [(t, a) for t, a in singles if t["effects"][0]["multiple"] >= SEPARABLE]
    return {
        "cases": {kind: len(cases) for kind, cases in by.items()},
        "false_alarms": rate(a["verdict"] in ALARMS for _, a in by["null"]),
        "separable": _singles(separable),
        "separable_beyond_variation": _singles([(t, a) for t, a in separable if _abnormal(t["effects"][0])]),
        "singles": _singles(singles),
        "singles_by_size": _by_size(singles),
        "singles_by_effect": _by(singles, lambda t: t["mechanisms"][0]),
        "separable_by_effect": _by(separable, lambda t: t["mechanisms"][0]),
        "singles_by_noise": _by(singles, lambda t: str(t["noise"])),
        "power": {noise: _by_size(cases) for noise, cases in _groups(singles, lambda t: str(t["noise"])).items()},
        "sensor_faults": _singles([(t, a) for t, a in separable if t["mechanisms"][0] in SENSOR_FAULTS]),
        "pairs_both_found": rate(found(t["mechanisms"], a) == 2 for t, a in pairs),
        "pairs_one_found": rate(found(t["mechanisms"], a) == 1 for t, a in pairs),
        "confounded_honest": rate(
            a["verdict"] not in ALARMS or a["verdict"] == "unknown" or found(t["mechanisms"], a) == 1
            for t, a in by["confounded"]
        ),
        "foreign_named_wrongly": rate(bool(a.get("mechanisms")) for _, a in by["foreign"]),
        "foreign_seen": rate(a["verdict"] in ALARMS for _, a in by["foreign"]),
        "foreign_by_effect": _by(by["foreign"], lambda t: t["effects"][0]["name"]),
        "removed_share": _removed([a for _, a in singles + pairs]),
        "parameters": _parameters(singles + pairs),
        "distance_change": _distances(singles),
        "calibration": _calibration([pair for kind in by.values() for pair in kind]),
        "confusion": _confusion(by["null"] + singles + by["foreign"]),
    }


def _abnormal(effect: dict[str, Any]) -> bool:
    return float(abs(effect["size"])) > NORMAL_DIFFERENCE.get(effect["name"], 0.0)


def _groups(cases: Cases, key: Callable[[Label], str]) -> dict[str, Cases]:
    return {name: [(t, a) for t, a in cases if key(t) == name] for name in sorted({key(t) for t, _ in cases})}


def _by(cases: Cases, key: Callable[[Label], str]) -> dict[str, dict[str, Rate]]:
    return {name: _singles(members) for name, members in _groups(cases, key).items()}


def _by_size(cases: Cases) -> dict[str, dict[str, Rate]]:
    return {
        f"{low:g} to {high:g}": _singles([(t, a) for t, a in cases if low <= t["effects"][0]["multiple"] < high])
        for low, high in itertools.pairwise(SIZES)
    }


def _first(answer: Answer) -> str:
    """Return the first name, or the verdict where there is none."""
    return str(answer["mechanisms"][0]["name"]) if answer.get("mechanisms") else str(answer["verdict"])


def _singles(cases: Cases) -> dict[str, Rate]:
    return {
        "seen": rate(a["verdict"] in ALARMS for _, a in cases),
        "right_name_first": rate([_first(a)] == t["mechanisms"] for t, a in cases),
        "in_set_of_two": rate(found(t["mechanisms"], a, 2) == 1 for t, a in cases),
        "in_set": rate(found(t["mechanisms"], a) == 1 for t, a in cases),
        "others_too": rate(len(a.get("mechanisms", ())) > 1 for _, a in cases),
    }


def _removed(answers: list[Answer]) -> dict[str, Any]:
    """Share of the removable held-out residual that was removed, by the answers' own mean squares.

    Of each answer that names something; of all, where one that names nothing removes nothing; and of the sums over all.
    """
    named, every, excess, gone = [], [], 0.0, 0.0
    for answer in answers:
        fit = answer.get("fit")
        if not fit or "validate" not in fit["baseline"] or fit["baseline"]["validate"] <= fit["noise_floor"]:
            continue
        base, extended = fit["baseline"]["validate"], fit["extended"]["validate"]
        removable, removed = base - fit["noise_floor"], base - extended if answer["mechanisms"] else 0.0
        excess, gone = excess + removable, gone + removed
        every.append(removed / removable)
        if answer["mechanisms"]:
            named.append(removed / removable)
    return {"named": _spread(named), "all": _spread(every), "of_sums": gone / excess if excess else None}


def _spread(values: list[float]) -> dict[str, float | int | None]:
    if not values:
        return {"count": 0, "mean": None, "median": None, "lowest": None, "highest": None}
    return {"count": len(values), "mean": float(np.mean(values)), "median": float(np.median(values)), "lowest": min(values),
            "highest": max(values)}  # fmt: skip


def true_value(effect: dict[str, Any]) -> float:
    """Return a comparable effect's parameter as the library has it."""
    factor = COMPARABLE[effect["name"]][1]
    if effect["name"] == "aerodynamic_drag" and effect["variant"] % 2:
        factor = DRAG_WITH_ROLLING
    return float(effect["size"] * factor)


def _parameters(cases: Cases) -> dict[str, Any]:
    """Compare the parameters of comparable effects that are named by their name; on a wrong axle there is nothing of them."""
    errors: dict[str, list[float]] = {}
    covered: dict[str, list[bool]] = {}
    for label, answer in cases:
        effects = {one["name"]: one for one in label["effects"] if one["name"] in COMPARABLE}
        for one in answer.get("mechanisms", ()):
            name, reported = one["name"], one.get("parameters", {})
            if name not in effects or COMPARABLE[name][0] not in reported:
                continue
            effect, parameter = effects[name], reported[COMPARABLE[name][0]]
            axle = effect["axle"] % label["axles"] + 1
            placed = "axle" not in reported or round(reported["axle"]["value"]) == axle
            truth, (low, high) = true_value(effect), parameter["interval90"]
            errors.setdefault(name, []).append(abs(parameter["value"] / truth - 1.0) if placed else 1.0)
            covered.setdefault(name, []).append(placed and low <= truth <= high)

    def summary(errors: list[float], covered: list[bool]) -> dict[str, Any]:
        within = rate(error <= PARAMETER_TOLERANCE for error in errors)
        return {"relative_error": _spread(errors), "within_tolerance": within, "interval90_covers": rate(covered)}

    return {
        **summary(list(itertools.chain(*errors.values())), list(itertools.chain(*covered.values()))),
        "by_effect": {name: summary(errors[name], covered[name]) for name in sorted(errors)},
    }


def _distances(singles: Cases) -> dict[str, Any]:
    """Compare the change of stopping distance [-] of effects whose parameters mean other things in other forms."""
    reported = [
        (t["distance_change"], a["distance_change"])
        for t, a in singles
        if t["mechanisms"][0] not in COMPARABLE and _first(a) == t["mechanisms"][0] and "distance_change" in a
    ]
    return {
        "truth": _spread([abs(truth) for truth, _ in reported]),
        "error": _spread([abs(claim["value"] - truth) for truth, claim in reported]),
        "interval90_covers": rate(claim["interval90"][0] <= truth <= claim["interval90"][1] for truth, claim in reported),
    }


def _calibration(cases: Cases) -> dict[str, Any]:
    """Confidence of every mechanism named, against whether it is there."""
    claims = [(float(one["confidence"]), one["name"] in t["mechanisms"]) for t, a in cases for one in a.get("mechanisms", ())]
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


def _confusion(cases: Cases) -> dict[str, dict[str, int]]:
    """Count the first name answered, or the verdict, by what is true."""
    table: dict[str, Counter[str]] = {}
    for label, answer in cases:
        truth = label["effects"][0]["name"] if label["effects"] else "nothing"
        table.setdefault(truth, Counter())[_first(answer)] += 1
    return {truth: dict(counts) for truth, counts in sorted(table.items())}


def read_answers(folder: Path) -> dict[str, Answer]:
    """Read FOLDER/CASE/diagnosis.json of all cases; a rival's answers in the same format score the same way."""
    files = sorted(folder.glob("*/diagnosis.json"))
    return {file.parent.name: json.loads(file.read_text(encoding="utf-8")) for file in files}


def plain(value: Any) -> Any:
    """Return figures as JSON takes them: rates with their fields' names."""
    if isinstance(value, Rate):
        return value._asdict()
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list) else value


def restored(value: Any) -> Any:
    """Return figures with their rates, from what `plain` made of them."""
    if isinstance(value, dict):
        if set(value) == set(Rate._fields):
            return Rate(**value)
        return {key: restored(one) for key, one in value.items()}
    return [restored(one) for one in value] if isinstance(value, list) else value
