"""Who brakes best where the wheels clean the rail for those behind: `python -m agents.leading --policies FOLDER ...`.

Held-out stops of the world "cleaning" (`agents.drawn`). Paid are metres travelled and, at one price for all, metres slid. What
policies pay is told over the best of their rivals, whichever pays least under both laws together: the adaptive controller at
several prices, the same with the leading axle at a fixed creepage, and the teacher that knows all but the cleaning, at several
prices. Below them stands the teacher that knows the cleaning, too, which nobody surpasses by imitating it.
"""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track

from agents.drawn import DRAWS, RESAMPLED, Drawn, world
from agents.taught import paid
from agents.teacher import taught
from agents.watch import LAWS
from baselines.adaptive import AdaptiveController, AdaptiveParameters
from wsp_env.evaluation.policy import load_policy
from wsp_env.parameters.uic_z1 import VEHICLES

#: Prices and creepages of the leading axle, of the rivals.
PRICES, TAUGHT, CREEPAGES = (0.3, 0.7, 1.5, 3.0, 6.0), (0.3, 0.7, 1.5, 3.0), (0.05, 0.1, 0.15, 0.2, 0.3)

#: Prices of the adaptive controller that holds the leading axle.
_LED = (0.7, 1.5, 3.0)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is compared."""

    vehicle: Literal["bogie", "coach"] = "coach"
    policies: tuple[Path, ...] = ()  # folders; none: agents/trained/VEHICLE
    price: float = 3.0  # of sliding, by which all are judged
    stops: int = 48  # under each law
    drawn_by: int = 8_401_101  # their seed
    json: bool = False


Figures = Mapping[str, np.ndarray]


def compare(given: Arguments) -> tuple[list[dict[str, Any]], str]:
    """Return a row for each controller, and who the best rival is."""
    if given.stops < DRAWS:
        raise SystemExit(f"--stops {given.stops} is impossible: at least {DRAWS}")
    vehicle = VEHICLES[given.vehicle]
    yardsticks = {law: Drawn(vehicle, world("cleaning", vehicle, law, given.stops, given.drawn_by)) for law in LAWS}
    blocks = yardsticks[LAWS[0]].blocks
    rivals = {f"adaptive, price {price:g}": AdaptiveParameters(slide_price=price) for price in PRICES}
    rivals |= {
        f"adaptive, price {price:g}, leading axle at {creepage:g}": AdaptiveParameters(
            slide_price=price, leading_creepage=creepage
        )
        for price in _LED
        for creepage in CREEPAGES
    }
    found: dict[str, dict[str, Figures]] = {}
    for name, own in track(rivals.items(), "rivals", console=Console(stderr=True)):
        found[name] = {law: one.figures(AdaptiveController(own)) for law, one in yardsticks.items()}
    for price in TAUGHT:
        found[f"teacher that does not know of it, price {price:g}"] = _taught(yardsticks, price, together=False)
    best = min(found, key=lambda name: _score(found[name], given.price, np.arange(given.stops)))
    for folder in given.policies or (Path("agents/trained") / given.vehicle,):
        policy = load_policy(folder)
        found[f"policy {folder}"] = {law: one.figures(policy) for law, one in yardsticks.items()}
    found[f"teacher, price {given.price:g}"] = _taught(yardsticks, given.price, together=True)
    return [_row(name, own, found[best], given.price, blocks) for name, own in found.items()], best


def _taught(yardsticks: Mapping[str, Drawn], price: float, *, together: bool) -> dict[str, Figures]:
    """Return the figures of stops that the teacher brakes."""
    rows: dict[str, Figures] = {}
    for law, one in yardsticks.items():
        found = [part.judged(taught(part.vehicle, part.stops, price, part.conduct, together=together)) for part in one.parts]
        rows[law] = {name: np.concatenate([own[name] for own in found]) for name in found[0]}
    return rows


def _score(own: Mapping[str, Figures], price: float, chosen: np.ndarray) -> float:
    """Return the mean of what is paid in the chosen stops [m], over both laws."""
    return float(np.mean([paid(found, price)[chosen].mean() for found in own.values()]))


def _row(
    name: str, own: Mapping[str, Figures], best: Mapping[str, Figures], price: float, blocks: np.ndarray
) -> dict[str, Any]:
    every, numbers, rng = np.arange(len(blocks)), np.unique(blocks), np.random.default_rng(0)
    drawn = [
        np.concatenate([np.flatnonzero(blocks == one) for one in rng.choice(numbers, len(numbers))]) for _ in range(RESAMPLED)
    ]
    ratios = [_score(own, price, chosen) / _score(best, price, chosen) for chosen in drawn]
    row: dict[str, Any] = {"controller": name, "ratio": _score(own, price, every) / _score(best, price, every)}
    row["error"] = float(np.std(ratios, ddof=1))
    for law, found in own.items():
        figures = {"distance_m": found["distance_m"], "paid_m": paid(found, price), "energy_mj": found["contact_energy_mj"]}
        row |= {f"{law}_{figure}": float(values.mean()) for figure, values in figures.items()}
    return row | {"locked_s": float(max(found["locked_s"].max() for found in own.values()))}


def table(rows: list[dict[str, Any]], best: str) -> str:
    """Return the rows as a table in Markdown."""
    heads = ["controller"] + [f"{law}: stop [m] | paid [m] | energy of the worst wheelset [MJ]" for law in LAWS]
    heads += [f"paid / {best}", "longest lock [s]"]
    lines = ["| " + " | ".join(heads) + " |", "|:--" + "|--:" * (len(LAWS) * 3 + 2) + "|"]
    for row in rows:
        cells = [row["controller"]]
        for law in LAWS:
            cells += [f"{row[f'{law}_distance_m']:.0f}", f"{row[f'{law}_paid_m']:.0f}", f"{row[f'{law}_energy_mj']:.2f}"]
        lines.append("| " + " | ".join([*cells, f"{row['ratio']:.3f} ± {row['error']:.3f}", f"{row['locked_s']:.2f}"]) + " |")
    return "\n".join(lines)


def main(given: Arguments) -> None:
    """Compare and print."""
    rows, best = compare(given)
    print(json.dumps({"best_rival": best, "rows": rows}, indent=1) if given.json else table(rows, best))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
