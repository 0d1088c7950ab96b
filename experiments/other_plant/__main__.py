"""Controllers on a plant that none of them was made on: `python -m experiments.other_plant --vehicle bogie`.

The same controllers brake stops of this plant and of the project's own. The table gives each controller's distance as a ratio
to the front of the rules, and to the lower envelope of the fronts of rules and adaptive controller, without its own, at its own
mean slip on the same plant (see `agents.rivals`). Standard errors are those of stops, or drawn vehicles, drawn anew.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich.progress import track

from agents import drawn
from agents.rivals import classical
from experiments.other_plant.draw import Law, World, draw
from experiments.other_plant.run import brake
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.policy import load_policy
from wsp_env.parameters.uic_z1 import VEHICLES

#: Worlds of this plant, and those of `agents.drawn` that are most like them.
LIKE: dict[World, str] = {"nominal": "nominal", "drawn": "drawn brakes", "all": "all"}

#: Families of classical controllers whose fronts are braked: the rules, and those that are nearly everywhere the envelope.
FAMILIES = ("rules", "adaptive")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is compared."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    stops: int = 48  # in each world and under each law
    worlds: tuple[World, ...] = ("nominal", "drawn", "all")
    laws: tuple[Law, ...] = ("recovering", "classic")
    plants: tuple[Literal["other", "own"], ...] = ("other", "own")
    policies: tuple[Path, ...] = ()  # folders; none: agents/trained/VEHICLE
    seed: int = 1  # of the stops and of what is drawn
    json: bool = False


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each plant, world, law and controller: its means, and its distance over the fronts at its own slip."""
    families = classical(arguments.vehicle)
    every = {(family, who): one for family in FAMILIES for who, one in families[family].items()}
    for folder in arguments.policies or (Path("agents/trained") / arguments.vehicle,):
        every["", f"policy {folder.name}"] = load_policy(folder)
    cases = [(law, world, plant) for law in arguments.laws for world in arguments.worlds for plant in arguments.plants]
    rows = []
    for law, world, plant in track(cases, "braking", transient=True, disable=arguments.json):
        stops, blocks = _braked(every, arguments, plant, world, law)
        for (family, who), own in stops.items():
            rivals = [value for (other, _), value in stops.items() if other not in ("", family)]
            rules = [value for (other, _), value in stops.items() if other == "rules" != family]
            row: dict[str, Any] = {"plant": plant, "world": world, "law": law, "controller": f"{family} {who}".strip()}
            row |= drawn.means_of(own)
            for name, others in (("rules", rules), ("envelope", rivals)):
                row[name] = drawn.against(drawn.means_of(own), [drawn.means_of(one) for one in others])
                row[name] |= {"distance_error": drawn.standard_error(own, others, blocks)}
            rows.append(row)
    return rows


def _braked(
    every: Mapping[tuple[str, str], Controller], arguments: Arguments, plant: str, world: World, law: Law
) -> tuple[dict[tuple[str, str], drawn.Stops], np.ndarray]:
    """Return what is kept of the stops of each controller, and the number of the draw (N,) that stops share."""
    believed = VEHICLES[arguments.vehicle]
    if plant == "own":
        yardstick = drawn.Drawn(believed, drawn.world(LIKE[world], believed, law, arguments.stops, arguments.seed))
        return {key: drawn.measured(yardstick, one) for key, one in every.items()}, yardstick.blocks
    true = draw(world, law, believed, arguments.stops, arguments.seed)
    found = {key: brake(one, believed, true) for key, one in every.items()}
    kept: dict[tuple[str, str], drawn.Stops] = {
        key: {name: figures[name].tolist() for name in drawn.KEPT} for key, figures in found.items()
    }
    return kept, np.arange(arguments.stops)


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| law | world | plant | controller | distance [m] | slip [m/s] | distance / rules' front | distance / envelope "
        "| standard deviation of slip / rules' front | longest lock [s] |",
        "|:--|:--|:--|:--|" + "--:|" * 6,
    ]
    for row in rows:
        cells = [row[name] for name in ("law", "world", "plant", "controller")]
        cells += [f"{row['distance_m']:.0f}", f"{row['mean_slip_mps']:.2f}"]
        for name in ("rules", "envelope"):
            ratio, error = row[name]["distance_m_ratio"], row[name]["distance_error"]
            beyond = "*" if row[name]["beyond_front"] else ""
            cells.append("" if np.isnan(ratio) else f"{ratio:.3f} ± {error:.3f}{beyond}")
        deviation = row["rules"]["slip_deviation_mps_ratio"]
        cells += ["" if np.isnan(deviation) else f"{deviation:.2f}", f"{row['worst_locked_s']:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", "\\* slides more than every point of that front"])


def main(arguments: Arguments) -> None:
    """Compare and print."""
    rows = compare(arguments)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
