"""Work on the cases of a bank by an executor; answers are written whole or not at all."""

import json
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar

import tyro
from rich.progress import track

from experiments.concealed.errors import BankError
from wsp_env.executor import Executor, Outcome, Sent, Workers
from wsp_env.output import write_whole as write_file
from wsp_env.recordings import Campaign, CampaignWarning, read_campaign

T = TypeVar("T")

#: Who works on the cases of a bank: the processes of this machine, or a Ray cluster.
WorkersOption: TypeAlias = Annotated[Workers, tyro.conf.arg(name="")]


class Task(NamedTuple):
    """A case to answer."""

    name: str
    campaign: Sent

    def __str__(self) -> str:
        """Return what a line may call it."""
        return self.name


def each(work: Callable[[T], bytes], tasks: Sequence[T], executor: Executor, title: str) -> Iterator[Outcome[T]]:
    """Yield all tasks with what became of them, as they become ready, and show how many are."""
    yield from track(executor.run(work, tasks), title, total=len(tasks))


def results(work: Callable[[T], bytes], tasks: Sequence[T], executor: Executor, title: str) -> Iterator[tuple[T, bytes]]:
    """Yield all tasks with their results, as they become ready.

    Raises
    ------
    BankError
        at the end, where a task failed

    """
    failed = []
    for task, result, failure in each(work, tasks, executor, title):
        if failure:
            failed.append(f"{task} {failure}")
        else:
            yield task, result
    if failed:
        raise BankError(f"{title}: {len(failed)} of {len(tasks)} failed, the first: {failed[0]}")


def quietly_read(folder: Path, refuse: bool = True) -> Campaign:
    """Read a campaign without a word on the quality of its channels, which are what they are; `refuse` as in reading."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        return read_campaign(folder, refuse)


def dumped(content: Any) -> bytes:
    """Return content as JSON."""
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def keep(file: Path, content: bytes) -> None:
    """Write a file under a temporary name first: a file that is there is whole."""
    write_file(file, lambda stream: stream.write(content))


def write_whole(file: Path, content: Any) -> None:
    """Write content as JSON, whole or not at all."""
    keep(file, dumped(content))
