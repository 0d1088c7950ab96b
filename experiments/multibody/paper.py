"""The seed paper's six tests in three dimensions, beside its Table 7; how fast the 3D coach is computed.

    python -m experiments.multibody.paper [--budget 160] [--picture docs/multibody_paper.png]

The thresholds of the slide protection are tuned in one dimension on group A (experiments/table7.py) and not touched again; what
is seen here of the 3D coach is predicted, group A too. E_1, eq. (19), is the largest difference of the speeds at one time: the
paper has it against the recordings, which are not public, here it stands against the 1D coach under the same thresholds.

The picture is what the paper's Figs 16 to 18 show, but for the recordings: speed and circumferential speed of the first
wheelset in the six tests, and in A1 the speed of a coach whose adhesion does not recover (tau = 0), as classic models have it.
Figs 12 to 15 are drawings of the model.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.progress import Progress

from experiments.multibody.pictures import figure
from experiments.table7 import PAPER_MEASURED, PAPER_MODEL, brake, search, slides
from wsp_env.evaluation.runner import Conduct, StopRecords
from wsp_env.parameters.velim import SPEED_ERRORS_MPS, TEST_SPEEDS_MPS
from wsp_env.report import COLOURS, Table, terminal_table

#: The paper: 362 s of computing for a stop of some 36 s (its Table 9).
PAPER_REAL_TIME = 0.1


def speed_error(one: StopRecords, three: StopRecords, row: int) -> float:
    """Return E_1 [m/s] of a stop: largest difference of the speeds at one time, 0 after the end."""
    length = max(len(one.time), len(three.time))
    speeds = [np.pad(stop.speed[:, row], (0, length - len(stop.time)), constant_values=0.0) for stop in (one, three)]
    return float(np.abs(speeds[0] - speeds[1]).max())


def draw(three: StopRecords, classic: StopRecords, path: Path) -> None:
    """Draw the paper's Figs 16 to 18 without its recordings."""
    picture = figure(9.0, 7.2)
    axes: Any = picture.subplots(3, 2, sharey=True)
    for row, name in enumerate(TEST_SPEEDS_MPS):
        axis = axes[row % 3, row // 3]
        axis.plot(three.time, three.speed[:, row], color="black", label="coach")
        turning = three.speed[:, row] - three.slip[:, row, 0]
        axis.plot(three.time, turning, color=COLOURS[0], linewidth=0.8, label="wheels of axle 1")
        if row == 0:
            axis.plot(classic.time, classic.speed[:, row], "--", color="grey", label="coach, no recovery of adhesion")
            axis.legend(fontsize=8)
        axis.set_title(name, fontsize=9, loc="left")
        axis.set_xlim(0.0, 60.0)
        axis.grid(alpha=0.3)
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("speed [m/s]")
    picture.savefig(path)


def main(budget: int = 160, picture: Path | None = None) -> None:
    """Print the table.

    Parameters
    ----------
    budget
        Sets of thresholds tried in one dimension.
    picture
        Where to draw speeds over time.

    """
    console = Console(width=150, highlight=False)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        found = search(budget, progress)
    one = brake(found)
    brake(found, Conduct(plant="multibody", time_limit_s=0.1))  # compiles
    start = time.process_time()
    three = brake(found, Conduct(plant="multibody"))
    factor = float(three.duration.sum()) / (time.process_time() - start)
    in_one, in_three = slides(one), slides(three)
    rows = []
    for row, name in enumerate(TEST_SPEEDS_MPS):
        cells = [(in_three[name][i], in_one[name][i], PAPER_MODEL[name][i], PAPER_MEASURED[name][i]) for i in (0, 1)]
        errors = f"{speed_error(one, three, row):.2f}", f"{SPEED_ERRORS_MPS[name]:.2f}"
        ways = f"{three.distance[row]:.0f}", f"{one.distance[row]:.0f}"
        rows.append((name, *(f"{value:.2f}" for pair in cells for value in pair), *errors, *ways))
    header = ("test", *(f"{what} {who}" for what in ("mean", "deviation") for who in ("3D", "1D", "paper", "measured")))
    console.print(terminal_table(Table((*header, "E_1 3D to 1D", "E_1 paper", "distance 3D [m]", "1D"), rows, "slides in m/s")))
    off = {who: _off(figures) for who, figures in (("3D", in_three), ("1D", in_one))}
    console.print(f"off the paper's model, root mean square: 3D {off['3D']:.1f} %, 1D {off['1D']:.1f} %")
    console.print(
        f"six stops at once on one core, with the controller: {factor:.1f} x real time (the paper {PAPER_REAL_TIME:g} x)"
    )
    console.print("thresholds: " + ", ".join(f"{name} {value:.3g}" for name, value in found.items()))
    classic = brake(found, Conduct(plant="multibody"), tau_m_per_j=0.0)
    console.print(
        "E_1 in A1 of a coach whose adhesion does not recover: "
        f"{speed_error(three, classic, 0):.2f} m/s, distance {classic.distance[0]:.0f} m"
    )
    if picture:
        draw(three, classic, picture)


def _off(figures: dict[str, tuple[float, float]]) -> float:
    """Return how far figures are off the paper's model [%], root mean square."""
    ratios = np.array([np.array(figures[name]) / PAPER_MODEL[name] for name in TEST_SPEEDS_MPS])
    return 100.0 * float(np.sqrt(np.mean((ratios - 1.0) ** 2)))


if __name__ == "__main__":
    tyro.cli(main)
