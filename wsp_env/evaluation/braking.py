"""One controller on some stops, as a task of an executor: a controller that ends its process then ends a worker only."""

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from wsp_env.evaluation.carried import Carried
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct, ControllerFailure, run
from wsp_env.executor import TaskFailedError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Stop


class Braking(NamedTuple):
    """One controller on all stops, as a task."""

    name: str
    controller: Carried
    parameters: Mapping[str, Any]
    vehicle: Vehicle
    stops: tuple[Stop, ...]
    conduct: Conduct

    def __str__(self) -> str:
        """Return what a line may call it."""
        return self.name


class Braked(NamedTuple):
    """N stops with A axles, see `wsp_env.evaluation.runner.StopRecords`."""

    time: np.ndarray  # (T + 1,) [s]
    speed: np.ndarray  # (T + 1, N) [m/s]
    position: np.ndarray  # (T + 1, N) [m]
    slip: np.ndarray  # (T + 1, N, A) [m/s]
    steps: np.ndarray  # (N,)
    distance: np.ndarray  # (N,) [m]
    stopped: np.ndarray  # (N,) bool


def work(task: Braking) -> bytes:
    """Return the braked stops, for `read`; `TaskFailedError` says what went wrong with the controller."""
    try:
        with task.controller.here() as name:
            result = run(load(name, task.parameters), task.vehicle, task.stops, task.conduct)
    except ControllerFailure as failure:
        raise TaskFailedError(str(failure)) from None
    file = io.BytesIO()
    np.savez(file, **{field: getattr(result, field) for field in Braked._fields})
    return file.getvalue()


def read(content: bytes) -> Braked:
    """Return what `work` has returned."""
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return Braked(**{field: file[field] for field in Braked._fields})
