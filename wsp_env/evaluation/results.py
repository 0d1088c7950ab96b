"""One case's results on disk: written whole or not at all, named by a hash of everything that determines them."""

import dataclasses
import hashlib
import json
import os
import re
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.evaluation.bound import SlideLimit
from wsp_env.evaluation.programme import Case, Draws
from wsp_env.evaluation.runner import Conduct, StopRecords
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.scenario import Scenario

#: So many samples are kept of the course of a stop.
TRACE_SAMPLES = 250


@dataclasses.dataclass(frozen=True)
class CaseRun:
    """One controller in one case; without a controller, what the others are compared with."""

    controller: str | None
    parameters: Mapping[str, Any]
    case: Case
    limit: SlideLimit
    scenario: Scenario
    vehicle: Vehicle
    draws: Draws
    conduct: Conduct
    folder: Path
    code: str  # digest of the code that computes the results

    @property
    def path(self) -> Path:
        """File of the results: readable, and another for whatever would change them."""
        described = {
            field.name: _plain(getattr(self, field.name)) for field in dataclasses.fields(self) if field.name != "folder"
        }
        digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()[:16]
        label = re.sub(r"[^A-Za-z0-9_-]+", "-", self.controller or "reference").strip("-")[-60:]
        return self.folder / f"{self.case.name}--{label}--{digest}.npz"


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return value if isinstance(value, str | int | float | bool | type(None)) else repr(value)


def write(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write the results at once: an interrupted run leaves the file complete or absent."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, **arrays)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def read(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of a result file; None if there is none, or, with a warning, if it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        warnings.warn(f"{path} cannot be read and is computed again ({error})", stacklevel=2)
        return None


def traces(result: StopRecords) -> dict[str, np.ndarray]:
    """Return time, speed, position (K, N), wheels' speed and pressure (K, N, A) of N stops, each thinned out to K samples."""
    chosen = np.rint(np.linspace(0, result.steps, TRACE_SAMPLES)).astype(int)  # (K, N)
    rows = np.arange(len(result.steps))
    speed = result.speed[chosen, rows]
    return {
        "trace_time": result.time[chosen],
        "trace_speed": speed,
        "trace_wheel": speed[..., None] - result.slip[chosen, rows],
        "trace_pressure": result.pressure[chosen, rows],
        "trace_position": result.position[chosen, rows],
    }
