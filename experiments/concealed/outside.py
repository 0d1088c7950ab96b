"""The same proof on campaigns that somebody else made: folders with campaign.toml and label.json, see `truths`.

Before the first answer the labels are copied and their hash is written; from then on other labels are refused.
"""

import hashlib
import json
import traceback
from pathlib import Path
from typing import Any, NamedTuple

from experiments.concealed.answers import answer, hold_version, read_answers
from experiments.concealed.errors import BankError
from experiments.concealed.promised import by_group, promised
from experiments.concealed.rates import plain
from experiments.concealed.truths import Truth, of_label
from experiments.concealed.workers import Task, dumped, each, keep, write_whole
from wsp_env.executor import Executor, TaskFailedError, send

LABEL, HASH, ANSWERS, SCORE, FAILED = "label.json", "labels.sha256", "answers", "score.json", "failed.txt"


class Labels(NamedTuple):
    """What is true of all campaigns below a folder."""

    truths: dict[str, Truth]  # by the campaign's folder, relative
    sha256: str  # of every label.json with its name


def read_labels(folder: Path) -> Labels:
    """Read the labels of all campaigns below a folder.

    Raises
    ------
    BankError
        where there is no campaign, one has no label, or a label cannot be understood

    """
    names = sorted(file.parent.relative_to(folder).as_posix() for file in folder.rglob("campaign.toml"))
    if not names:
        raise BankError(f"{folder} holds no campaign (campaign.toml)")
    if bare := [name for name in names if not (folder / name / LABEL).is_file()]:
        raise BankError(f"{len(bare)} of {len(names)} campaigns in {folder} have no {LABEL}, the first is {bare[0]}")
    hashed, truths = hashlib.sha256(), {}
    for name in names:
        content = (folder / name / LABEL).read_bytes()
        hashed.update(name.encode() + b"\0" + content + b"\0")
        try:
            truths[name] = of_label(name, json.loads(content))
        except json.JSONDecodeError as error:
            raise BankError(f"{folder / name / LABEL} is no JSON: {error}") from error
    return Labels(truths, hashed.hexdigest())


def freeze(labels: Labels, out: Path) -> None:
    """Write the labels' hash before there is any answer.

    Raises
    ------
    BankError
        when it stands there already and is another one: campaigns or labels came after answers

    """
    file = out / HASH
    if file.is_file() and file.read_text(encoding="utf-8").split()[0] != labels.sha256:
        raise BankError(f"the labels have changed since {file} was written: choose another folder for the answers")
    out.mkdir(parents=True, exist_ok=True)
    file.write_text(f"{labels.sha256}  all {LABEL}\n", encoding="utf-8")


def _one(task: Task) -> bytes:
    with task.campaign.here() as folder:
        try:
            return dumped(answer(folder)[0])
        except Exception:  # other people's data may break the diagnosis: the rest is answered, and `run` tells
            raise TaskFailedError(traceback.format_exc()) from None


def run(folder: Path, out: Path, executor: Executor) -> None:
    """Diagnose every campaign that has no answer yet.

    Raises
    ------
    BankError
        when labels or code have changed since the first answer, or the diagnosis broke down on a campaign

    """
    labels = read_labels(folder)
    freeze(labels, out)
    hold_version(out / ANSWERS)
    answered = {name: out / ANSWERS / name / "diagnosis.json" for name in labels.truths}
    missing = [Task(name, send(folder / name, executor.far)) for name, file in answered.items() if not file.is_file()]
    broken = []
    for task, content, failure in each(_one, missing, executor, "diagnoses"):
        file = answered[task.name]
        if failure:
            broken.append(file.with_name(FAILED))
        keep(file.with_name(FAILED) if failure else file, failure.encode() or content)
    if broken:
        raise BankError(f"the diagnosis broke down on {len(broken)} of {len(answered)} campaigns, see {sorted(broken)[0]}")


def score(folder: Path, out: Path, title: str) -> dict[str, Any]:
    """Compare the answers with the labels; write OUT/score.json and return what it holds, rates as such.

    Raises
    ------
    BankError
        when an answer is missing, or labels have changed since the first one

    """
    labels = read_labels(folder)
    freeze(labels, out)
    given = read_answers(out / ANSWERS)
    if missing := sorted(set(labels.truths) - set(given)):
        raise BankError(f"no answer for {len(missing)} of {len(labels.truths)} campaigns, the first is {missing[0]}")
    cases = [(truth, given[name]) for name, truth in labels.truths.items()]
    version = json.loads((out / ANSWERS / "version.json").read_text(encoding="utf-8"))
    figures = {"title": title, "labels": labels.sha256, "code": version, "promised": promised(cases), "groups": by_group(cases)}
    write_whole(out / SCORE, plain(figures))
    return figures
