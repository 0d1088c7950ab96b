"""How fine the plant's substep must be: order of convergence, and error of stopping distance and contact energy.

    python experiments/convergence.py [--stops 16] [--json]

Every vehicle brakes to standstill from drawn conditions under the same commands at every substep; the reference is a substep
of 0.3 ms. Manoeuvres: a stop without slide; full braking whatever the wheels do; valves worked at random; valves worked as the
rule-based controller worked them in the reference (replayed: in the loop it answers a change of rounding with another valve
cycle); and random valves once more with every mechanism on.

The longest substep with every stopping distance of the paper's model within 0.1 % is what `SUBSTEP_S` of the
longitudinal plant may be at most.
"""

import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from baselines.rule_based import RuleBasedWSP
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.longitudinal.state import SUBSTEP_S
from wsp_env.plant.mechanisms import ALL
from wsp_env.plant.port import Plant, Setup, Stop
from wsp_env.scenario import Scenario, draw

CONTROL_INTERVAL_S = 0.02
SUBSTEPS = (1, 2, 4, 8, 16)  # per control interval
REFERENCE_SUBSTEPS = 64
TRACK_NODES = 801  # 4 km
LIMIT_S = 400.0
GOAL = 1e-3  # relative error of the stopping distance

#: Adhesion at which wheels slide under the demand, and at which they do not.
SLIDING = Scenario(mu_cd=(0.02, 0.06), demand=(0.7, 1.0))
GRIPPING = Scenario(mu_cd=(0.08, 0.09), demand=(0.3, 0.5), tracks=("constant",))

Commands = Callable[[int, Plant], np.ndarray]  # of the number of the control interval


@dataclasses.dataclass(frozen=True)
class Row:
    """Errors of one vehicle in one manoeuvre at one substep."""

    vehicle: str
    manoeuvre: str
    substep_s: float
    worst_error: float  # of the stops' distances, relative
    median_error: float
    worst_error_m: float
    order: float | None  # of the distance: median over the stops, against twice the substep; None for the longest
    worst_energy_error: float  # of the heat in the vehicle's contacts, relative


def brake(
    vehicle: Vehicle, stops: list[Stop], substeps: int, commands: Commands, mechanisms: dict[str, Any] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the stopping distances (N,) [m] and the heat in the contacts of each vehicle (N,) [J]."""
    setup = Setup(CONTROL_INTERVAL_S, CONTROL_INTERVAL_S / substeps, mechanisms or {}, track_nodes=TRACK_NODES)
    plant = make_plant(vehicle, len(stops), setup)
    for i, stop in enumerate(stops):
        plant.start(i, stop)
    number = 0
    while plant.moving.any():
        if number * CONTROL_INTERVAL_S > LIMIT_S:
            raise RuntimeError(f"{vehicle.name}: a stop takes more than {LIMIT_S} s")
        plant.step(commands(number, plant))
        number += 1
    end = plant.truth()
    return end.position.copy(), end.contact_work.sum(axis=1)


def _applied(shape: tuple[int, int]) -> Commands:
    return lambda number, plant: np.ones(shape)


def _random_valves(rng: np.random.Generator, shape: tuple[int, int]) -> Commands:
    """Vent, hold or apply, each command kept for 20 to 500 ms; after a minute applied, so that every stop ends."""
    minute = round(60.0 / CONTROL_INTERVAL_S)
    sequence = np.ones((minute + 1, *shape))
    command = np.ones(shape)
    rest = np.zeros(shape)
    for number in range(minute):
        anew = rest <= 0
        command = np.where(anew, rng.choice([-1.0, 0.0, 1.0], p=[0.25, 0.25, 0.5], size=shape), command)
        rest = np.where(anew, rng.integers(1, 26, size=shape), rest) - 1
        sequence[number] = command
    return lambda number, plant: sequence[min(number, minute)]


def _replayed_rules(vehicle: Vehicle, stops: list[Stop]) -> Commands:
    controller = RuleBasedWSP()
    controller.reset(len(stops), vehicle)
    record: list[np.ndarray] = []

    def act(number: int, plant: Plant) -> np.ndarray:
        record.append(controller.act(plant.reading()._replace(pressure=None)))
        return record[-1]

    brake(vehicle, stops, REFERENCE_SUBSTEPS, act)
    return lambda number, plant: record[min(number, len(record) - 1)]


def study(name: str, count: int, seed: int) -> Iterator[Row]:
    """Yield the rows of one vehicle."""
    vehicle = VEHICLES[name]
    rng = np.random.default_rng(seed)
    gripping = [draw(GRIPPING, vehicle, rng, TRACK_NODES) for _ in range(count)]
    sliding = [draw(SLIDING, vehicle, rng, TRACK_NODES) for _ in range(count)]
    shape = (count, vehicle.axles)
    valves = _random_valves(rng, shape)
    everything = {
        mechanism.name: {"axle": 1.0} if any(p.name == "axle" for p in mechanism.parameters) else {}
        for mechanism in ALL.values()
    }
    manoeuvres: tuple[tuple[str, list[Stop], Commands, dict[str, Any] | None], ...] = (
        ("no slide", gripping, _applied(shape), None),
        ("full braking", sliding, _applied(shape), None),
        ("random valves", sliding, valves, None),
        ("rules", sliding, _replayed_rules(vehicle, sliding), None),
        ("random valves, mechanisms", sliding, valves, everything),
    )
    for manoeuvre, stops, commands, mechanisms in manoeuvres:
        reference, heat = brake(vehicle, stops, REFERENCE_SUBSTEPS, commands, mechanisms)
        before: np.ndarray | None = None
        for substeps in SUBSTEPS:
            distances, contact_work = brake(vehicle, stops, substeps, commands, mechanisms)
            error = np.abs(distances - reference)
            seen = np.zeros(count, dtype=bool) if before is None else (error > 1e-9) & (before > 1e-9)
            order = float(np.median(np.log2(before[seen] / error[seen]))) if before is not None and seen.any() else None
            before = error
            relative = error / reference
            yield Row(
                name, manoeuvre, CONTROL_INTERVAL_S / substeps, float(relative.max()), float(np.median(relative)),
                float(error.max()), order,
                float(np.abs(contact_work / heat - 1.0).max()),
            )  # fmt: skip


def longest_substep(rows: list[Row]) -> float | None:
    """Return the longest substep [s] at which, and below which, every error meets the goal."""
    longest = None
    for substep in sorted({row.substep_s for row in rows}):
        if any(row.worst_error > GOAL for row in rows if row.substep_s == substep):
            break
        longest = substep
    return longest


def main(
    stops: int = 16,
    seed: int = 1,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Print the study of wheelset, bogie and coach.

    Parameters
    ----------
    stops
        Stops of each vehicle and manoeuvre.
    seed
        Of their conditions and commands.
    as_json
        Print JSON instead of the table.

    """
    rows = [row for name in VEHICLES for row in study(name, stops, seed)]
    longest = longest_substep([row for row in rows if not row.manoeuvre.endswith("mechanisms")])
    extended = longest_substep([row for row in rows if row.manoeuvre.endswith("mechanisms")])
    if as_json:
        chosen = {"longest_substep_s": longest, "longest_substep_with_mechanisms_s": extended, "chosen_substep_s": SUBSTEP_S}
        result = {"goal": GOAL} | chosen
        print(json.dumps(result | {"rows": [dataclasses.asdict(row) for row in rows]}))
        return
    table = Table(title=f"Error of the stopping distance, of {stops} stops each", title_justify="left")
    table.add_column("vehicle")
    table.add_column("manoeuvre")
    for heading in ("substep\n[ms]", "worst\n[%]", "median\n[%]", "worst\n[m]", "order", "contact heat\nworst [%]"):
        table.add_column(heading, justify="right")
    for row in rows:
        order = "" if row.order is None else f"{row.order:.2f}"
        errors = f"{100 * row.worst_error:.5f}", f"{100 * row.median_error:.5f}", f"{row.worst_error_m:.4f}"
        heat = f"{100 * row.worst_energy_error:.3f}"
        last = row.substep_s == CONTROL_INTERVAL_S / SUBSTEPS[-1]
        table.add_row(row.vehicle, row.manoeuvre, f"{1e3 * row.substep_s:g}", *errors, order, heat, end_section=last)
    console = Console(width=110)
    console.print(table)
    found, with_mechanisms = ("none of them" if step is None else f"{1e3 * step:g} ms" for step in (longest, extended))
    console.print(
        f"Longest substep with every stopping distance within {100 * GOAL:g} %: {found} for the paper's model, "
        f"{with_mechanisms} with every mechanism on at once; the plant takes {1e3 * SUBSTEP_S:g} ms."
    )


if __name__ == "__main__":
    tyro.cli(main)
