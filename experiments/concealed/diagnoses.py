"""Runs the released diagnosis over a bank: DIR/diagnoses/CASE/diagnosis.json; goes on where it was broken off."""

from pathlib import Path
from typing import Any

from experiments.concealed import answers
from experiments.concealed.bank import read_labels
from experiments.concealed.distances import distance_change
from experiments.concealed.workers import each, write_whole


def answer(folder: Path) -> dict[str, Any]:
    """Diagnose one campaign; `distance_change` is added where something is named."""
    said, campaign = answers.answer(folder)
    if campaign is None or not said["mechanisms"]:
        return said
    return said | {"distance_change": distance_change(campaign, said)}


def _one(folders: tuple[Path, Path]) -> None:
    campaign, out = folders
    write_whole(out / "diagnosis.json", answer(campaign))


def run(out: Path, jobs: int) -> None:
    """Diagnose every case of the bank that has no answer yet.

    Raises
    ------
    BankError
        when the answers that are there are another version's: they would be mixed

    """
    names, folder = list(read_labels(out)), out / "diagnoses"
    answers.hold_version(folder)
    todo = [(out / "campaigns" / name, folder / name) for name in names if not (folder / name / "diagnosis.json").is_file()]
    each(_one, todo, jobs, "diagnoses")
