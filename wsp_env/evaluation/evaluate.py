"""Runs controllers through the programme, in processes if wanted, and gathers one table of stops."""

import dataclasses
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
import polars

from wsp_env.evaluation import results
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.figures import CAUSES, FIGURES, figures, losses
from wsp_env.evaluation.programme import Case, Conditions, Programme, draw_conditions
from wsp_env.evaluation.reference import clean_rail, perfect_knowledge
from wsp_env.evaluation.results import Task
from wsp_env.evaluation.runner import Conduct, ControllerFailure, run
from wsp_env.parameters.vehicle import Vehicle

#: Rows of the table that are no controllers: the shortest stop, and the controller that knows everything.
BOUND, REFERENCE = "bound", "perfect-knowledge"

_CONDUCT = Conduct()

#: Columns that name a stop.
KEYS = ("controller", "case", "law", "draw")


@dataclasses.dataclass(frozen=True)
class Failure:
    """A controller that failed in a case, and how."""

    controller: str
    case: str
    message: str


@dataclasses.dataclass(frozen=True)
class Trace:
    """The course of one stop (T samples), for pictures."""

    controller: str
    case: str
    law: str
    time: np.ndarray  # (T,) [s]
    position: np.ndarray  # (T,) [m]
    speed: np.ndarray  # (T,) [m/s]
    rim: np.ndarray  # (T, A) peripheral wheel speeds [m/s]
    pressure: np.ndarray  # (T, A) [bar]


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """What came out: one row per stop, the traces of the first draws, the controllers that failed."""

    stops: polars.DataFrame  # KEYS, stopped, FIGURES, lost_CAUSE_m, energy_wheel_K_mj
    traces: tuple[Trace, ...]
    failures: tuple[Failure, ...]


def evaluate(
    controllers: Mapping[str, Mapping[str, Any]],
    programme: Programme,
    cases: Sequence[Case],
    vehicle: Vehicle,
    folder: Path,
    *,
    draws: int = 5,
    seed: int = 0,
    jobs: int = 1,
    conduct: Conduct = _CONDUCT,
    done: Callable[[str], None] = lambda what: None,
) -> Evaluation:
    """Run every controller through every case; what `folder` already holds is not computed again.

    Parameters
    ----------
    controllers : names (see `wsp_env.evaluation.controller.load`) and the parameters to set
    folder : where the results of each controller in each case are kept
    jobs : processes; the results do not depend on it
    done : called with a line for every controller and case that is ready

    `ParameterError` for a controller that cannot be found or made; one that fails while braking is reported in the result.

    """
    for name, parameters in controllers.items():
        load(name, parameters)
    tasks = [
        Task(name, parameters, case, programme.limit, programme.scenario, vehicle, draws, seed, conduct, folder, code)
        for name, parameters, code in [(None, {}, results.code_digest(None))]
        + [(name, parameters, results.code_digest(name)) for name, parameters in controllers.items()]
        for case in cases
    ]
    failures = []
    open_tasks = []
    for task in tasks:
        if task.path.exists():
            done(f"{task.controller or REFERENCE}: {task.case.name}")
        else:
            open_tasks.append(task)
    for task, failure in _work_all(open_tasks, jobs):
        if failure:
            failures.append(Failure(str(task.controller), task.case.name, failure))
        done(f"{task.controller or REFERENCE}: {task.case.name}")
    failures.sort(key=lambda failure: [(t.controller, t.case.name) for t in tasks].index((failure.controller, failure.case)))
    return _gather(tasks, tuple(failures))


def _work_all(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, str | None]]:
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, work(task)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context, initializer=_ignore_interrupt) as pool:
        futures = {pool.submit(work, task): task for task in tasks}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # tasks under way finish and keep their results
            raise


def _ignore_interrupt() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def work(task: Task) -> str | None:
    """Compute and write the results of a task; return what went wrong with its controller."""
    programme = Programme("", task.limit, task.scenario, (task.case,), ())
    conditions = draw_conditions(task.case, programme, task.vehicle, task.draws, task.seed)
    top = ceiling(task.vehicle, conditions.stops, task.limit)
    extra = {}
    if task.controller is None:
        extra["bound"] = top.shortest()[0]
        extra["dry"] = clean_rail(task.vehicle, conditions.stops, task.conduct).distance
        result = perfect_knowledge(task.vehicle, conditions.stops, top, task.conduct)
    else:
        try:
            controller = load(task.controller, task.parameters)
            result = run(controller, task.vehicle, conditions.stops, task.conduct, conditions.sensor_fails_s)
        except ControllerFailure as failure:
            return str(failure)
    first = [row for row, draw in enumerate(conditions.draws) if draw == 0]
    arrays = {f"figure_{name}": values for name, values in figures(result, top).items()}
    arrays |= {f"loss_{name}": values for name, values in losses(result, top).items()}
    arrays |= results.traces(result, first) | _names(conditions) | extra
    results.write(task.path, arrays | {"stopped": result.stopped, "energy": 0.5e-6 * result.contact_work})
    return None


def _names(conditions: Conditions) -> dict[str, np.ndarray]:
    return {"law": np.array(conditions.laws), "draw": np.array(conditions.draws)}


def _gather(tasks: Sequence[Task], failures: tuple[Failure, ...]) -> Evaluation:
    tables, traces = [], []
    compared: dict[str, dict[str, np.ndarray]] = {}
    for task in tasks:
        if not task.path.exists():
            continue
        data = results.read(task.path)
        if task.controller is None:
            compared[task.case.name] = data
            tables.append(_table(BOUND, task.case, data, data, {"figure_distance_m": data["bound"]}))
        name = task.controller or REFERENCE
        tables.append(_table(name, task.case, data, compared[task.case.name], data))
        for row, law in enumerate(data["law"][data["draw"] == 0]):
            keep = slice(0, int(np.argmax(data["trace_speed"][:, row] <= 0.0)) + 1 or None)
            columns = (data[f"trace_{what}"][keep, row] for what in ("position", "speed", "rim", "pressure"))
            traces.append(Trace(name, task.case.name, str(law), data["trace_time"][keep], *columns))
    return Evaluation(polars.concat(tables, how="diagonal"), tuple(traces), failures)


def _table(
    name: str, case: Case, data: Mapping[str, np.ndarray], compared: Mapping[str, np.ndarray], values: Mapping[str, np.ndarray]
) -> polars.DataFrame:
    """Return the rows of one controller in one case, with the ratios to the stops of comparison."""
    stopped = values.get("stopped", np.isfinite(compared["bound"]))
    reached = np.where(stopped, values["figure_distance_m"], np.inf)
    with np.errstate(invalid="ignore"):
        ratios = {
            "ratio_dry": reached / compared["dry"],
            "ratio_bound": reached / compared["bound"],
            "ratio_reference": reached / np.where(compared["stopped"], compared["figure_distance_m"], np.inf),
        }
    own = {figure: values[f"figure_{figure}"] for figure in FIGURES if f"figure_{figure}" in values}
    lost = {f"lost_{cause}_m": values[f"loss_{cause}"] for cause in CAUSES if f"loss_{cause}" in values}
    energy = values.get("energy")
    wheels = {} if energy is None else {f"energy_wheel_{k + 1}_mj": energy[:, k] for k in range(energy.shape[1])}
    count = len(data["law"])
    keys = {"controller": [name] * count, "case": [case.name] * count, "law": data["law"].tolist(), "draw": data["draw"]}
    ordered = {figure: (own | ratios)[figure] for figure in FIGURES if figure in own | ratios}
    return polars.DataFrame(keys | {"stopped": stopped} | ordered | lost | wheels)
