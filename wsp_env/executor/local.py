"""Executors of this machine: this process itself, or some processes, of which any may die or be ended.

A controller may end the process it runs in, or never answer.
"""

import contextlib
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple, TypeVar

from wsp_env import child
from wsp_env.executor.port import TRIES, Answer, Outcome, again, attempt, outcome_of

T = TypeVar("T")

_ENDS_WITHIN_S = 5.0  # a worker whose pipe is closed

#: Every worker has one thread: there are as many of them as there are processors.
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "POLARS_MAX_THREADS"), "1"
)


class ThisProcess:
    """Does one task after the other in this process, which a task may then end."""

    far = False

    def run(
        self, work: Callable[[T], bytes], tasks: Sequence[T], report: Callable[[str], None] | None = None
    ) -> Iterator[Outcome[T]]:
        """Yield every task with its outcome, see `Executor`."""
        for task in tasks:
            yield outcome_of(task, attempt(work, task))


class _Try(NamedTuple):
    """A task at its first or second try."""

    which: int  # of the tasks
    number: int


class Processes:
    """Does tasks in processes of this machine.

    Every process has one task at a time, so that it is known which one ended it. When the caller is interrupted, all are ended.

    Parameters
    ----------
    jobs : processes; None: as many as the machine has processors for
    processors : that a task takes

    """

    far = False

    def __init__(self, jobs: int | None = None, processors: int = 1) -> None:
        self._jobs = jobs or max(1, (os.cpu_count() or 1) // processors)

    def run(
        self, work: Callable[[T], bytes], tasks: Sequence[T], report: Callable[[str], None] | None = None
    ) -> Iterator[Outcome[T]]:
        """Yield every task with its outcome, see `Executor`."""
        waiting = [_Try(index, 1) for index in reversed(range(len(tasks)))]
        running: dict[Connection, tuple[_Try, SpawnProcess]] = {}

        def submit(worker: tuple[Connection, SpawnProcess] | None = None) -> None:
            """Give the next task, if there is one, to a worker (None: to a new one)."""
            if waiting:
                pipe, process = worker or _worker(work)
                running[pipe] = (waiting.pop(), process)
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it has died: seen when its answer is read
                    pipe.send(tasks[running[pipe][0].which])
            elif worker:
                worker[0].close()

        try:
            for _ in range(min(self._jobs, len(tasks))):
                submit()
            while running:
                for ready in wait(list(running)):
                    assert isinstance(ready, Connection)
                    tried, process = running.pop(ready)
                    try:
                        answer: Answer = ready.recv()
                    except (EOFError, OSError):
                        process.join(_ENDS_WITHIN_S)
                        ready.close()
                        how = child.ended_by(process.exitcode)
                        if tried.number < TRIES and how != child.TOO_LONG:
                            again(tasks[tried.which], how, report)
                            waiting.append(_Try(tried.which, tried.number + 1))
                            submit()
                            continue
                        answer = Answer(failure=how + (", twice" if tried.number == TRIES else ""))
                        submit()
                    else:
                        submit((ready, process))
                    yield outcome_of(tasks[tried.which], answer)
        finally:
            for pipe, (_, process) in running.items():
                process.kill()
                process.join(_ENDS_WITHIN_S)
                pipe.close()


def _worker(work: Callable[[Any], bytes]) -> tuple[Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(work, theirs))
    with _environment(_ONE_THREAD), child.deaf_children():  # the libraries read it when they are loaded
        process.start()
    theirs.close()
    return ours, process


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """While processes are started, let them inherit these variables."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _serve(work: Callable[[Any], bytes], pipe: Connection) -> None:
    """Do tasks until the pipe is closed."""
    child.become_worker()
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(attempt(work, task))
