"""What breaks a policy: other laws, every mechanism of the library, conditions outside of its training.

`python -m agents.study --vehicle bogie` brakes held-out stops with the shipped policy and with the rules' own best thresholds
in each world and prints a table in Markdown, or JSON with --json; `--folders` takes policies trained otherwise beside it.
"""

import dataclasses
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.measure import HELD_OUT, Yardstick, low_adhesion
from agents.rules import best_at
from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.quantity import replace
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.mechanisms import ALL
from wsp_env.plant.port import Stop

#: Each mechanism at a size that a railway may meet, see `Card.study`; where a card says none, its typical values.
SIZES: dict[str, dict[str, float]] = {name: dict(card.study) for name, card in ALL.items()}

#: Stops at the edges of the training's ranges and outside: name -> what replaces a quantity of each drawn stop.
OUTSIDE: dict[str, dict[str, float]] = {
    "mu_cd 0.012, extremely low": {"mu_cd": 0.012},
    "mu_cd 0.1": {"mu_cd": 0.1},
    "200 km/h": {"initial_speed": 55.5},
    "50 km/h": {"initial_speed": 14.0},
    "demand 0.4": {"demand": 0.4},
    "30 per mille downhill": {"gradient": -0.03},
    "sensor noise 0.3 rad/s": {"noise": 0.3},
    "tau 1e-3 m/J": {"tau": 1e-3},
}

#: What is reported of each controller.
_REPORTED = ("distance_m", "mean_slip_mps", "slip_deviation_mps", "contact_energy_mj", "locked_s", "largest_creepage")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is studied."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    folders: tuple[Path, ...] = ()  # of policies; none: agents/trained/VEHICLE
    price: str = "3"  # of sliding: the rules' own best thresholds for it are compared with
    stops: int = 40  # held-out ones in each world
    only: str = ""  # worlds whose name begins so; none: all
    json: bool = False


def worlds(vehicle: str, count: int) -> Iterator[tuple[str, list[Stop], dict[str, dict[str, float]]]]:
    """Yield the worlds: name, stops, mechanisms."""
    kind = VEHICLES[vehicle]
    recovering = low_adhesion(kind, "recovering", count, HELD_OUT)
    yield "recovering law", recovering, {}
    yield "classic law", low_adhesion(kind, "classic", count, HELD_OUT), {}
    for name, size in SIZES.items():
        yield name, recovering, {name: size}
    for name, changes in OUTSIDE.items():
        yield name, [replace(stop, changes, "condition") for stop in recovering], {}


def compare(controllers: Mapping[str, Controller], yardstick: Yardstick) -> list[dict[str, Any]]:
    """Return a row of means for each controller, with the ratio of its distance to the first one's and its 95 % interval."""
    rows: list[dict[str, Any]] = []
    first: np.ndarray | None = None
    for name, controller in controllers.items():
        found = yardstick.figures(controller)
        first = found["distance_m"] if first is None else first
        ratio, half = interval(found["distance_m"] / first)
        means = {figure: float(np.mean(found[figure])) for figure in _REPORTED}
        rows.append(
            {"controller": name, "ratio": ratio, "ratio_ci": half, "ran_on": float(np.mean(~found["stopped"])), **means}
        )
    return rows


def table(results: Mapping[str, list[dict[str, Any]]]) -> str:
    """Return the results as a table in Markdown: each policy over the rules in the same world."""
    lines = [
        "| world | policy | distance / rules | slip / rules | standard deviation of slip / rules | energy / rules | locked [s] "
        "| creepage |",
        "|:--|:--|--:|--:|--:|--:|--:|--:|",
    ]
    for world, rows in results.items():
        for row in rows[1:]:
            cells = [f"{row['ratio']:.3f} ± {row['ratio_ci']:.3f}" + (" (some ran on)" if row["ran_on"] else "")]
            cells += [f"{row[figure] / rows[0][figure]:.2f}" for figure in _REPORTED[1:4]]
            cells += [f"{row['locked_s']:.1f}", f"{row['largest_creepage']:.2f}"]
            lines.append(f"| {world} | {row['controller']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def study(arguments: Arguments) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of every world; the rules come first in each."""
    shipped = Path("agents/trained") / arguments.vehicle
    controllers: dict[str, Controller] = {"rules": RuleBasedWSP(best_at(shipped, arguments.price))}
    for folder in arguments.folders or (shipped,):
        controllers[folder.parent.name if folder.name == "policy" else folder.name] = load_policy(folder)
    results = {}
    for name, stops, mechanisms in worlds(arguments.vehicle, arguments.stops):
        if name.startswith(arguments.only):
            results[name] = compare(controllers, Yardstick(arguments.vehicle, stops, Conduct(mechanisms=mechanisms)))
    if not results:
        raise SystemExit(f"no world begins with {arguments.only!r}; `python -m agents.study --help`")
    return results


def main(arguments: Arguments) -> None:
    """Study and print."""
    results = study(arguments)
    print(json.dumps(results, indent=1) if arguments.json else table(results))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
