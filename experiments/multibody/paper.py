"""The seed paper's six tests in three dimensions, beside its Table 7; how fast the 3D coach is computed.

    python -m experiments.multibody.paper [--budget 160]

The thresholds of the slide protection are tuned in one dimension on group A (experiments/table7.py) and not touched again; what
is seen here of the 3D coach is predicted, group A too. E_1, eq. (19), is the largest difference of the speeds at one time: the
paper has it against the recordings, which are not public, here it stands against the 1D coach under the same thresholds.
"""

import time

import numpy as np
import tyro
from rich.console import Console
from rich.progress import Progress

from experiments.table7 import PAPER_MEASURED, PAPER_MODEL, brake, search, slides
from wsp_env.evaluation.runner import Conduct, StopRecords
from wsp_env.parameters.velim import SPEED_ERRORS_MPS, TEST_SPEEDS_MPS
from wsp_env.report import Table, terminal_table

#: The paper: 362 s of computing for a stop of some 36 s (its Table 9).
PAPER_REAL_TIME = 0.1


def speed_error(one: StopRecords, three: StopRecords, row: int) -> float:
    """Return E_1 [m/s] of a stop: largest difference of the speeds at one time, 0 after the end."""
    length = max(len(one.time), len(three.time))
    speeds = [np.pad(stop.speed[:, row], (0, length - len(stop.time)), constant_values=0.0) for stop in (one, three)]
    return float(np.abs(speeds[0] - speeds[1]).max())


def main(budget: int = 160) -> None:
    """Print the table.

    Parameters
    ----------
    budget
        Sets of thresholds tried in one dimension.

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


def _off(figures: dict[str, tuple[float, float]]) -> float:
    """Return how far figures are off the paper's model [%], root mean square."""
    ratios = np.array([np.array(figures[name]) / PAPER_MODEL[name] for name in TEST_SPEEDS_MPS])
    return 100.0 * float(np.sqrt(np.mean((ratios - 1.0) ** 2)))


if __name__ == "__main__":
    tyro.cli(main)
