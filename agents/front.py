"""Draws the front of stopping distance against slip: `python -m agents.front --vehicle bogie` writes `docs/agents_front.png`.

Rules with default and with their own best thresholds for several prices of sliding, the slip controller at several set-points,
the extremum seeker, the shipped policy, perfect knowledge with the real valves, and the bound, on the card's held-out stops.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.measure import HELD_OUT, Yardstick
from agents.rules import read_best
from baselines.rule_based import RuleBasedWSP
from baselines.slip_control import SlipController, SlipParameters
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.reference import perfect_knowledge

#: Set-points of the slip controller's curve [-].
SET_POINTS = (0.02, 0.03, 0.05, 0.08, 0.12)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is drawn."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    policies: tuple[Path, ...] = ()  # folders; none: the shipped one
    stops: int = 40  # held-out ones under each law
    out: Path = Path("docs/agents_front.png")
    json: bool = False  # print the points


def families(arguments: Arguments) -> dict[str, list[Controller]]:
    """Return the controllers by family; a family is drawn as one curve."""
    folder = Path("agents/trained") / arguments.vehicle
    return {
        "rules, default thresholds": [load("rule-based")],
        "rules, own best thresholds": [RuleBasedWSP(best) for best in read_best(folder).values()],
        "slip controller": [SlipController(SlipParameters(creepage=c, least_slip_mps=0.2)) for c in SET_POINTS],
        "extremum seeker": [load("extremum")],
        "policies": [load_policy(place) for place in arguments.policies or (folder,)],
    }


def points(arguments: Arguments, law: str) -> dict[str, list[tuple[float, float]]]:
    """Return mean slip [m/s] and mean distance [m] of every family's controllers; of the bound the distance alone."""
    yardstick = Yardstick.drawn(arguments.vehicle, law, arguments.stops, HELD_OUT)
    found: dict[str, list[tuple[float, float]]] = {}
    for name, controllers in families(arguments).items():
        own = [yardstick.means(controller) for controller in controllers]
        found[name] = sorted((means["mean_slip_mps"], means["distance_m"]) for means in own)
    known = figures(perfect_knowledge(yardstick.vehicle, yardstick.stops, yardstick.top, yardstick.conduct), yardstick.top)
    found["perfect knowledge"] = [(float(known["mean_slip_mps"].mean()), float(known["distance_m"].mean()))]
    found["bound"] = [(float("nan"), float(np.mean(yardstick.top.shortest()[0])))]
    return found


def draw(found: dict[str, dict[str, list[tuple[float, float]]]], path: Path) -> None:
    """Draw the points by law."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(found), figsize=(11.0, 4.4))
    for axis, (law, families_found) in zip(axes, found.items(), strict=True):
        for name, pairs in families_found.items():
            slip, distance = zip(*pairs, strict=True)
            if name == "bound":
                axis.axhline(distance[0], color="black", linestyle=":", label=name)
            else:
                axis.plot(slip, distance, marker="o", linewidth=1.0, label=name)
        axis.set(title=f"{law} law", xlabel="mean slip speed [m/s]", ylabel="mean stopping distance [m]")
        axis.grid(alpha=0.3)
    axes[0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def main(arguments: Arguments) -> None:
    """Measure and draw."""
    found: dict[str, Any] = {law: points(arguments, law) for law in ("recovering", "classic")}
    draw(found, arguments.out)
    if arguments.json:
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
