"""What spreading work costs, and what it saves: `python -m experiments.spread_cost [--executors local ray] [--at-once 1 2]`.

Overhead: time of a task that does nothing, and of one that sends a megabyte and gets it back, as the slope between few tasks
and many, so that the start of the workers does not count; and that start. Scaling: wall time of the same stops, a controller in
each case of the test programme, by the number of workers; and whether all results are equal.
"""

import hashlib
import os
import pickle
import time
from pathlib import Path
from typing import Any

import tyro

from wsp_env.evaluation.carried import carry
from wsp_env.evaluation.evaluate import Job, work
from wsp_env.evaluation.programme import STANDARD, Draws, read_programme, select_cases
from wsp_env.evaluation.results import CaseRun
from wsp_env.evaluation.runner import Conduct
from wsp_env.executor import Executor, Workers
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.report import Table, terminal_table

FEW, MANY = 50, 550
MEGABYTE = bytes(1_000_000)


def nothing(task: int) -> bytes:
    """Do nothing."""
    return b""


def give_back(task: bytes) -> bytes:
    """Return what was sent."""
    return task


def seconds(executor: Executor, work: Any, tasks: list[Any]) -> float:
    """Return the wall time of some tasks [s]."""
    begun = time.perf_counter()
    for _ in executor.run(work, tasks):
        pass
    return time.perf_counter() - begun


def overhead(executor: Executor) -> tuple[float, float, float]:
    """Return the time until the first task is done [s], and of each further empty task and of one of a megabyte [ms]."""
    first = seconds(executor, nothing, [0])
    few, many = (seconds(executor, nothing, list(range(n))) for n in (FEW, MANY))
    light, heavy = (seconds(executor, give_back, [MEGABYTE] * n) for n in (4, 54))
    return first, 1e3 * (many - few) / (MANY - FEW), 1e3 * (heavy - light) / 50


def jobs(draws: int, far: bool) -> list[Job]:
    """Return tasks as `wsp evaluate` has them: one controller in every case that a coach is fast enough for."""
    programme = read_programme(STANDARD)
    runs = [
        CaseRun(
            "rule-based", {}, case, programme.limit, programme.scenario, COACH, Draws(draws), Conduct(), Path(), ""
        )
        for case in select_cases(programme, COACH, ())
    ]  # fmt: skip
    return [Job(run, carry("rule-based", far)) for run in runs]


def stops(executor: Executor, draws: int) -> tuple[float, str]:
    """Return the wall time of all cases [s] and a hash of their results."""
    seconds(executor, work, jobs(1, executor.far))  # the kernels are loaded
    begun = time.perf_counter()
    found = {task.task.case.name: content for task, content, _ in executor.run(work, jobs(draws, executor.far))}
    taken = time.perf_counter() - begun
    return taken, hashlib.sha256(pickle.dumps(sorted(found.items()))).hexdigest()[:12]


def main(executors: tuple[str, ...] = ("local",), at_once: tuple[int, ...] = (1, 2), draws: int = 40) -> None:
    """Measure and print.

    Parameters
    ----------
    executors
        local, ray.
    at_once
        Numbers of workers.
    draws
        Stops of each case under each law.

    """
    rows = []
    for name in executors:
        for count in at_once:
            executor = Workers(name, count).make()  # type: ignore[arg-type]
            first, empty, heavy = overhead(executor)
            taken, digest = stops(executor, draws)
            rows.append((name, str(count), f"{first:.1f}", f"{empty:.2f}", f"{heavy:.1f}", f"{taken:.1f}", digest))
    heads = ("executor", "workers", "first task [s]", "empty task [ms]", "1 MB there and back [ms]", "stops [s]", "results")
    said = f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {len(jobs(1, False))} cases, {draws} draws"
    print(said)
    from rich.console import Console

    Console(width=140).print(terminal_table(Table(heads, rows)))
    task = jobs(draws, False)[0]
    print(f"a task: {len(pickle.dumps(task))} bytes; its result: {len(work(task))} bytes")


if __name__ == "__main__":
    tyro.cli(main)
