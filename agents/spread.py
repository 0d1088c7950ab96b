"""Trainings side by side: `python -m agents.spread --seeds 1 2 3 --vehicle bogie`, here or on a cluster (`--executor ray`).

Takes the arguments of `agents.train`; each seed gets its folder, out/agents/VEHICLE-SEED, as if it were trained alone, and with
the same weights. Begun again, those that are not ready go on from their last checkpoint. On other machines a training begins
from the checkpoint that is here; its own come back with it, when it is ready.
"""

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from rich.progress import track

from agents import checkpoint, settings, train
from wsp_env.executor import Executor, Sent, Workers, pack, send, unpack

#: Who trains; a training takes `train.THREADS` processors.
WorkersOption = Annotated[Workers, tyro.conf.arg(name="")]


class Task(NamedTuple):
    """A training."""

    arguments: settings.Arguments
    folder: Sent  # the run's, with what is there of it

    def __str__(self) -> str:
        """Return what a line may call it."""
        return str(self.folder)


def task_of(arguments: settings.Arguments, executor: Executor) -> Task:
    """Return a training as an executor takes it."""
    return Task(arguments, send(arguments.out, executor.far))


def whole(task: Task) -> bytes:
    """Train and export; return the run's folder, packed."""
    with task.folder.here() as folder:
        train.main(dataclasses.replace(task.arguments, out=folder))
        return pack(folder)


def score(task: Task) -> bytes:
    """Train; return the best score on the watched stops, as JSON."""
    with task.folder.here() as folder:
        train.train(dataclasses.replace(task.arguments, out=folder))
        with np.load(folder / checkpoint.BEST) as best:
            return json.dumps(float(best["curve/score"][-1])).encode()


def results(
    work: Callable[[Task], bytes], tasks: Iterable[Task], executor: Executor
) -> Iterator[tuple[settings.Arguments, bytes, str]]:
    """Yield the arguments of every training with its result or its failure, as they become ready."""
    given = list(tasks)
    for task, content, failure in track(executor.run(work, given), "trainings", total=len(given)):
        yield task.arguments, content, failure


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is trained, and by whom."""

    seeds: tuple[int, ...]
    training: Annotated[settings.Arguments, tyro.conf.arg(name="")] = dataclasses.field(default_factory=settings.Arguments)
    workers: WorkersOption = Workers()


def main(arguments: Arguments, executor: Executor) -> None:
    """Train every seed that has no policy yet."""
    out = arguments.training.out if arguments.training.out.name else Path("out/agents")
    runs = [
        dataclasses.replace(arguments.training, seed=seed, out=out / f"{arguments.training.vehicle}-{seed}")
        for seed in arguments.seeds
    ]
    todo = [task_of(run, executor) for run in runs if not (run.out / "policy").is_dir()]
    failed = []
    for run, content, failure in results(whole, todo, executor):
        if failure:
            failed.append(f"{run.out} {failure}")
        elif executor.far:
            unpack(content, run.out)
        print(failed[-1] if failure else f"{run.out / 'policy'} is ready", flush=True)
    if failed:
        raise SystemExit("; ".join(failed))


if __name__ == "__main__":
    chosen = tyro.cli(Arguments)
    main(chosen, chosen.workers.make(train.THREADS))
