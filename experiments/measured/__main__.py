"""Command: `python -m experiments.measured emps|robot PATH [--page]`."""

import dataclasses
import sys
from pathlib import Path
from typing import Annotated

import tyro

from experiments.measured import emps_report, robot_report
from experiments.measured.files import MeasuredError
from experiments.measured.page import fill


@dataclasses.dataclass(frozen=True)
class Emps:
    """Leave dry friction out of the model of an electro-mechanical drive, and search what is missing."""

    path: tyro.conf.Positional[Path]  # folder that holds DATA_EMPS.mat and DATA_EMPS_PULSES.mat
    page: bool = False  # put the figures into the page of the documentation and draw its pictures
    docs: Path = Path("docs")  # folder of the page

    def run(self) -> None:
        """Run."""
        _show(emps_report.blocks(self.path), self.page, self.docs)
        if self.page:
            emps_report.draw(self.path, self.docs)


@dataclasses.dataclass(frozen=True)
class Robot:
    """Conceal from a model of one floor that the robot drives onto another one, and search what is missing."""

    path: tyro.conf.Positional[Path]  # folder that holds one_surface and two_surfaces
    page: bool = False  # put the figures into the page of the documentation and draw its pictures
    docs: Path = Path("docs")  # folder of the page

    def run(self) -> None:
        """Run."""
        report = robot_report.Report.of(self.path)
        _show(report.blocks(), self.page, self.docs)
        if self.page:
            report.draw(self.docs)


def _show(blocks: dict[str, str], page: bool, docs: Path) -> None:
    for text in blocks.values():
        print(text)
    if page:
        fill(docs, blocks)


_Command = Annotated[Emps, tyro.conf.subcommand("emps")] | Annotated[Robot, tyro.conf.subcommand("robot")]


def main() -> int:
    """Run the command line; 1 after an error that the user can repair."""
    try:
        tyro.cli(_Command, prog="python -m experiments.measured", description=__doc__).run()
    except MeasuredError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
