"""Compares the answers to a bank with its labels: the figures that are promised, and those that only this bank has."""

import itertools
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from experiments.concealed.effects import SENSOR_FAULTS
from experiments.concealed.errors import BankError
from experiments.concealed.plan import SHARES
from experiments.concealed.promised import ALARMS, by_group, first, found, promised
from experiments.concealed.rates import Rate, rate, spread
from experiments.concealed.setup import GAIN_SPREAD, RADIUS_SPREAD, TRACK_SPREAD
from experiments.concealed.truths import COMPARABLE, SEPARABLE, of_bank

Label = dict[str, Any]
Answer = dict[str, Any]
Cases = list[tuple[Label, Answer]]

#: Edges of the classes of size, in multiples of the smallest effect of interest as it is in the case.
SIZES = (0.0, 0.75, 1.5, 3.0, 6.0, np.inf)
#: What two sound axles, or stretches of track, may differ by: an effect within it is normal variation to look at.
NORMAL_DIFFERENCE = {
    "brake_gain_imbalance": 2.0 * GAIN_SPREAD, "wheel_radius": 2.0 * RADIUS_SPREAD, "adhesion_patch": 2.0 * TRACK_SPREAD,
}  # fmt: skip


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
    by: dict[str, Cases] = {kind: [] for kind in SHARES}
    for name, label in labels.items():
        by[label["class"]].append((label, answers[name]))
    singles, pairs = by["single"], by["pair"]
    separable = [(t, a) for t, a in singles if t["effects"][0]["multiple"] >= SEPARABLE]
    judged = [(of_bank(label), answers[name]) for name, label in labels.items()]
    return {
        "promised": promised(judged),
        "groups": by_group(judged),
        "cases": {kind: len(cases) for kind, cases in by.items()},
        "separable": _singles(separable),
        "separable_beyond_variation": _singles([(t, a) for t, a in separable if _abnormal(t["effects"][0])]),
        "singles": _singles(singles),
        "singles_by_size": _by_size(singles),
        "singles_by_effect": _by(singles, lambda t: t["mechanisms"][0]),
        "separable_by_effect": _by(separable, lambda t: t["mechanisms"][0]),
        "singles_by_noise": _by(singles, lambda t: str(t["noise"])),
        "power": {noise: _by_size(cases) for noise, cases in _groups(singles, lambda t: str(t["noise"])).items()},
        "sensor_faults": _singles([(t, a) for t, a in separable if t["mechanisms"][0] in SENSOR_FAULTS]),
        "pairs_one_found": rate(found(t["mechanisms"], a) == 1 for t, a in pairs),
        "confounded_honest": rate(not a.get("mechanisms") or found(t["mechanisms"], a) == 1 for t, a in by["confounded"]),
        "foreign_by_effect": _by(by["foreign"], lambda t: t["effects"][0]["name"]),
        "removed_share": _removed([a for _, a in singles + pairs]),
        "distance_change": _distances(singles),
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


def _singles(cases: Cases) -> dict[str, Rate]:
    return {
        "seen": rate(a["verdict"] in ALARMS for _, a in cases),
        "right_name_first": rate([first(a)] == t["mechanisms"] for t, a in cases),
        "in_set_of_two": rate(found(t["mechanisms"], a, 2) == 1 for t, a in cases),
        "in_set": rate(found(t["mechanisms"], a) == 1 for t, a in cases),
        "others_too": rate(len(a.get("mechanisms", ())) > 1 for _, a in cases),
    }


def _accepts(answer: Answer) -> bool:
    return bool(answer.get("mechanisms") or answer.get("discovered"))


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
        removable, removed = base - fit["noise_floor"], base - extended if _accepts(answer) else 0.0
        excess, gone = excess + removable, gone + removed
        every.append(removed / removable)
        if _accepts(answer):
            named.append(removed / removable)
    return {"named": spread(named), "all": spread(every), "of_sums": gone / excess if excess else None}


def _distances(singles: Cases) -> dict[str, Any]:
    """Compare the change of stopping distance [-] of effects whose parameters mean other things in other forms."""
    reported = [
        (t["distance_change"], a["distance_change"])
        for t, a in singles
        if t["mechanisms"][0] not in COMPARABLE and first(a) == t["mechanisms"][0] and "distance_change" in a
    ]
    return {
        "truth": spread([abs(truth) for truth, _ in reported]),
        "error": spread([abs(claim["value"] - truth) for truth, claim in reported]),
        "interval90_covers": rate(claim["interval90"][0] <= truth <= claim["interval90"][1] for truth, claim in reported),
    }


def _confusion(cases: Cases) -> dict[str, dict[str, int]]:
    """Count the first name answered, or the verdict, by what is true."""
    table: dict[str, Counter[str]] = {}
    for label, answer in cases:
        truth = label["effects"][0]["name"] if label["effects"] else "nothing"
        table.setdefault(truth, Counter())[first(answer)] += 1
    return {truth: dict(counts) for truth, counts in sorted(table.items())}
