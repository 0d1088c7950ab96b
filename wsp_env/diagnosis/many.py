"""Many campaigns diagnosed by an executor, a task for each; what was diagnosed before by the same code is not done again."""

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

#: In the folder of a diagnosis: from which files and by which code it was made.
MADE_FROM = "made_from.json"


class Many(NamedTuple):
    """How campaigns are diagnosed."""

    effort: float  # of creep curves, see `diagnose_creep_curves`
    seed: int


class Task(NamedTuple):
    """A campaign to diagnose."""

    campaign: Sent
    how: Many

    def __str__(self) -> str:
        """Return what a line may call it."""
        return str(self.campaign)


def diagnose_folder(folder: Path, how: Many, report: Callable[[str], None], workers: int) -> Found:
    """Diagnose what a folder holds, recorded stops or creep curves; `workers` threads, on which the answer does not depend."""
    if holds_creep_curves(folder):
        return diagnose_creep_curves(read_creep_curves(folder), how.effort, how.seed, report)
    recorded = read_campaign(folder)
    return signed(diagnose(recorded, report, workers), folder, recorded)


def work(task: Task) -> bytes:
    """Diagnose a campaign in one thread; return the diagnosis and what there was to warn of, pickled."""
    with task.campaign.here() as folder, warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            found = diagnose_folder(folder, task.how, lambda step: None, 1)
        except (CampaignError, ParameterError) as error:
            raise TaskFailedError(str(error).replace(str(folder), str(task.campaign))) from None
        said = [str(one.message).replace(str(folder), str(task.campaign)) for one in heard]
    return pickle.dumps((found, said))


def diagnose_many(folders: Mapping[Path, Path], how: Many, executor: Executor) -> Iterator[tuple[Path, Found | str, list[str]]]:
    """Yield every campaign's folder with its diagnosis, or why there is none, and the warnings, as they become ready.

    Parameters
    ----------
    folders : of the campaigns, and of what is kept of each

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
    """Write what a diagnosis was made from, once all its other files are there."""
    write_text(out / MADE_FROM, json.dumps(_made_from(folder, how), indent=1) + "\n")


def _made_from(folder: Path, how: Many) -> dict[str, Any]:
    of = "curves" if holds_creep_curves(folder) else "runs"
    return {"files": dict(hashes(folder, of)), "versions": versions(), "effort": how.effort, "seed": how.seed}


def _kept(folder: Path, out: Path, how: Many) -> Found | None:
    """Return the diagnosis that is there, if it was made of the same files by the same code."""
    try:
        if json.loads((out / MADE_FROM).read_text(encoding="utf-8")) != _made_from(folder, how):
            return None
        return read_diagnosis(out / "diagnosis.json")
    except (OSError, ValueError, KeyError, CampaignError):
        return None  # what is wrong with the campaign is said by who reads it
