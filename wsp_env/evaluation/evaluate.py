"""Runs controllers through the programme, in processes if wanted, and gathers one table of stops."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars

from wsp_env.evaluation import results
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.carried import Carried, carry
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.figures import CAUSES, FIGURES, figures, losses
from wsp_env.evaluation.policy import Policy
from wsp_env.evaluation.programme import Case, CaseStops, Draws, Programme, draw_stops
from wsp_env.evaluation.reference import clean_rail, perfect_knowledge
from wsp_env.evaluation.results import CaseRun
from wsp_env.evaluation.runner import Conduct, ControllerFailure, run
from wsp_env.evaluation.sources import code_digest
from wsp_env.executor import Executor, TaskFailedError, ThisProcess
from wsp_env.parameters.vehicle import Vehicle

#: Rows of the table that are no controllers: the shortest stop, and the controller that knows everything.
BOUND, REFERENCE = "bound", "perfect-knowledge"

_CONDUCT, _DRAWS, _HERE = Conduct(), Draws(), ThisProcess()

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
    draw: int
    time: np.ndarray  # (T,) [s]
    position: np.ndarray  # (T,) [m]
    speed: np.ndarray  # (T,) [m/s]
    wheel: np.ndarray  # (T, A) circumferential wheel speeds [m/s]
    pressure: np.ndarray  # (T, A) [bar]


@dataclasses.dataclass(frozen=True)
class ProgrammeResult:
    """What came out: one row per stop, the traces of the stops but the bound's, the controllers that failed.

    `within_limit` says of a stop that no wheel was beyond the slide limit at the end of any control interval.
    """

    stops: polars.DataFrame  # KEYS, stopped, within_limit, FIGURES, lost_CAUSE_m, energy_wheel_K_mj
    traces: tuple[Trace, ...]
    failures: tuple[Failure, ...]


def evaluate(
    controllers: Mapping[str, Mapping[str, Any]],
    programme: Programme,
    cases: Sequence[Case],
    vehicle: Vehicle,
    folder: Path,
    *,
    draws: Draws = _DRAWS,
    executor: Executor = _HERE,
    conduct: Conduct = _CONDUCT,
    done: Callable[[str], None] = lambda what: None,
) -> ProgrammeResult:
    """Run every controller through every case; what `folder` already holds is not computed again.

    Parameters
    ----------
    controllers : names (see `wsp_env.evaluation.controller.load`) and the parameters to set
    folder : where the results of each controller in each case are kept
    executor : does the work, see `wsp_env.executor`; the results do not depend on it. In this process, as by default, a
        controller may end it
    done : called with a line for every controller and case that is ready

    `ParameterError` for a controller that cannot be found or made, or a policy whose contract does not fit; one that fails
    while braking is reported in the result.

    """
    for name, parameters in controllers.items():
        loaded = load(name, parameters)
        if isinstance(loaded, Policy):
            loaded.check(vehicle, conduct.control_interval_s, conduct.pressure_sensors)
    tasks = [
        CaseRun(name, parameters, case, programme.limit, programme.scenario, vehicle, draws, conduct, folder, code)
        for name, parameters, code in [(None, {}, code_digest(None))]
        + [(name, parameters, code_digest(name)) for name, parameters in controllers.items()]
        for case in cases
    ]
    found = {task.path: data for task in tasks if (data := results.read(task.path)) is not None}
    failures = {}
    for task in tasks:
        if task.path in found:
            done(f"{task.controller or REFERENCE}: {task.case.name}")
    todo = [Job(task, carry(task.controller, executor.far) if task.controller else None)
            for task in tasks if task.path not in found]  # fmt: skip
    for (task, _), content, failure in executor.run(work, todo):
        if not failure:
            results.write(task.path, content)
        data = None if failure else results.read(task.path)
        if data is not None:
            found[task.path] = data
        elif task.controller is None:
            raise RuntimeError(f"{task.case.name}: what the controllers are compared with was not computed ({failure})")
        else:
            failures[task.path] = Failure(task.controller, task.case.name, failure or "its results cannot be read")
        done(f"{task.controller or REFERENCE}: {task.case.name}")
    return _gather(tasks, found, tuple(failures[task.path] for task in tasks if task.path in failures))


class Job(NamedTuple):
    """A controller in a case, as a task."""

    task: CaseRun
    controller: Carried | None

    def __str__(self) -> str:
        """Return what a line may call it."""
        return f"{self.task.controller or REFERENCE}, {self.task.case.name}"


def work(job: Job) -> bytes:
    """Return the results of a task, the content of their file; `TaskFailedError` says what went wrong with its controller."""
    task = job.task
    programme = Programme("", task.limit, task.scenario, (task.case,), ())
    vehicle = task.case.equipped(task.vehicle)
    conduct = dataclasses.replace(task.conduct, mechanisms={**task.conduct.mechanisms, **task.case.mechanisms})
    drawn = draw_stops(task.case, programme, vehicle, task.draws)
    top = ceiling(vehicle, drawn.stops, task.limit)
    extra: dict[str, np.ndarray] = {}
    protected: np.ndarray | None = None
    if job.controller is None:
        extra["bound"] = top.shortest()[0]
        extra["dry"] = clean_rail(vehicle, drawn.stops, conduct).distance
        result = perfect_knowledge(vehicle, drawn.stops, top, conduct)
    else:
        try:
            with job.controller.here() as name:
                controller = load(name, task.parameters)
                result = run(controller, vehicle, drawn.stops, conduct, faults=drawn.faults)
            protected = drawn.faults.protected
        except ControllerFailure as failure:
            raise TaskFailedError(str(failure)) from None
    arrays = {f"figure_{name}": values for name, values in figures(result, top, protected).items()}
    arrays |= {f"loss_{name}": values for name, values in losses(result, top).items()}
    arrays |= results.traces(result) | _names(drawn) | extra
    return results.content(arrays | {"stopped": result.stopped, "energy": 0.5e-6 * result.contact_work})


def _names(drawn: CaseStops) -> dict[str, np.ndarray]:
    return {"law": np.array(drawn.laws), "draw": np.array(drawn.draws)}


def _gather(
    tasks: Sequence[CaseRun], found: Mapping[Path, dict[str, np.ndarray]], failures: tuple[Failure, ...]
) -> ProgrammeResult:
    tables, traces = [], []
    compared: dict[str, dict[str, np.ndarray]] = {}
    for task in tasks:
        if task.path not in found:
            continue
        data = found[task.path]
        if task.controller is None:
            compared[task.case.name] = data
            tables.append(_table(BOUND, task.case, data, data, {"figure_distance_m": data["bound"]}))
        name = task.controller or REFERENCE
        tables.append(_table(name, task.case, data, compared[task.case.name], data))
        for row, (law, draw) in enumerate(zip(data["law"], data["draw"], strict=True)):
            columns = (data[f"trace_{what}"][:, row] for what in ("time", "position", "speed", "wheel", "pressure"))
            traces.append(Trace(name, task.case.name, str(law), int(draw), *columns))
    return ProgrammeResult(polars.concat(tables, how="diagonal"), tuple(traces), failures)


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
    within = values.get("figure_beyond_limit_s", np.zeros(len(reached))) == 0.0  # the bound's by its nature
    own = {figure: values[f"figure_{figure}"] for figure in FIGURES if f"figure_{figure}" in values}
    lost = {f"lost_{cause}_m": values[f"loss_{cause}"] for cause in CAUSES if f"loss_{cause}" in values}
    energy = values.get("energy")
    wheels = {} if energy is None else {f"energy_wheel_{k + 1}_mj": energy[:, k] for k in range(energy.shape[1])}
    count = len(data["law"])
    keys = {"controller": [name] * count, "case": [case.name] * count, "law": data["law"].tolist(), "draw": data["draw"]}
    ordered = {figure: (own | ratios)[figure] for figure in FIGURES if figure in own | ratios}
    return polars.DataFrame(keys | {"stopped": stopped, "within_limit": within} | ordered | lost | wheels)
