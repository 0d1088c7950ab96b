"""Command: `python -m experiments.concealed [bank | diagnose | score | interest]`; without a subcommand the first three."""

import dataclasses
import json
import multiprocessing
import sys
from pathlib import Path
from typing import Any

import tyro
from rich import print as show

from experiments.concealed import bank, diagnoses, interest
from experiments.concealed.effects import ALL
from experiments.concealed.plan import SHARES
from experiments.concealed.score import Rate, read_answers, score

#: Cases of the small version: enough for every class.
SMALL = 8


@dataclasses.dataclass(frozen=True)
class Bank:
    """Generate the bank and publish the hash of its labels; goes on where it was broken off."""

    out: Path = Path("out/concealed")
    cases: int = 230
    seed: int = 1
    jobs: int = multiprocessing.cpu_count()
    small: bool = False  # a few cases only

    def run(self) -> None:
        """Run."""
        cases = SMALL if self.small else self.cases
        digest = bank.make(self.out, cases, self.seed, self.jobs)
        labels = bank.read_labels(self.out).values()
        kinds = ", ".join(f"{sum(one['class'] == kind for one in labels)} {kind}" for kind in SHARES)
        first = sum(one["concealed_at_first"] for one in labels)
        show(f"{cases} cases ({kinds}) in {self.out}; {first} pass the paper's validation as first drawn, now all do")
        show(f"SHA-256 of the labels: {digest}")


@dataclasses.dataclass(frozen=True)
class Diagnose:
    """Diagnose every case of the bank."""

    out: Path = Path("out/concealed")
    jobs: int = multiprocessing.cpu_count()

    def run(self) -> None:
        """Run."""
        diagnoses.run(self.out, self.jobs)


@dataclasses.dataclass(frozen=True)
class Score:
    """Compare the answers with the labels; prints the figures and writes OUT/score.json."""

    out: Path = Path("out/concealed")
    answers: Path | None = None  # folder of CASE/diagnosis.json; a rival's, else OUT/diagnoses

    def run(self) -> None:
        """Run."""
        figures = score(bank.read_labels(self.out), read_answers(self.answers or self.out / "diagnoses"))
        target = (self.answers or self.out) / "score.json"
        target.write_text(json.dumps(plain(figures), indent=1) + "\n", encoding="utf-8")
        for name in ("false_alarms", "pairs_both_found", "confounded_honest", "foreign_named_wrongly", "foreign_seen"):
            show(f"{name:24s} {_rate(figures[name])}")
        for size, rates in figures["singles_by_size"].items():
            show(f"singles of size {size:12s} first {_rate(rates['right_name_first'])}; in set {_rate(rates['in_set'])}")
        show(f"removed share            {figures['removed_share']}")
        show(f"all figures: {target}")


@dataclasses.dataclass(frozen=True)
class Interest:
    """Compute the smallest effects of interest anew, into smallest.json beside this file (some minutes)."""

    jobs: int = multiprocessing.cpu_count()

    def run(self) -> None:
        """Run."""
        which = [(name, variant) for name, effect in ALL.items() for variant in range(len(effect.variants))]
        with multiprocessing.get_context("spawn").Pool(self.jobs) as pool:
            found = pool.starmap(interest.smallest, which, chunksize=1)
        table = {interest.key(*one): size for one, size in zip(which, found, strict=True)}
        interest.TABLE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Everything(Bank):
    """Generate the bank, diagnose it, score it."""

    def run(self) -> None:
        """Run."""
        super().run()
        Diagnose(self.out, self.jobs).run()
        Score(self.out).run()


def plain(value: Any) -> Any:
    """Return figures as JSON takes them: rates with their fields' names."""
    if isinstance(value, Rate):
        return value._asdict()
    return {key: plain(one) for key, one in value.items()} if isinstance(value, dict) else value


def _rate(one: Rate) -> str:
    share = "none" if one.share is None else f"{one.share:.1%} [{one.lower95:.1%}, {one.upper95:.1%}]"
    return f"{share} ({one.events} of {one.of})"


def main() -> int:
    """Run the command line; 1 after an error that the user can mend."""
    named = {"bank": Bank, "diagnose": Diagnose, "score": Score, "interest": Interest}
    try:
        if len(sys.argv) > 1 and sys.argv[1] in named:
            tyro.cli(named[sys.argv[1]], args=sys.argv[2:], prog=f"python -m experiments.concealed {sys.argv[1]}").run()
        else:
            tyro.cli(Everything, prog="python -m experiments.concealed", description=__doc__).run()
    except bank.BankError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
