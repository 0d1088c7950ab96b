"""Diagnosis of many campaigns by an executor, one task for each; stored results of the same code and files are reused."""

import json
import pickle
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from wsp_env.diagnosis.creep_curves import diagnose_creep_curves
from wsp_env.diagnosis.diagnose import diagnose
from wsp_env.diagnosis.index import Found
from wsp_env.diagnosis.sources import signed
from wsp_env.diagnosis.stored import read_diagnosis
from wsp_env.executor import Executor, Sent, TaskFailedError, send
from wsp_env.executor.versions import versions
from wsp_env.output import write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignError, read_campaign
from wsp_env.recordings.creep_curves import holds_creep_curves, read_creep_curves
from wsp_env.recordings.origin import hashes

#: File in the folder of a diagnosis that lists the input files and the version of the code.
MADE_FROM = "made_from.json"


class Many(NamedTuple):
    """Options of the diagnoses."""

    effort: float  # of creep curves, see `diagnose_creep_curves`
    seed: int


class Task(NamedTuple):
    """A campaign to diagnose."""

    campaign: Sent
    how: Many

    def __str__(self) -> str:
        """Return the task's name for messages."""
        return str(self.campaign)


def diagnose_folder(folder: Path, how: Many, report: Callable[[str], None], workers: int) -> Found:
    """Diagnose the recorded stops or creep curves in a folder; the answer does not depend on the number of `workers`."""
    if holds_creep_curves(folder):
        return diagnose_creep_curves(read_creep_curves(folder), how.effort, how.seed, report)
    recorded = read_campaign(folder, refuse=False)  # a channel in another unit is an answer
    return signed(diagnose(recorded, report, workers), folder)


def work(task: Task) -> bytes:
    """Diagnose a campaign in one thread; return the diagnosis and the warnings, pickled."""
    with task.campaign.here() as folder, warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            found = diagnose_folder(folder, task.how, lambda step: None, 1)
        except (CampaignError, ParameterError) as error:
            raise TaskFailedError(str(error).replace(str(folder), str(task.campaign))) from None
        said = [str(one.message).replace(str(folder), str(task.campaign)) for one in heard]
    return pickle.dumps((found, said))


def diagnose_many(folders: Mapping[Path, Path], how: Many, executor: Executor) -> Iterator[tuple[Path, Found | str, list[str]]]:
    """Yield every campaign's folder, its diagnosis or error message, and its warnings, in the order of completion.

    Parameters
    ----------
    folders : campaign folder -> folder of its stored diagnosis

    """
    todo = []
    for folder, out in folders.items():
        kept = _kept(folder, out, how)
        if kept is None:
            todo.append(Task(send(folder, executor.far), how))
        else:
            yield folder, kept, []
    for task, content, failure in executor.run(work, todo):
        if failure:
            yield task.campaign.path, failure, []
        else:
            found, said = pickle.loads(content)
            yield task.campaign.path, found, said


def remember(folder: Path, out: Path, how: Many) -> None:
    """Record the input files and versions of a diagnosis, after all its other files are written."""
    write_text(out / MADE_FROM, json.dumps(_made_from(folder, how), indent=1) + "\n")


def _made_from(folder: Path, how: Many) -> dict[str, Any]:
    of = "curves" if holds_creep_curves(folder) else "runs"
    return {"files": dict(hashes(folder, of)), "versions": versions(), "effort": how.effort, "seed": how.seed}


def _kept(folder: Path, out: Path, how: Many) -> Found | None:
    """Return the stored diagnosis if it was made from the same files by the same code, else None."""
    try:
        if json.loads((out / MADE_FROM).read_text(encoding="utf-8")) != _made_from(folder, how):
            return None
        return read_diagnosis(out / "diagnosis.json")
    except (OSError, ValueError, KeyError, CampaignError):
        return None  # errors of the campaign are reported when it is read again
