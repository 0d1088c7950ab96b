"""Compares the answers of a diagnosis with the labels of a bank and computes the figures of the proof."""

import itertools
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from experiments.concealed.bank import BankError
from experiments.concealed.setup import MASS_PER_AXLE_KG, RADIUS_M

Label = dict[str, Any]
Answer = dict[str, Any]

#: Verdicts that say that something is missing.
ALARMS = ("named", "ambiguous", "unknown")
#: Edges of the classes of size, in multiples of the smallest effect of interest as it is in the case.
SIZES = (0.0, 0.75, 1.5, 3.0, 6.0, np.inf)
#: Effects whose parameter means the same in any model; sign conventions of a clock differ, so that one counts absolute.
COMPARABLE = (
    "track_gradient", "aerodynamic_drag", "vehicle_mass", "wheel_radius", "brake_gain_imbalance", "wheel_speed_lag",
    "clock_offset",
)  # fmt: skip
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
    by: dict[str, list[tuple[Label, Answer]]] = {kind: [] for kind in ("null", "single", "pair", "confounded", "foreign")}
    for name, label in labels.items():
        by[label["class"]].append((label, answers[name]))
    singles, pairs = by["single"], by["pair"]
    return {
        "false_alarms": rate(a["verdict"] in ALARMS for _, a in by["null"]),
        "singles": _singles(singles),
        "singles_by_size": {
            f"{low:g} to {high:g}": _singles([(t, a) for t, a in singles if low <= t["effects"][0]["multiple"] < high])
            for low, high in itertools.pairwise(SIZES)
        },
        "singles_by_effect": {
            name: _singles([(t, a) for t, a in singles if t["mechanisms"] == [name]])
            for name in sorted({t["mechanisms"][0] for t, _ in singles})
        },
        "singles_by_noise": {
            str(noise): _singles([(t, a) for t, a in singles if t["noise"] == noise])
            for noise in sorted({t["noise"] for t, _ in singles})
        },
        "pairs_both_found": rate(found(t["mechanisms"], a) == 2 for t, a in pairs),
        "pairs_one_found": rate(found(t["mechanisms"], a) == 1 for t, a in pairs),
        "confounded_honest": rate(
            a["verdict"] not in ALARMS or a["verdict"] == "unknown" or found(t["mechanisms"], a) == 1
            for t, a in by["confounded"]
        ),
        "foreign_named_wrongly": rate(bool(a.get("mechanisms")) for _, a in by["foreign"]),
        "foreign_seen": rate(a["verdict"] in ALARMS for _, a in by["foreign"]),
        "removed_share": _spread([r for t, a in singles + pairs if (r := _removed(t, a)) is not None]),
        "parameters": _parameters(singles + pairs),
        "distance_change": _distances(singles + pairs),
        "calibration": _calibration([pair for kind in by.values() for pair in kind]),
        "confusion": _confusion([pair for kind in by.values() for pair in kind]),
    }


def _singles(cases: list[tuple[Label, Answer]]) -> dict[str, Rate]:
    def first(answer: Answer) -> str:
        return str(answer["mechanisms"][0]["name"]) if answer.get("mechanisms") else ""

    return {
        "seen": rate(a["verdict"] in ALARMS for _, a in cases),
        "right_name_first": rate(first(a) == t["mechanisms"][0] for t, a in cases),
        "in_set_of_two": rate(found(t["mechanisms"], a, 2) == 1 for t, a in cases),
        "in_set": rate(found(t["mechanisms"], a) == 1 for t, a in cases),
        "others_too": rate(len(a.get("mechanisms", ())) > 1 for _, a in cases),
    }


def _removed(label: Label, answer: Answer) -> float | None:
    """Share of the removable held-out residual that was removed, by the answer's own mean squares; nothing named: none."""
    fit = answer.get("fit", {})
    if not answer.get("mechanisms"):
        return None
    base, extended, floor = fit["baseline"]["validate"], fit["extended"]["validate"], fit["noise_floor"]
    return (base - extended) / (base - floor) if base > floor else None


def _spread(values: list[float]) -> dict[str, float | int | None]:
    if not values:
        return {"count": 0, "mean": None, "median": None, "lowest": None}
    return {"count": len(values), "mean": float(np.mean(values)), "median": float(np.median(values)), "lowest": min(values)}


def true_value(label: Label, name: str, unit: str) -> float | None:
    """Return a comparable effect's size in the unit that the answer uses; None where it cannot be put so."""
    effect = next(one for one in label["effects"] if one["name"] == name)
    size: float = effect["size"]
    if unit == effect["unit"]:
        return size
    whole = {("vehicle_mass", "kg"): MASS_PER_AXLE_KG * label["axles"], ("wheel_radius", "m"): RADIUS_M}
    return size * whole[name, unit] if (name, unit) in whole else None


def _parameters(cases: list[tuple[Label, Answer]]) -> dict[str, Any]:
    errors, covered = [], []
    for label, answer in cases:
        for one in answer.get("mechanisms", ()):
            name = one["name"]
            if name not in COMPARABLE or name not in label["mechanisms"]:
                continue
            for parameter in one.get("parameters", {}).values():
                truth = true_value(label, name, parameter["unit"])
                if truth is not None:
                    value, interval = parameter["value"], parameter["interval90"]
                    if name == "clock_offset":
                        truth, value, interval = abs(truth), abs(value), sorted(map(abs, interval))
                    errors.append(abs(value / truth - 1.0))
                    covered.append(interval[0] <= truth <= interval[1])
                    break
    return {
        "relative_error": _spread(errors),
        f"within_{PARAMETER_TOLERANCE:.0%}": rate(error <= PARAMETER_TOLERANCE for error in errors),
        "interval90_covers": rate(covered),
    }


def _distances(cases: list[tuple[Label, Answer]]) -> dict[str, Any]:
    """Score an answer's optional `distance_change` (value, interval90), the change of stopping distance by all it found."""
    told = [(t["distance_change"], a["distance_change"]) for t, a in cases if "distance_change" in a]
    return {
        "error": _spread([abs(claim["value"] - truth) for truth, claim in told]),
        "interval90_covers": rate(claim["interval90"][0] <= truth <= claim["interval90"][1] for truth, claim in told),
    }


def _calibration(cases: list[tuple[Label, Answer]]) -> dict[str, Any]:
    """Confidence of every mechanism named, against whether it is there."""
    claims = [(float(one["confidence"]), one["name"] in t["mechanisms"]) for t, a in cases for one in a.get("mechanisms", ())]
    if not claims:
        return {"claims": 0, "brier": None, "expected_error": None, "bins": []}
    confidence, right = np.array([c for c, _ in claims]), np.array([r for _, r in claims], dtype=float)
    which = np.minimum((confidence * 10).astype(int), 9)
    bins = [
        {"from": i / 10, "claims": int((which == i).sum()), "confidence": float(confidence[which == i].mean()),
         "right": float(right[which == i].mean())}
        for i in range(10) if (which == i).any()
    ]  # fmt: skip
    expected = sum(b["claims"] * abs(b["confidence"] - b["right"]) for b in bins) / len(claims)
    return {"claims": len(claims), "brier": float(np.mean((confidence - right) ** 2)), "expected_error": expected, "bins": bins}


def _confusion(cases: list[tuple[Label, Answer]]) -> dict[str, dict[str, int]]:
    """Count what was answered by what is true; names joined by + where there are several."""
    table: dict[str, Counter[str]] = {}
    for label, answer in cases:
        truth = "+".join(one["name"] for one in label["effects"]) or "nothing"
        said = "+".join(one["name"] for one in answer.get("mechanisms", ())) or str(answer["verdict"])
        table.setdefault(truth, Counter())[said] += 1
    return {truth: dict(counts) for truth, counts in sorted(table.items())}


def read_answers(folder: Path) -> dict[str, Answer]:
    """Read FOLDER/CASE/diagnosis.json of all cases; a rival's answers in the same format score the same way."""
    files = sorted(folder.glob("*/diagnosis.json"))
    return {file.parent.name: json.loads(file.read_text(encoding="utf-8")) for file in files}
