"""How fast the law, the plant and the environments are, as ratios measured in one run.

    python experiments/benchmark.py [--quick] [--exported] [--json]

The machine may be busy with other work: times are the process's own, what is compared runs in turns, every figure is the
median of the rounds and a ratio the median of the rounds' ratios. Everything runs on one core. CartPole is Gymnasium's
`make_vec("CartPole-v1", vectorization_mode="sync")`; its cost is that of a step of all N environments, as is the plant's: one
control interval of 20 ms with all its substeps. By `gym.make`, both are single environments in Gymnasium's wrappers.
"""

import dataclasses
import json
import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from experiments.benchmark_runs import IN_SPACE, contact_runs, decision_run, single_runs, step_runs
from experiments.exported import compiler, exported
from wsp_env.plant.longitudinal.state import SUBSTEP_S
from wsp_env.plant.port import Setup

SIZES = (1, 64, 1024, 8192)
QUICK_SIZES = (1, 64)
ROUNDS, QUICK_ROUNDS = (15, 0.05), (5, 0.02)  # how many, and how long each run is repeated in one [s]
AT_MOST = (("Bogie-v1 by gym.make", 1, 12.0), ("Bogie-v1", 1, 4.0), ("Bogie-v1", 1024, 0.12))  # times CartPole, by batch size
FASTEST = {1: 10.0, 64: 15.0}  # times real time that the multibody coach is to reach, by batch size, on one core


@dataclasses.dataclass(frozen=True)
class Goal:
    """A figure that the project wants to reach."""

    what: str
    measured: float
    goal: float
    at_least: bool

    @property
    def met(self) -> bool:
        """Whether the measured figure reaches the goal."""
        return self.measured >= self.goal if self.at_least else self.measured <= self.goal


def in_turns(runs: Mapping[str, Callable[[], int]], rounds: int, seconds: float) -> dict[str, np.ndarray]:
    """Time the runs in turns; return the seconds per unit of work in every round (rounds,).

    A run returns how many units it did; it is repeated for about `seconds` in each round.
    """
    repeats = {}
    for name, run in runs.items():
        run()  # compiles
        start = time.process_time()
        run()
        repeats[name] = max(1, math.ceil(seconds / max(time.process_time() - start, 1e-7)))
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            units = 0
            start = time.process_time()
            for _ in range(repeats[name]):
                units += run()
            taken[name].append((time.process_time() - start) / units)
    return {name: np.array(values) for name, values in taken.items()}


def ratio(of: np.ndarray, to: np.ndarray) -> float:
    """Median of the rounds' ratios."""
    return float(np.median(of / to))


# --- C beside numba ---------------------------------------------------------------------------------------------------


def exported_rows(rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Return size and cost of the exported C beside the Python it was made from; nothing without a C compiler."""
    if compiler() is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for one in exported(Path(folder)):
            times = in_turns({"C": one.in_c, "Python": one.in_python}, rounds, seconds)
            c_s, python_s = (statistics.median(times[name].tolist()) for name in ("C", "Python"))
            sizes = {name: getattr(one, name) for name in ("lines", "object_bytes", "remembered_bytes")}
            rows.append({"what": one.what, "c_s": c_s, "python_s": python_s, **sizes})
    return rows


# --- the report -------------------------------------------------------------------------------------------------------


def measure(quick: bool) -> dict[str, Any]:
    """Return all figures: seconds per contact and per step, ratios and goals."""
    rounds, seconds = QUICK_ROUNDS if quick else ROUNDS
    contact = in_turns(contact_runs(), rounds, seconds)
    law = contact["closed form"]
    goals = [
        Goal("a contact by the closed form, batched [ns]", 1e9 * float(np.median(law)), 25.0, False),
        Goal("brentq and limits per sample / closed form, batched", ratio(contact["brentq and the limits"], law), 200.0, True),
        Goal("closed form / one Polach evaluation", ratio(law, contact["Polach"]), 3.0, False),
    ]
    decision = 1e6 * float(np.median(in_turns({"decision": decision_run()}, rounds, seconds)["decision"]))
    goals.append(Goal("a decision of the bogie's ONNX policy for one vehicle [us]", decision, 50.0, False))
    rows = []
    sizes = QUICK_SIZES if quick else SIZES
    for n, runs in ((1, single_runs()), *((n, step_runs(n)) for n in sizes)):
        times = in_turns(runs, rounds, seconds)
        medians = {name: statistics.median(values.tolist()) for name, values in times.items()}
        shares = {name: ratio(values, times["CartPole"]) for name, values in times.items()}
        rows += [
            {"n": n, "what": name, "step_s": medians[name], "steps_per_s": n / medians[name], "to_cartpole": shares[name]}
            for name in times
        ]
        for name, size, most in AT_MOST:
            if n == size and name in shares:
                goals.append(Goal(f"{name} / CartPole, N = {n}", shares[name], most, False))
        if IN_SPACE in medians:
            share = n * Setup().control_interval_s / medians[IN_SPACE]
            goals.append(Goal(f"{IN_SPACE}, simulated seconds a second, N = {n}", share, FASTEST[n], True))
        if n >= 64:
            goals.append(Goal(f"bogie step / CartPole step, N = {n}", shares["bogie"], 0.5, False))
            interval = Setup().control_interval_s
            goals.append(Goal(f"coach, simulated seconds a second, N = {n}", n * interval / medians["coach"], 2000.0, True))
    return {
        "substep_s": SUBSTEP_S,
        "contact_s": {name: statistics.median(values.tolist()) for name, values in contact.items()},
        "closed_form_to_fastsim": ratio(law, contact["FASTSIM"]),
        "steps": rows,
        "exported": exported_rows(rounds, seconds),
        "goals": [dataclasses.asdict(goal) | {"met": goal.met} for goal in goals],
    }


def print_tables(result: Mapping[str, Any]) -> None:
    """Print the figures as aligned tables."""
    console = Console(width=100, markup=False)  # a unit in brackets is no markup
    law = result["contact_s"]["closed form"]
    table = Table(title="Adhesion of one contact", title_justify="left")
    table.add_column("by")
    table.add_column("time [ns]", justify="right")
    table.add_column("to the closed form", justify="right")
    for name, seconds in result["contact_s"].items():
        table.add_row(name, f"{1e9 * seconds:.1f}", f"{seconds / law:.3g}")
    console.print(table)
    table = Table(title=f"One step of N, substep {1e3 * result['substep_s']:g} ms", title_justify="left")
    table.add_column("N", justify="right")
    table.add_column("of")
    for heading in ("time [us]", "steps a second", "to CartPole"):
        table.add_column(heading, justify="right")
    for row in result["steps"]:
        last = row["what"] == "CartPole"
        figures = f"{1e6 * row['step_s']:.1f}", f"{row['steps_per_s']:.3g}", f"{row['to_cartpole']:.3f}"
        table.add_row(str(row["n"]), row["what"], *figures, end_section=last)
    console.print(table)
    print_exported(console, result["exported"])
    table = Table(title="Goals", title_justify="left")
    table.add_column("figure")
    for heading in ("measured", "goal", "met"):
        table.add_column(heading, justify="right")
    for goal in result["goals"]:
        bound = f"{'>=' if goal['at_least'] else '<='} {goal['goal']:g}"
        table.add_row(goal["what"], f"{goal['measured']:.3g}", bound, "yes" if goal["met"] else "no")
    console.print(table)


def print_exported(console: Console, rows: list[dict[str, Any]]) -> None:
    """Print what C takes and costs."""
    table = Table(title="Exported C beside the Python it is made from", title_justify="left")
    table.add_column("unit, and what runs in Python")
    for heading in ("C [us]", "Python [us]", "lines of C", "object [kB]", "instance [B]"):
        table.add_column(heading, justify="right")
    for row in rows:
        sizes = f"{row['lines']}", f"{row['object_bytes'] / 1000:.0f}", f"{row['remembered_bytes']}"
        table.add_row(row["what"], f"{1e6 * row['c_s']:.3g}", f"{1e6 * row['python_s']:.3g}", *sizes)
    console.print(table)


def main(
    quick: tyro.conf.FlagCreatePairsOff[bool] = False,
    only_exported: Annotated[bool, tyro.conf.arg(name="exported"), tyro.conf.FlagCreatePairsOff] = False,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Print the benchmarks.

    Parameters
    ----------
    quick
        Fewer and shorter rounds, batches of 1 and 64 only.
    only_exported
        Only the C beside the Python that it is made from.
    as_json
        Print JSON instead of tables.

    """
    rounds = QUICK_ROUNDS if quick else ROUNDS
    result = {"exported": exported_rows(*rounds)} if only_exported else measure(quick)
    if as_json:
        print(json.dumps(result))
    elif only_exported:
        print_exported(Console(width=100, markup=False), result["exported"])
    else:
        print_tables(result)


if __name__ == "__main__":
    tyro.cli(main)
