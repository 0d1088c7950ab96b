"""One case's results on disk: written whole or not at all, named by a hash of everything that determines them."""

import dataclasses
import hashlib
import io
import json
import re
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.evaluation.bound import SlideLimit
from wsp_env.evaluation.programme import Case, Draws
from wsp_env.evaluation.runner import Conduct, StopRecords
from wsp_env.output import write_whole
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.scenario import Scenario

#: What every result has: one entry a stop, and the course of each.
_EACH_STOP = ("law", "draw", "stopped", "energy", "figure_distance_m")
_KEYS = (*_EACH_STOP, *(f"trace_{what}" for what in ("time", "position", "speed", "wheel", "pressure")))
_DIGEST = "digest"
_LARGEST_BYTES = 2**31  # of a result; those of the programme have some hundred thousand

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


def content(arrays: Mapping[str, Any]) -> bytes:
    """Return the content of a result file."""
    kept = {name: np.asarray(values) for name, values in arrays.items()}
    kept[_DIGEST] = np.array(_digest(kept))
    file = io.BytesIO()
    np.savez_compressed(file, **kept)  # type: ignore[arg-type]  # the stubs have allow_pickle there
    return file.getvalue()


def write(path: Path, arrays: Mapping[str, Any] | bytes) -> None:
    """Write the results, or the content of their file, at once: an interrupted run leaves the file complete or absent."""
    made = arrays if isinstance(arrays, bytes) else content(arrays)
    write_whole(path, lambda file: file.write(made))


def read(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of a result file; None if there is none, or, with a warning, if it is not as it was written."""
    if not path.exists():
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(member.file_size for member in archive.infolist()) > _LARGEST_BYTES:
                raise ValueError(f"it would unpack to more than {_LARGEST_BYTES} bytes")
        with np.load(path, allow_pickle=False) as file:
            found = {name: file[name] for name in file.files}
        if str(found.pop(_DIGEST, "")) != _digest(found):
            raise ValueError("its digest is another")
        if missing := [name for name in _KEYS if name not in found]:
            raise ValueError(f"it lacks {', '.join(missing)}")
        if len({len(found[name]) for name in _EACH_STOP}) != 1:
            raise ValueError("its columns differ in length")
    except Exception as error:  # zipfile, zlib and numpy raise whatever they stumble over
        warnings.warn(f"{path} cannot be read and is computed again ({error})", stacklevel=2)
        return None
    return found


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a hash of names, types, shapes and numbers."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        values = arrays[name]
        digest.update(f"{name} {values.dtype.str} {values.shape} ".encode() + np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


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
