"""Runs the released diagnosis over a bank: DIR/diagnoses/CASE/diagnosis.json; goes on where it was broken off."""

from pathlib import Path
from typing import Any

from experiments.concealed import answers
from experiments.concealed.bank import read_labels
from experiments.concealed.distances import distance_change
from experiments.concealed.workers import Task, dumped, keep, results
from wsp_env.executor import Executor, send


def answer(folder: Path) -> dict[str, Any]:
    """Diagnose one campaign; `distance_change` is added where something is named."""
    said, campaign = answers.answer(folder)
    if campaign is None or not said["mechanisms"]:
        return said
    return said | {"distance_change": distance_change(campaign, said)}


def _one(task: Task) -> bytes:
    with task.campaign.here() as folder:
        return dumped(answer(folder))


def run(out: Path, executor: Executor, first: int | None = None) -> None:
    """Diagnose every case of the bank, or of its first ones, that has no answer yet.

    Raises
    ------
    BankError
        when the answers that are there are another version's: they would be mixed

    """
    files = {name: out / "diagnoses" / name / "diagnosis.json" for name in read_labels(out, first)}
    answers.hold_version(out / "diagnoses")
    todo = [Task(name, send(out / "campaigns" / name, executor.far)) for name, file in files.items() if not file.is_file()]
    for task, content in results(_one, todo, executor, "diagnoses"):
        keep(files[task.name], content)
