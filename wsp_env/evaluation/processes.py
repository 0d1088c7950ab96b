"""Work in several processes, of which any may die: a controller may end the process it runs in."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

T = TypeVar("T")


def work_in_processes(work: Callable[[T], str | None], tasks: Sequence[T], jobs: int) -> Iterator[tuple[T, str | None]]:
    """Yield every task with what `work` says went wrong with it, as they become ready; one may end its process.

    Every process has one task at a time, so that it is known which one ended it. When the caller is interrupted, the tasks
    under way finish and no other is begun.
    """
    waiting = iter(tasks)
    running: dict[Future[str | None], tuple[T, ProcessPoolExecutor]] = {}
    pools = [_process() for _ in range(min(jobs, len(tasks)))]

    def submit(pool: ProcessPoolExecutor) -> None:
        task = next(waiting, None)
        if task is not None:
            running[pool.submit(work, task)] = (task, pool)

    try:
        for pool in pools:
            submit(pool)
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, pool = running.pop(future)
                try:
                    complaint = future.result()
                except BrokenProcessPool:
                    complaint = "ended the process it ran in"
                    pools.remove(pool)
                    pool = _process()
                    pools.append(pool)
                submit(pool)
                yield task, complaint
    finally:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)


def _process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_ignore_interrupt)


def _ignore_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
