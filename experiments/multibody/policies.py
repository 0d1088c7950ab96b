"""Controllers and the policy that were made for one dimension, driven in three.

    python -m experiments.multibody.policies [--draws 2] [--out out/multibody_policies]

The same stops of the test programme, with the longitudinal and with the multibody plant: means over draws and both laws.
Interrupted, it goes on where it stopped.
"""

from pathlib import Path
from typing import Annotated

import polars as pl
import tyro
from rich.console import Console

from wsp_env.evaluation.evaluate import REFERENCE, evaluate
from wsp_env.evaluation.programme import STANDARD, Draws, read_programme, select_cases
from wsp_env.evaluation.runner import Conduct
from wsp_env.executor import Workers
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.report import Table, terminal_table

PLANTS = {"1D": "longitudinal", "3D": "multibody"}
POLICY = "agents/trained/coach"
FIGURES = ("distance_m", "mean_slip_mps", "slip_deviation_mps", "beyond_limit_s", "locked_s", "air_nl")


def drive(cases: tuple[str, ...], controllers: tuple[str, ...], draws: int, out: Path, workers: Workers) -> pl.DataFrame:
    """Return one row per controller, case and plant: means of `FIGURES`."""
    programme = read_programme(STANDARD)
    tables = []
    for label, plant in PLANTS.items():
        result = evaluate(
            {name: {} for name in controllers}, programme, select_cases(programme, COACH, cases), COACH, out / label,
            draws=Draws(draws), executor=workers.make(), conduct=Conduct(plant=plant),
        )  # fmt: skip
        for failure in result.failures:
            raise RuntimeError(f"{failure.controller} in {failure.case}: {failure.message}")
        means = result.stops.group_by("case", "controller", maintain_order=True).agg(
            pl.col("stopped").all(), *(pl.col(figure).mean() for figure in FIGURES)
        )
        tables.append(means.with_columns(plant=pl.lit(label)))
    return pl.concat(tables)


def main(
    cases: tuple[str, ...] = ("low-120", "low-160", "extremely-low-120", "change-down-160", "patches-160"),
    controllers: tuple[str, ...] = ("none", "rule-based", "adaptive", POLICY),
    draws: int = 2,
    workers: Annotated[Workers, tyro.conf.arg(name="")] = Workers(),
    out: Path = Path("out/multibody_policies"),
) -> None:
    """Print the table.

    Parameters
    ----------
    cases
        Of the standard programme.
    controllers
        As for `wsp evaluate`.
    draws
        Stops of each case under each law.
    workers
        Who does the work.
    out
        Folder that keeps what was computed, and table.csv.

    """
    found = drive(cases, controllers, draws, out, workers)
    found.write_csv(out / "table.csv")
    rows = []
    for case in cases:
        for name in (*controllers, REFERENCE):
            own = {row["plant"]: row for row in found.filter(case=case, controller=name).to_dicts()}
            cells = [
                f"{own[plant][figure]:.{0 if figure in ('distance_m', 'air_nl') else 2}f}"
                for figure in FIGURES
                for plant in PLANTS
            ]
            longer = 100.0 * (own["3D"]["distance_m"] / own["1D"]["distance_m"] - 1.0)
            rows.append((case, name.rpartition("/")[2], *cells[:2], f"{longer:+.1f} %", *cells[2:]))
    heads = ("distance [m]", "mean slip [m/s]", "deviation [m/s]", "beyond limit [s]", "locked [s]", "air [Nl]")
    paired = [f"{head} {plant}" for head in heads for plant in PLANTS]
    Console(width=190).print(terminal_table(Table(("case", "controller", *paired[:2], "3D to 1D", *paired[2:]), rows)))


if __name__ == "__main__":
    tyro.cli(main)
