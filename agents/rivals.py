"""What learned controllers are measured against: the fronts of all classical controllers, and the lower envelope of them."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from agents.rules import front, read_best
from baselines.adaptive import AdaptiveController, AdaptiveParameters
from baselines.rule_based import RuleBasedWSP
from baselines.slip_control import SlipController, SlipParameters
from wsp_env.evaluation.controller import Controller

#: Set-points of the slip controller [-], prices of the adaptive one whose gains were not searched [-], and the creepage of the
#: rules' long slide [-] (assumptions: as spread as the rules' front is).
SET_POINTS, PRICES, LONG_SLIDE = (0.02, 0.05, 0.12), (0.7, 1.5, 3.0, 6.0), 0.15


def classical(vehicle: str, trained: Path = Path("agents/trained")) -> dict[str, dict[str, Controller]]:
    """Return the classical controllers by family; the members of a family trace its front.

    Rules with their own best thresholds for several prices of sliding, the same with a long slide, the slip controller at
    several set-points, and the adaptive controller with its searched settings, or with the default gains at several prices.
    """
    folder = trained / vehicle
    searched = front(folder, "adaptive")
    adaptive = searched or {f"{price:g}": AdaptiveController(AdaptiveParameters(slide_price=price)) for price in PRICES}
    long = {price: dataclasses.replace(best, long_slide=LONG_SLIDE) for price, best in read_best(folder).items()}
    return {
        "rules": front(folder),
        "rules, long slide": {price: RuleBasedWSP(own) for price, own in long.items()},
        "slip": {f"{one:g}": SlipController(SlipParameters(creepage=one, least_slip_mps=0.2)) for one in SET_POINTS},
        "adaptive": dict(adaptive),
    }


def envelope(points: Iterable[Mapping[str, float]]) -> list[Mapping[str, float]]:
    """Return the points that none beats at no more slip, by their slip; `mean_slip_mps` and `distance_m` count.

    A point above the line between two others is none of them: a front is linear between its points, so this line is reached.
    """
    kept: list[Mapping[str, float]] = []
    for own in sorted(points, key=lambda one: (one["mean_slip_mps"], one["distance_m"])):
        if kept and own["distance_m"] >= kept[-1]["distance_m"]:
            continue
        while len(kept) > 1 and _is_above(kept[-1], kept[-2], own):
            kept.pop()
        kept.append(own)
    return kept


def _is_above(point: Mapping[str, float], before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether a point lies on or above the line from one with less slip to one with more."""
    share = (point["mean_slip_mps"] - before["mean_slip_mps"]) / (after["mean_slip_mps"] - before["mean_slip_mps"])
    return point["distance_m"] >= before["distance_m"] + share * (after["distance_m"] - before["distance_m"])


def at_slip(points: Sequence[Mapping[str, float]], slip: float) -> dict[str, float]:
    """Return the figures of the envelope at a mean slip [m/s], linear between its points and level beyond them."""
    kept = envelope(points)
    slips = [own["mean_slip_mps"] for own in kept]
    return {name: float(np.interp(slip, slips, [own[name] for own in kept])) for name in kept[0]}
