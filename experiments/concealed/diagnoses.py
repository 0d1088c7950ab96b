"""Runs the released diagnosis over a bank: DIR/diagnoses/CASE/diagnosis.json."""

import importlib
import multiprocessing
from pathlib import Path

from rich.progress import track

from experiments.concealed.bank import BankError, read_labels


def diagnose_case(campaign: Path, out: Path) -> None:
    """Diagnose one campaign into `out`; the only line that knows how the diagnosis is called.

    Raises
    ------
    BankError
        when this version of wsp_env has no diagnosis

    """
    try:
        diagnosis = importlib.import_module("wsp_env.diagnosis")
    except ModuleNotFoundError:
        raise BankError("this version of wsp_env has no diagnosis (wsp_env.diagnosis): only `bank` and `score` work") from None
    diagnosis.diagnose(campaign, out=out)


def _one(folders: tuple[Path, Path]) -> None:
    campaign, out = folders
    if not (out / "diagnosis.json").is_file():
        diagnose_case(campaign, out)


def run(out: Path, jobs: int) -> None:
    """Diagnose every case of the bank that has no answer yet."""
    todo = [(out / "campaigns" / name, out / "diagnoses" / name) for name in read_labels(out)]
    if jobs == 1:
        for folders in track(todo, "diagnoses"):
            _one(folders)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for _ in track(pool.imap_unordered(_one, todo), "diagnoses", total=len(todo)):
            pass
