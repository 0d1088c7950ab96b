"""Command: `python -m experiments.concealed [bank | diagnose | rivals | score | outside | faults | page | interest]`.

Without a subcommand the first four, one after the other.
"""

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import tyro
from rich import print as show

from experiments.concealed import bank, interest, outside, page, spoilt
from experiments.concealed.answers import read_answers
from experiments.concealed.effects import ALL
from experiments.concealed.errors import BankError
from experiments.concealed.plan import SHARES
from experiments.concealed.rates import plain
from experiments.concealed.required import Check, checks, common
from experiments.concealed.score import score
from experiments.concealed.workers import WorkersOption, results, write_whole
from wsp_env.executor import Workers

#: Cases of the small version: enough for every class.
SMALL = len(SHARES)


@dataclasses.dataclass(frozen=True)
class Bank:
    """Generate the bank and publish the hash of its labels; goes on where it was broken off."""

    out: Path = Path("out/concealed")  # folder of the bank, its answers and its figures
    cases: int = 240  # campaigns to make, of all classes; the figures count from 200 on
    seed: int = 4  # of the bank; 1 to 3 were looked at while the diagnosis was made
    workers: WorkersOption = Workers()
    small: bool = False  # make a few cases only

    def run(self) -> None:
        """Run."""
        cases = SMALL if self.small else self.cases
        digest = bank.make(self.out, cases, self.seed, self.workers.make())
        labels = bank.read_labels(self.out).values()
        kinds = ", ".join(f"{sum(one['class'] == kind for one in labels)} {kind}" for kind in SHARES)
        first = sum(one["concealed_at_first"] for one in labels)
        show(f"{cases} cases ({kinds}) in {self.out}; {first} pass the paper's validation as first drawn, now all do")
        show(f"SHA-256 of the labels: {digest}")


@dataclasses.dataclass(frozen=True)
class Diagnose:
    """Diagnose every case of the bank."""

    out: Path = Path("out/concealed")  # folder of the bank, its answers and its figures
    workers: WorkersOption = Workers()
    first: int | None = None  # how many of the cases: they are mixed, any first part holds all classes; default: all

    def run(self) -> None:
        """Run."""
        from experiments.concealed import diagnoses  # looks inside the diagnosis, which the other steps do not need

        diagnoses.run(self.out, self.workers.make(), self.first)


@dataclasses.dataclass(frozen=True)
class Rivals:
    """Let the rivals answer every case of the bank, into OUT/rivals/NAME."""

    out: Path = Path("out/concealed")  # folder of the bank, its answers and its figures
    workers: WorkersOption = Workers()
    first: int | None = None  # how many of the cases: they are mixed, any first part holds all classes; default: all

    def run(self) -> None:
        """Run."""
        from experiments.concealed import rivals  # the same

        rivals.run(self.out, self.workers.make(), self.first)


@dataclasses.dataclass(frozen=True)
class Score:
    """Compare all answers with the labels; prints what is required, writes OUT/score.json and OUT/rivals/NAME/score.json."""

    out: Path = Path("out/concealed")  # folder of the bank, its answers and its figures
    first: int | None = None  # how many of the cases: they are mixed, any first part holds all classes; default: all

    def run(self) -> None:
        """Run."""
        labels = bank.read_labels(self.out, self.first)
        figures = score(labels, read_answers(self.out / "diagnoses"))
        _told(checks(figures))
        _write(self.out / "score.json", figures)
        for name in page.RIVALS:
            if (folder := self.out / "rivals" / name).is_dir():
                _write(folder / "score.json", score(labels, read_answers(folder)))
        show(f"all figures: {self.out / 'score.json'}, of the rivals: {self.out / 'rivals'}")


@dataclasses.dataclass(frozen=True)
class Outside:
    """Diagnose and score campaigns that somebody else made: folders below DIR with campaign.toml and label.json."""

    folder: tyro.conf.Positional[Path]  # holds the campaigns
    out: Path | None = None  # folder of answers and figures; out/concealed/outside/NAME of the folder, where `page` looks
    title: str = ""  # of the tables; the folder's name where left out
    workers: WorkersOption = Workers()

    def run(self) -> None:
        """Run."""
        out = self.out or Path("out/concealed") / page.OUTSIDE / self.folder.resolve().name
        outside.run(self.folder, out, self.workers.make())
        found = outside.score(self.folder, out, self.title or self.folder.resolve().name)
        _told(common(found["promised"]))
        (out / "page.md").write_text(page.others(found), encoding="utf-8")
        show(f"all figures: {out / outside.SCORE}, their tables: {out / 'page.md'}")


@dataclasses.dataclass(frozen=True)
class Faults:
    """Spoil one channel of sound campaigns, and see whether it is found; prints the table of docs/suspect_channels.md."""

    folder: tyro.conf.Positional[Path] = Path("out/concealed")  # a bank, or campaigns of others with label.json
    each: int = 30  # campaigns spoilt by each kind of fault
    out: Path = Path("out/concealed/faults.json")  # what became of each
    workers: WorkersOption = Workers()

    def run(self) -> None:
        """Run."""
        found = spoilt.run(self.folder, self.each, self.workers.make())
        write_whole(self.out, found)
        print(spoilt.table(found))
        show(f"each by itself: {self.out}")


@dataclasses.dataclass(frozen=True)
class Page:
    """Put the figures of OUT, and of OUT/outside/*, into docs/concealed*.md, and the pictures beside them."""

    out: Path = Path("out/concealed")  # folder of the bank, its answers and its figures
    docs: Path = Path("docs")  # folder of the page

    def run(self) -> None:
        """Run."""
        page.fill(self.out, self.docs)


@dataclasses.dataclass(frozen=True)
class Interest:
    """Compute the smallest effects of interest anew, into smallest.json beside this file (some minutes)."""

    workers: WorkersOption = Workers()

    def run(self) -> None:
        """Run."""
        which = [(name, variant) for name, effect in ALL.items() for variant in range(len(effect.variants))]
        found = {one: json.loads(size) for one, size in results(interest.smallest_size, which, self.workers.make(), "sizes")}
        table = {interest.key(*one): found[one] for one in which}
        interest.TABLE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Everything(Bank):
    """Generate the bank, diagnose it, let the rivals answer it, score all answers."""

    def run(self) -> None:
        """Run."""
        super().run()
        Diagnose(self.out, self.workers).run()
        Rivals(self.out, self.workers).run()
        Score(self.out).run()


def _told(found: list[Check]) -> None:
    for one in found:
        mark = {True: "met", False: "NOT MET", None: ""}[one.met]
        show(f"{mark:8s} {one.what}: {one.measured}, required: {one.required}")


def _write(file: Path, figures: dict[str, Any]) -> None:
    file.write_text(json.dumps(plain(figures), indent=1) + "\n", encoding="utf-8")


def main() -> int:
    """Run the command line; 1 after an error that the user can repair."""
    named = {"bank": Bank, "diagnose": Diagnose, "rivals": Rivals, "score": Score, "outside": Outside, "faults": Faults,
             "page": Page, "interest": Interest}  # fmt: skip
    try:
        if len(sys.argv) > 1 and sys.argv[1] in named:
            tyro.cli(named[sys.argv[1]], args=sys.argv[2:], prog=f"python -m experiments.concealed {sys.argv[1]}").run()
        else:
            tyro.cli(Everything, prog="python -m experiments.concealed", description=__doc__).run()
    except BankError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
