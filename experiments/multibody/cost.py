"""Table 9 of the seed paper with the contact detection in it: what a contact costs, part by part.

    python -m experiments.multibody.cost

Eight wheels at the paper's step of 1e-4 s, whose wheelsets swing by 3 mm across the track. Detection is the search along the
whole profile at every step, or following the contacts with a search at every 40th step, as the multibody plant does away from
the flange; then Hertz's theory for the curvatures at hand, then a law. Least of the rounds, as experiments/table9.py.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from experiments.table9 import LAWS, PAPER_S, STEP_S, Law, compiled
from wsp_env.contact.geometry.detect import follow, scan
from wsp_env.contact.geometry.patch import PatchTable, make_patch_table, normal_force, patch_at, stiffness_at
from wsp_env.contact.geometry.port import CURVATURE_A, CURVATURE_B, PENETRATION, Pair, Pose, empty_contacts
from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair
from wsp_env.parameters.velim import CONTACT
from wsp_env.report import Table, terminal_table

WHEELS, STEPS, ROUNDS = 8, 400, 7
SELDOM = 40  # steps between two searches while contacts are followed
SWING_M, DEEP_M = 3e-3, -8e-5  # lateral amplitude, and vertical shift of a loaded wheelset

#: A run over all wheels and steps: rows of contacts, pair, table -> a sum that keeps the compiler from leaving anything out.
Run = Callable[[np.ndarray, Pair, PatchTable], float]


def detecting(search: int) -> Run:
    """Return a run that only finds the contacts, searching anew at every `search`-th step."""

    @compiled
    def run(rows: np.ndarray, pair: Pair, table: PatchTable) -> float:
        total = 0.0
        for step in range(STEPS):
            pose = Pose(SWING_M * math.sin(2.0 * math.pi * step / STEPS), DEEP_M, 0.0, 0.0)
            for wheel in range(WHEELS):
                side = 1.0 - 2.0 * (wheel % 2)
                if step % search == 0:
                    scan(pose, side, pair, rows[wheel])
                else:
                    follow(pose, side, pair, rows[wheel])
                total += rows[wheel, 0, PENETRATION]
        return total

    return run


def forcing(law: Law | None) -> Run:
    """Return a run that computes Hertz's contact and the law's force of the contacts as they were found."""
    known: Any = law

    @compiled
    def hertz(rows: np.ndarray, pair: Pair, table: PatchTable) -> float:
        total = 0.0
        for step in range(STEPS):
            for wheel in range(WHEELS):
                a, b = rows[wheel, 0, CURVATURE_A], rows[wheel, 0, CURVATURE_B]
                deep = 7e-5 + 1e-8 * step
                load = normal_force(deep, 1e-3, stiffness_at(a, b, table), 1.7)
                total += load + patch_at(a, b, load, table).semi_axis_a
        return total

    if law is None:
        return hertz

    @compiled
    def force(rows: np.ndarray, pair: Pair, table: PatchTable) -> float:
        total = 0.0
        for step in range(STEPS):
            for wheel in range(WHEELS):
                total += known(2.0 + 1e-3 * step, 40.0, 52e3 + 10.0 * wheel + step)
        return total

    return force


def measure() -> dict[str, float]:
    """Return seconds per simulated second by part."""
    runs = {"search at every step": detecting(1), "follow": detecting(SELDOM), "Hertz": forcing(None)}
    runs |= {name: forcing(law) for name, law in LAWS.items()}
    pair = make_pair(s1002(), uic60(), Wheelset(), Track())
    table = make_patch_table(2.0 * CONTACT.shear_modulus_pa * (1.0 + CONTACT.poisson_ratio), CONTACT.poisson_ratio)
    rows = empty_contacts(WHEELS)
    least = dict.fromkeys(runs, math.inf)
    for at_least in range(ROUNDS + 1):
        for name, run in runs.items():
            start = time.process_time()
            run(rows, pair, table)
            if at_least:  # the first compiles
                least[name] = min(least[name], time.process_time() - start)
    return {name: value / (STEPS * STEP_S) for name, value in least.items()}


def main() -> None:
    """Print the table."""
    cost = measure()
    whole = {name: cost["follow"] + cost["Hertz"] + cost[name] for name in LAWS}
    searched = {name: cost["search at every step"] + cost["Hertz"] + cost[name] for name in LAWS}
    rows = [
        (
            name, *(f"{1e3 * part[name]:.1f}" for part in (cost, whole, searched)),
            *(f"{part[name] / part['Polach']:.2f}" for part in (whole, searched, PAPER_S)),
        )
        for name in LAWS
    ]  # fmt: skip
    header = ("contact law", "alone", "following, Hertz", "searching, Hertz", "following to Polach", "searching", "the paper's")
    console = Console(width=150, highlight=False)
    console.print(terminal_table(Table(header, rows, "ms per simulated second")))
    parts = "search at every step", "follow", "Hertz"
    console.print(", ".join(f"{name} {1e3 * cost[name]:.1f}" for name in parts) + " ms per simulated second")


if __name__ == "__main__":
    main()
