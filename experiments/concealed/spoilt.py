"""Sound campaigns with one faulty channel each: whether it is found as data, on the right axle, or named as physics.

A file that cannot be read is found if the message names the channel and its unit.
"""

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from experiments.concealed import bank
from experiments.concealed.answers import answer, digest
from experiments.concealed.errors import BankError
from experiments.concealed.faults import FAULTS, inject
from experiments.concealed.outside import LABEL
from experiments.concealed.rates import Rate, put, rate
from experiments.concealed.workers import dumped, results
from wsp_env.executor import Executor, Sent, send


class Job(NamedTuple):
    """One campaign to spoil and to diagnose; picklable."""

    fault: str
    turn: int  # gives its sizes their variety
    campaign: Sent
    seed: int  # of which axle

    def __str__(self) -> str:
        """Return what a line may call it."""
        return f"{self.fault} {self.turn}"


def sound(folder: Path) -> list[Path]:
    """Return the campaigns below a folder in which nothing is missing, by their labels: a bank's, or somebody else's.

    Raises
    ------
    BankError
        where there is none

    """
    if (folder / "bank.json").is_file():
        labels = bank.read_labels(folder)
        found = [folder / "campaigns" / name for name, label in labels.items() if label["class"] == "null"]
    else:
        files = sorted(folder.rglob(LABEL))
        found = [file.parent for file in files if not json.loads(file.read_text(encoding="utf-8"))["effects"]]
    if not found:
        raise BankError(f"{folder} holds no sound campaign: a bank with nulls, or folders with {LABEL} whose effects are []")
    return found


def run(folder: Path, each: int, executor: Executor) -> dict[str, list[dict[str, Any]]]:
    """Return for every kind of fault what became of so many campaigns, each spoilt on an axle and by a size of its own."""
    campaigns = sound(folder)
    jobs = [
        Job(fault, turn, send(campaigns[(turn + i) % len(campaigns)], executor.far), 1000 * i + turn)
        for i, fault in enumerate(FAULTS)
        for turn in range(each)
    ]
    found: dict[str, list[dict[str, Any]]] = {fault: [] for fault in FAULTS}
    for job, content in results(_one, jobs, executor, "spoilt"):
        found[job.fault].append(json.loads(content))
    return found


def _one(job: Job) -> bytes:
    with tempfile.TemporaryDirectory(prefix="wsp-") as place, job.campaign.here() as there:
        folder = Path(place) / "campaign"
        shutil.copytree(there, folder)
        (folder / LABEL).unlink(missing_ok=True)
        axles = inject(folder, job.fault, job.turn, job.seed)
        said, campaign = answer(folder)
    told = [one["channel"] for one in said.get("suspect_channels", ())]
    if campaign is None:  # the reader refuses it: what it says
        told = said["notes"]
    return dumped({
        "turn": job.turn, "axles": axles, "verdict": said["verdict"], "told": told,
        "found": said["verdict"] == "data" or campaign is None,
        "right": any(f"axle{axle}_" in words for words in told for axle in axles),
        "named": [one["name"] for one in said["mechanisms"]] + [one["equation"] for one in said.get("discovered", ())],
    })  # fmt: skip


class Kind(NamedTuple):
    """What became of one kind of fault."""

    found: Rate
    right: Rate  # found, with the axle that is faulty
    as_physics: Rate


def table(found: dict[str, list[dict[str, Any]]]) -> str:
    """Return the figures as a Markdown table, with the code that they are of."""

    def kind(cases: list[dict[str, Any]]) -> Kind:
        right = [one["found"] and one["right"] for one in cases]
        return Kind(rate(one["found"] for one in cases), rate(right), rate(bool(one["named"]) for one in cases))

    every = {"all": [one for cases in found.values() for one in cases]} | found
    lines = [f"SHA-256 of the code: `{digest()}`.", "", "| fault | found | on the right axle | named as physics |",
             "| --- | --- | --- | --- |"]  # fmt: skip
    lines += [f"| {fault} | {' | '.join(map(put, kind(cases)))} |" for fault, cases in every.items()]
    return "\n".join(lines) + "\n"
