"""What an executor is: it does tasks that return bytes, in this process, in others, or on other machines.

A task is picklable and holds all that it needs; its work returns its result as bytes and writes nothing that anybody else
should find: the machines of a cluster share no disk. The caller writes what comes back, and so knows what is left to do when it
begins again.
"""

import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from wsp_env import child

T = TypeVar("T")

#: So often a task is begun whose process dies of something else than its limits of time.
TRIES = 2


class TaskFailedError(Exception):
    """What a task may end with although the program is right: a controller that fails, say. The other tasks go on."""


class ClusterError(Exception):
    """What is wrong with the machines of a cluster; the message says which, and what to do."""


class Outcome(NamedTuple, Generic[T]):
    """What became of a task."""

    task: T
    result: bytes  # none where it failed
    failure: str = ""  # the end of a sentence that begins with the task


class Executor(Protocol):
    """Does tasks.

    What a task returns does not depend on who does it, nor on how many there are; the order in which tasks become ready does.
    """

    @property
    def far(self) -> bool:
        """Whether workers may be on machines that do not see the files of this one."""

    def run(
        self, work: Callable[[T], bytes], tasks: Sequence[T], report: Callable[[str], None] | None = None
    ) -> Iterator[Outcome[T]]:
        """Yield every task with its outcome, as they become ready.

        A task whose process dies is tried once more, and `report` called with a line that says so (None: it is printed to
        standard error). What else than `TaskFailedError` the work raises is raised here. Where the caller breaks off, whatever
        still runs is ended.

        Parameters
        ----------
        work : a function of a module, which every worker can import
        tasks : picklable

        """


class Answer(NamedTuple):
    """What a worker sends back."""

    result: bytes = b""
    failure: str = ""
    error: bytes = b""  # pickled exception


def attempt(work: Callable[[Any], bytes], task: Any) -> Answer:
    """Do a task and return what became of it, unless the process ends."""
    try:
        return Answer(work(task))
    except TaskFailedError as failure:
        return Answer(failure=str(failure))
    except child.TookTooLongError:
        return Answer(failure=child.TOO_LONG)
    except Exception as error:
        return Answer(error=packed(error))


def packed(error: Exception) -> bytes:
    """Return an exception as an answer takes it."""
    try:
        content = pickle.dumps(error)
        pickle.loads(content)
    except Exception:  # an error that cannot be sent: its words can
        return pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
    return content


def outcome_of(task: T, answer: Answer) -> Outcome[T]:
    """Return the outcome that an answer is; what was raised is raised."""
    if answer.error:
        raise pickle.loads(answer.error)
    return Outcome(task, answer.result, answer.failure)


def again(task: object, how: str, report: Callable[[str], None] | None) -> None:
    """Report that a task is tried once more, after its process has died."""
    said = " ".join(str(task).split())
    line = f"{said if len(said) <= _LONGEST else said[:_LONGEST] + ' ...'}: {how}; it is tried once more"
    if report is None:
        print(f"wsp: {line}", file=sys.stderr)
    else:
        report(line)


_LONGEST = 100  # of what a line says of a task, in characters
