"""Size and cost of the exported C beside the Python that it is made from, for `experiments/benchmark.py`."""

import ctypes
import dataclasses
import shutil
import subprocess
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wsp_env.evaluation.controller import load
from wsp_env.export.files import FLAGS, write_unit
from wsp_env.export.inputs import random_drive
from wsp_env.export.law import evaluate_many, law_unit, random_states
from wsp_env.export.make import make_unit
from wsp_env.export.plant import plant_unit, random_stop, stop_parameters
from wsp_env.export.unit import Unit
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.velim import CONTACT
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.port import Setup

#: Units of work of one call.
CONTACTS, STEPS = 4096, 400

#: Controllers: name or folder, what is said of them, vehicle.
DECIDED = (
    ("rule-based", "rules of a coach, a decision: numpy", "coach"),
    ("adaptive", "adaptive control of a coach, a decision: numba", "coach"),
    (
        str(Path(__file__).parents[1] / "agents" / "trained" / "bogie"),
        "policy of a bogie, a decision: numba, onnxruntime",
        "bogie",
    ),
)

#: A library that begins a unit and takes many steps of it: with rows of inputs (rows, width), or the same ones.
_MANY = """#include "{name}.h"
void many(const double *given, long parameters, const double *rows, long width, long n);
long remembered(void);
void many(const double *given, long parameters, const double *rows, long width, long n)
{{
    static {name} self;
    {name}_parameters p;
    {name}_input u;
    {name}_output y;
    long i, j;
    {name}_defaults(&p);
    for (j = 0; j < parameters; j++) {{
        ((double *)&p)[j] = given[j];
    }}
    {name}_start(&self, &p);
    for (i = 0; i < n; i++) {{
        for (j = 0; j < width; j++) {{
            ((double *)&u)[j] = rows[i * width + j];
        }}
        {name}_step(&self, &u, &y);
    }}
}}
long remembered(void)
{{
    return (long)sizeof({name});
}}
"""


class Exported(NamedTuple):
    """A unit of C and what it is compared with."""

    what: str
    lines: int
    object_bytes: int
    remembered_bytes: int
    in_c: Callable[[], int]
    in_python: Callable[[], int]


def compiler() -> str | None:
    """Return a C compiler of this machine."""
    return shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")


def _built(
    unit: Unit, folder: Path, rows: np.ndarray, parameters: Sequence[float] = ()
) -> tuple[int, int, int, Callable[[], int]]:
    """Return lines, bytes of the object, bytes of an instance and what takes the steps."""
    write_unit(unit, folder)
    (folder / "many.c").write_text(_MANY.format(name=unit.name))
    flags = [str(compiler()), *FLAGS, "-fPIC"]
    subprocess.run([*flags, "-c", f"{unit.name}.c"], cwd=folder, check=True)
    subprocess.run([*flags, "-shared", "-o", "many.so", "many.c", f"{unit.name}.o", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "many.so"))
    library.remembered.restype = ctypes.c_long
    given, set_ = np.ascontiguousarray(rows), np.array(parameters, dtype=np.float64)
    arguments = (
        ctypes.c_void_p(set_.ctypes.data), ctypes.c_long(len(set_)), ctypes.c_void_p(given.ctypes.data),
        ctypes.c_long(given.shape[1]), ctypes.c_long(len(given)),
    )  # fmt: skip

    def run() -> int:
        library.many(*arguments)
        return len(given)

    lines = len((folder / f"{unit.name}.c").read_text().splitlines())
    return lines, (folder / f"{unit.name}.o").stat().st_size, library.remembered(), run


def has_onnx() -> bool:
    """Whether policies can be exported here."""
    return find_spec("onnx") is not None and find_spec("onnxruntime") is not None


def decisions(name: str, said: str, vehicle: Vehicle) -> tuple[str, Unit, np.ndarray, Callable[[], int]]:
    """Return a controller's unit, the rows of its inputs over a drive, and what decides on the same in Python."""
    controller = load(name)
    drive = list(random_drive(vehicle, 0.02, STEPS, np.random.default_rng(0)))
    seen = np.array([[one.time[0], *one.wheel_speed[0], one.demand[0]] for one in drive])

    def decide() -> int:
        controller.reset(1, vehicle)
        for one in drive:
            controller.act(one)
        return STEPS

    return said, make_unit(name, vehicle), seen, decide


def exported(folder: Path) -> list[Exported]:
    """Return the law, the plant of a coach and controllers, in C and as they are."""
    states, made = random_states(CONTACTS), np.empty((CONTACTS, 6))

    def law() -> int:
        evaluate_many(states, CONTACT.law, made)
        return CONTACTS

    coach = VEHICLES["coach"]
    plant = LongitudinalPlant(coach, 1, Setup())
    stop = dataclasses.replace(
        random_stop(coach, 1, np.random.default_rng(0)), initial_speed=40.0, mu_cd=0.04, tau=1e-4
    )  # slides
    command = np.ones((1, coach.axles))

    def step() -> int:
        plant.start(0, stop)
        for _ in range(STEPS):
            plant.step(command)
        return STEPS

    units = [
        ("degraded law, one contact: numba", law_unit(CONTACT.law), states, law),
        ("plant of a coach, 20 ms: numba", plant_unit(coach), np.ones((STEPS, coach.axles + 1)), step),
        *(decisions(name, said, VEHICLES[vehicle]) for name, said, vehicle in DECIDED if not Path(name).is_dir() or has_onnx()),
    ]
    found = []
    for number, (what, unit, rows, own) in enumerate(units):
        parameters = stop_parameters(stop) if unit.name == "wsp_plant" else ()  # the same stop
        found.append(Exported(what, *_built(unit, folder / str(number), rows, parameters), own))
    return found
