"""One case's results on disk: written whole or not at all, named by a hash of everything that determines them."""

import dataclasses
import functools
import hashlib
import importlib.util
import json
import os
import re
import sys
import tempfile
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.evaluation.bound import SlideLimit
from wsp_env.evaluation.controller import SHORT_NAMES
from wsp_env.evaluation.programme import Case
from wsp_env.evaluation.runner import Conduct, Run
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.scenario import Scenario

#: Traces are kept of the first draw under each law, so often [s].
TRACE_INTERVAL_S = 0.2


@dataclasses.dataclass(frozen=True)
class Task:
    """One controller in one case; without a controller, what the others are compared with."""

    controller: str | None
    parameters: Mapping[str, Any]
    case: Case
    limit: SlideLimit
    scenario: Scenario
    vehicle: Vehicle
    draws: int
    seed: int
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


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return value if isinstance(value, str | int | float | bool | type(None)) else repr(value)


def code_digest(controller: str | None) -> str:
    """Return a hash of this package's sources, of the versions it runs on and, if any, of the controller's sources."""
    files: list[Path] = []
    place = SHORT_NAMES.get(controller or "", controller or "").partition(":")[0]
    if Path(place).suffix == ".py" and Path(place).is_file():
        files.append(Path(place))
    elif place and Path(place).is_dir():
        files += [file for file in Path(place).rglob("*") if file.is_file()]
    elif place:
        files += _module_files(place)
    return _digest(_package_digest(), files)


@functools.cache  # what this process runs is what it has imported, whatever happens to the files meanwhile
def _package_digest() -> str:
    package = Path(__file__).parents[1]
    files = [
        file for kind in ("*.py", "*.toml") for file in package.rglob(kind) if "cli" not in file.relative_to(package).parts
    ]
    return _digest(" ".join([sys.version, *(version(name) for name in ("numpy", "scipy", "numba"))]), files)


def _digest(start: str, files: Iterable[Path]) -> str:
    digest = hashlib.sha256(start.encode())
    for file in sorted(files):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def _module_files(module: str) -> list[Path]:
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return []
    origin = Path(found.origin)
    return list(origin.parent.rglob("*.py")) if "." in module else [origin]


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


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a result file."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def traces(result: Run, rows: list[int]) -> dict[str, np.ndarray]:
    """Return time (T,), speed (T, R) and per axle (T, R, A) rim speed and pressure of the stops `rows`, thinned out."""
    every = max(round(TRACE_INTERVAL_S / float(result.time[1])), 1)
    last = int(result.steps[rows].max())
    chosen = np.unique(np.append(np.arange(0, last, every), last))
    speed = result.speed[chosen][:, rows]
    return {
        "trace_time": result.time[chosen],
        "trace_speed": speed,
        "trace_rim": speed[..., None] - result.slip[chosen][:, rows],
        "trace_pressure": result.pressure[chosen][:, rows],
        "trace_position": result.position[chosen][:, rows],
    }
