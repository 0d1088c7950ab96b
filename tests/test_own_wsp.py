"""One's own WSP as a shared library: the template brakes, and what is wrong with a library is said."""

import dataclasses
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from wsp_env.evaluation.controller import load
from wsp_env.evaluation.native import NativeController
from wsp_env.evaluation.runner import Conduct, ControllerFailure, run
from wsp_env.evaluation.sources import code_digest
from wsp_env.export.make import HEADER, TEMPLATES, write_template
from wsp_env.export.plant import random_stop
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.port import Measurement

COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")

STEP = "int32_t wsp_step(void *c, const wsp_measurement *seen, double *command) { (void)c; (void)seen; (void)command; %s }"
REST = (
    "static int own; int32_t wsp_init(const wsp_vehicle *v, void **c) { *c = &own; return v->axles > 2 ? 7 : 0; }"
    "void wsp_free(void *c) { (void)c; }"
)


def library(folder: Path, source: str, name: str = "mine") -> Path:
    """Build a library from source."""
    (folder / f"{name}.c").write_text(source)
    out = folder / f"{name}.so"
    subprocess.run(
        [str(COMPILER), "-std=c99", "-shared", "-fPIC", f"-I{TEMPLATES}", "-o", out, f"{name}.c"], cwd=folder, check=True
    )
    return out


def with_step(body: str) -> str:
    """Return the source of a library that does this at every decision."""
    return f'#include "{HEADER}"\n#include <stdlib.h>\nWSP_CONTROLLER\n{STEP % body}\n{REST}\n'


def seen(n: int, axles: int, time: float = 0.0) -> Measurement:
    """Return what wheels that roll say."""
    return Measurement(np.full(n, time), np.full((n, axles), 60.0), np.ones(n))


@pytest.mark.slow
def test_the_template_is_built_without_a_warning_and_brakes(tmp_path: Path) -> None:
    """It keeps wheels from locking where none would."""
    write_template(tmp_path)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-shared", "-fPIC"]
    subprocess.run([str(COMPILER), *flags, "-o", "my_wsp.so", "my_wsp.c"], cwd=tmp_path, check=True)
    vehicle = VEHICLES["bogie"]
    rng = np.random.default_rng(0)
    poor = {"mu_cd": 0.02, "tau": 0.0, "initial_speed": 25.0}
    stops = [dataclasses.replace(random_stop(vehicle, 1, rng), **poor) for _ in range(2)]
    made = run(load(str(tmp_path / "my_wsp.so")), vehicle, stops, Conduct(time_limit_s=10.0))
    assert set(np.unique(made.command)) <= {-1.0, 0.0, 1.0}
    assert (made.command < 0.0).any()
    locked = run(load("none"), vehicle, stops, Conduct(time_limit_s=10.0))
    assert made.slip.max() < locked.slip.max()


def test_a_file_that_is_no_library_is_refused(tmp_path: Path) -> None:
    """With what it is instead, and what to do."""
    damaged = tmp_path / "mine.so"
    damaged.write_bytes(b"\x7fELF nonsense")
    with pytest.raises(ParameterError, match=r"no shared library that runs on this machine"):
        load(str(damaged))
    with pytest.raises(ParameterError, match=r"there is no file"):
        load(str(tmp_path / "other.so"))
    with pytest.raises(ParameterError, match=r"is source: build it, gcc"):
        load(str(tmp_path / "mine.c"))
    with pytest.raises(ParameterError, match=r"no parameters to set"):
        load(str(damaged), {"x": 1})


def test_a_library_of_another_form_is_refused(tmp_path: Path) -> None:
    """Functions that are missing, no version, another version, a vehicle that it refuses."""
    with pytest.raises(ParameterError, match=r"lacks wsp_init, wsp_step, wsp_free"):
        load(str(library(tmp_path, "int nothing;\n", "nothing")))
    text = with_step("return 0;")
    with pytest.raises(ParameterError, match=r"WSP_CONTROLLER once"):
        load(str(library(tmp_path, text.replace("WSP_CONTROLLER\n", ""), "unversioned")))
    other = text.replace("WSP_CONTROLLER\n", "const int32_t wsp_interface = 9;\n")
    with pytest.raises(ParameterError, match=r"built for version 9 .* build it anew"):
        load(str(library(tmp_path, other, "newer")))
    refusing = load(str(library(tmp_path, text)))
    with pytest.raises(RuntimeError, match=r"refused a vehicle of 4 axles: wsp_init returned 7"):
        refusing.reset(1, VEHICLES["coach"])


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return 3;", "failed in stop 1: wsp_step returned 3"),
        ("return 0;", "returned nan for axle 1"),
        ("abort();", "crashed .SIGABRT.: look for an assertion"),
        ("exit(0);", "ended its process .exit status 0.: it must return"),
        ("command[0] = command[1] = 2.0; return 0;", "gave 2 for axle 1 of stop 1: -1 vents, 0 holds, .1 applies"),
        ("*(volatile int *)0 = 1; return 0;", "crashed .SIGSEGV"),
    ],
)
def test_a_library_that_fails_ends_no_more_than_its_own_process(body: str, said: str, tmp_path: Path) -> None:
    """What happened is said, with the time."""
    vehicle = VEHICLES["bogie"]
    controller = load(str(library(tmp_path, with_step(body))))
    with pytest.raises(ControllerFailure, match=said):
        run(controller, vehicle, [random_stop(vehicle, 1, np.random.default_rng(0))], Conduct(time_limit_s=1.0))


@pytest.mark.slow
def test_a_library_that_never_answers_is_ended(tmp_path: Path) -> None:
    """After its time of the processor; then it can be begun anew."""
    loop = with_step("if (seen->time_s > 0.5) { volatile int n = 1; while (n) { } } command[0] = command[1] = 1.0; return 0;")
    controller = NativeController(library(tmp_path, loop), decision_limit_s=0.5)
    controller.reset(2, VEHICLES["bogie"])
    assert np.array_equal(controller.act(seen(2, 2)), np.ones((2, 2)))
    with pytest.raises(RuntimeError, match="took too long and was ended"):
        controller.act(seen(2, 2, 1.0))
    controller.reset(1, VEHICLES["bogie"])
    assert np.array_equal(controller.act(seen(1, 2)), np.ones((1, 2)))


def test_results_follow_the_library(tmp_path: Path) -> None:
    """What was computed with another build is not taken for this one's."""
    file = tmp_path / "mine.so"
    file.write_bytes(b"one")
    before = code_digest(str(file))
    file.write_bytes(b"two")
    assert code_digest(str(file)) != before
