"""What spreading work costs, and what it saves: `python -m experiments.spread_cost [--executors local ray] [--at-once 1 2]`.

Overhead: the time until the workers have done their first tasks, and of each further task: of an empty one, of one that sends a
megabyte and gets it back, and of one that counts for some milliseconds; the least of ten stretches, since others may use the
machine too. Scaling: the same counting, the wall time of the same stops by the number of workers, and the time of all
processors that they took (local workers): divided by the number of workers, it is the wall time on a machine that does nothing
else; and whether all results are equal.
"""

import hashlib
import math
import multiprocessing
import os
import pickle
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Console

from wsp_env.evaluation.carried import carry
from wsp_env.evaluation.evaluate import Job, work
from wsp_env.evaluation.programme import STANDARD, Draws, read_programme, select_cases
from wsp_env.evaluation.results import CaseRun
from wsp_env.evaluation.runner import Conduct
from wsp_env.executor import Executor, Workers
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.report import Table, terminal_table

#: Tasks of a stretch, and stretches after the first tasks.
STRETCH, STRETCHES = 40, 10
MEGABYTE = bytes(1_000_000)
COUNTED = 100_000  # some milliseconds


def nothing(task: int) -> bytes:
    """Do nothing."""
    return b""


def count(task: int) -> bytes:
    """Keep a processor busy."""
    total = 0
    for number in range(COUNTED):
        total += number
    return str(total).encode()


def give_back(task: bytes) -> bytes:
    """Return what was sent."""
    return task


def overhead(executor: Executor, work: Any, task: Any) -> tuple[float, float]:
    """Return the time until the first stretch is done [s], and of each further task [ms], the least of all stretches."""
    marks = [time.perf_counter()]
    for done, _ in enumerate(executor.run(work, [task] * (STRETCH * (1 + STRETCHES))), 1):
        if done % STRETCH == 0:
            marks.append(time.perf_counter())
    lengths = [after - before for before, after in pairwise(marks)]
    return lengths[0], 1e3 * min(lengths[1:]) / STRETCH


def jobs(names: tuple[str, ...], draws: int, far: bool) -> list[Job]:
    """Return tasks as `wsp evaluate` has them: one controller in some cases; none: all that a coach is fast enough for."""
    programme = read_programme(STANDARD)
    runs = [
        CaseRun(
            "rule-based", {}, case, programme.limit, programme.scenario, COACH, Draws(draws), Conduct(), Path(), ""
        )
        for case in select_cases(programme, COACH, names)
    ]  # fmt: skip
    return [Job(run, carry("rule-based", far)) for run in runs]


def processors() -> float:
    """Return the time of all processors that this process and its ended children have taken [s]."""
    for process in multiprocessing.active_children():
        process.join()
    taken = os.times()
    return taken.user + taken.system + taken.children_user + taken.children_system


def stops(executor: Executor, tasks: list[Job]) -> tuple[float, float, str]:
    """Return wall time and processors' time of all tasks [s], the start of the workers included, and a hash of the results."""
    begun, before = time.perf_counter(), processors()
    found = {task.task.case.name: content for task, content, _ in executor.run(work, tasks)}
    taken = time.perf_counter() - begun
    used = math.nan if executor.far else processors() - before  # Ray's workers are no children of this process
    return taken, used, hashlib.sha256(pickle.dumps(sorted(found.items()))).hexdigest()[:12]


def main(
    executors: tuple[Literal["local", "ray"], ...] = ("local",),
    at_once: tuple[int, ...] = (1, 2),
    cases: tuple[str, ...] = (),
    draws: int = 40,
) -> None:
    """Measure and print.

    Parameters
    ----------
    executors
        local, ray.
    at_once
        Numbers of workers.
    cases
        Of the standard programme; none: all.
    draws
        Stops of each case under each law; 0: no stops.

    """
    rows = []
    for name in executors:
        for workers in at_once:
            executor = Workers(name, workers).make()
            first, empty = overhead(executor, nothing, 0)
            heavy, busy = overhead(executor, give_back, MEGABYTE)[1], overhead(executor, count, 0)[1]
            taken, used, digest = stops(executor, jobs(cases, draws, executor.far)) if draws else (0.0, 0.0, "")
            figures = (*(f"{ms:.2f}" for ms in (empty, heavy, busy)), f"{taken:.1f}", f"{used:.1f}")
            rows.append((name, str(workers), f"{first:.1f}", *figures, digest))
            print(*rows[-1], flush=True)
    heads = (
        *("executor", "workers", "start [s]", "empty [ms]", "1 MB [ms]", "counting [ms]", "stops [s]"),
        *("of all processors [s]", "results"),
    )
    task = jobs(cases, draws or 1, False)[0]
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {draws} draws of each case")
    Console(width=140).print(terminal_table(Table(heads, rows)))
    print(f"a task: {len(pickle.dumps(task))} bytes; its result: {len(work(task))} bytes")


if __name__ == "__main__":
    tyro.cli(main)
