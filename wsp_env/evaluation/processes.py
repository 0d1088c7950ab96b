"""Work in several processes, of which any may die or be ended: a controller may end the process it runs in, or never answer."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from wsp_env import child

T = TypeVar("T")

_ENDS_WITHIN_S = 5.0  # a worker whose pipe is closed


def work_in_processes(work: Callable[[T], str | None], tasks: Sequence[T], jobs: int) -> Iterator[tuple[T, str | None]]:
    """Yield every task with what `work` says went wrong with it, as they become ready; one may end its process.

    Every process has one task at a time, so that it is known which one ended it. When the caller is interrupted, all are ended:
    what they write is written whole or not at all.
    """
    waiting = iter(tasks)
    running: dict[Connection, tuple[T, SpawnProcess]] = {}

    def submit(worker: tuple[Connection, SpawnProcess] | None = None) -> None:
        """Give the next task, if there is one, to a worker (None: to a new one)."""
        task = next(waiting, running)
        if task is not running:
            pipe, process = worker or _worker(work)
            running[pipe] = (task, process)  # type: ignore[assignment]  # not the mark of the end
            pipe.send(task)
        elif worker:
            worker[0].close()

    try:
        for _ in range(min(jobs, len(tasks))):
            submit()
        while running:
            for ready in wait(list(running)):
                assert isinstance(ready, Connection)
                task, process = running.pop(ready)
                try:
                    complaint, error = ready.recv()
                except (EOFError, OSError):
                    process.join(_ENDS_WITHIN_S)
                    complaint, error = child.ended_by(process.exitcode), None
                    ready.close()
                    submit()
                else:
                    submit((ready, process))
                if error is not None:
                    raise error
                yield task, complaint
    finally:
        for pipe, (_, process) in running.items():
            process.kill()
            process.join(_ENDS_WITHIN_S)
            pipe.close()


def _worker(work: Callable[[Any], str | None]) -> tuple[Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(work, theirs))
    process.start()
    theirs.close()
    return ours, process


def _serve(work: Callable[[Any], str | None], pipe: Connection) -> None:
    """Do tasks until the pipe is closed; what is raised is sent back."""
    child.become_worker()
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer: tuple[str | None, Exception | None] = (work(task), None)
        except child.TookTooLongError:
            answer = ("took too long and was ended", None)
        except Exception as error:
            answer = (None, error)
        try:
            pipe.send(answer)
        except Exception:  # an error that cannot be sent: its words can
            pipe.send((None, RuntimeError(f"{type(answer[1]).__name__}: {answer[1]}")))
