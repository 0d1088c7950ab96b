"""C made of the compiled Python computes the same bits; where there is no C compiler these tests are skipped."""

import ctypes
import dataclasses
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wsp_env.contact.port import LAWS
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.export.files import FLAGS, write_unit
from wsp_env.export.fmu import write_fmu
from wsp_env.export.kinds import UntranslatableError
from wsp_env.export.law import evaluate_many, law_unit, random_states
from wsp_env.export.make import make_unit, write_c
from wsp_env.export.plant import PlantOptions, plant_unit, random_stop
from wsp_env.export.single import in_floats, single
from wsp_env.export.translator import Translator
from wsp_env.export.unit import Unit
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.velim import CONTACT

COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")

TRAINED = Path(__file__).parents[1] / "agents" / "trained"


def compiled(folder: Path, out: str, *files: str, flags: tuple[str, ...] = ()) -> Path:
    """Build files of a folder."""
    done = subprocess.run(
        [str(COMPILER), *FLAGS, *flags, "-o", out, *files, "-lm"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / out


def check_vectors(unit: Unit, folder: Path, *more: str) -> None:
    """Build a unit without a warning and with sanitizers, and let its runner compare it with the Python."""
    write_unit(unit, folder)
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", *more)
    runner = compiled(folder, "runner", f"{unit.name}.c", "runner.c", flags=flags)
    done = subprocess.run([runner, folder / "vectors.txt"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", LAWS)
def test_a_law_in_c_equals_the_plants(name: str, tmp_path: Path) -> None:
    """Bit for bit, at rest, without slip and beyond the range of use too."""
    check_vectors(law_unit(LAWS[name].make(CONTACT)), tmp_path)


def test_a_law_in_c_equals_the_plants_at_many_states(tmp_path: Path) -> None:
    """Also with another shape of the recovery, which is solved by iteration."""
    laws = [CONTACT.law, CONTACT.law._replace(recovery_exponent=0.7), CONTACT.law._replace(recovery_exponent=1.6)]
    write_unit(law_unit(laws[0]), tmp_path)
    many = """#include "wsp_law.h"
void many(const double *p, const double *u, double *y, long n);
void many(const double *p, const double *u, double *y, long n)
{
    wsp_law self;
    long i;
    wsp_law_start(&self, (const wsp_law_parameters *)p);
    for (i = 0; i < n; i++) {
        wsp_law_step(&self, (const wsp_law_input *)(u + 8 * i), (wsp_law_output *)(y + 6 * i));
    }
}
"""
    (tmp_path / "many.c").write_text(many)
    library = ctypes.CDLL(str(compiled(tmp_path, "many.so", "wsp_law.c", "many.c", flags=("-shared", "-fPIC"))))
    for seed, law in enumerate(laws):
        states = random_states(100_000 if law is laws[0] else 10_000, seed)
        found, expected = np.empty((len(states), 6)), np.empty((len(states), 6))
        given = np.array(law)
        addresses = (ctypes.c_void_p(array.ctypes.data) for array in (given, states, found))
        library.many(*addresses, ctypes.c_long(len(states)))
        evaluate_many(states, law, expected)
        assert np.array_equal(found, expected, equal_nan=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "options", "mechanisms"),
    [
        ("coach", PlantOptions(), ()),
        ("wheelset", PlantOptions(track_nodes=20, control_interval_s=0.1), ()),
        ("bogie", PlantOptions(pressure_control=True), ("load_transfer", "pad_friction", "leading_axle_cleaning")),
    ],
)
def test_the_plant_in_c_equals_pythons(
    vehicle: str, options: PlantOptions, mechanisms: tuple[str, ...], tmp_path: Path
) -> None:
    """Bit for bit: brake, contact, wheels, sensors with noise, mechanisms that remember."""
    check_vectors(plant_unit(VEHICLES[vehicle], options, {name: {} for name in mechanisms}), tmp_path)


def test_a_mechanism_on_what_is_a_parameter_in_c_is_refused() -> None:
    """The C takes the mass itself."""
    with pytest.raises(ParameterError, match=r"vehicle_mass acts on mass.*parameter"):
        plant_unit(VEHICLES["bogie"], None, {"vehicle_mass": {}})


@pytest.mark.parametrize("name", ["rule-based", pytest.param("slip", marks=pytest.mark.long)])
def test_a_controller_by_rules_in_c_decides_as_pythons(name: str, tmp_path: Path) -> None:
    """With sensors that fail, wheels of other diameters, changed thresholds and a long slide."""
    unit = make_unit(name, VEHICLES["coach"])
    if name == "rule-based":
        assert {"slip_base_mps", "cut_out_mps", "long_slide"} <= {variable.name for variable in unit.parameters}
    check_vectors(unit, tmp_path)


@pytest.mark.slow
def test_the_adaptive_controller_in_c_decides_as_pythons(tmp_path: Path) -> None:
    """Bit for bit with its guard and observer: sensors that fail, changed prices and gains."""
    unit = make_unit("adaptive", VEHICLES["bogie"])
    assert unit.tolerance == 0.0
    assert {"slide_price", "safety_timer_s"} <= {variable.name for variable in unit.parameters}
    check_vectors(unit, tmp_path)


@pytest.mark.slow
def test_a_policy_in_c_decides_as_pythons(tmp_path: Path) -> None:
    """Guard and observer bit for bit, commands equal; only sums of floats in the network have another order."""
    pytest.importorskip("onnx")
    unit = make_unit(str(TRAINED / "bogie"), VEHICLES["bogie"])
    given = [made for what, _, made in unit.reference(1) if what == "step"]
    failed = [name for variable in unit.outputs for name, _ in variable.elements()].index("failed[0]")
    assert any(row[failed] for row in given)  # the guard has something to do
    check_vectors(unit, tmp_path)


@pytest.mark.parametrize(
    "what", ["slip", *(pytest.param(what, marks=pytest.mark.long) for what in ("law", "plant", "adaptive"))]
)
def test_in_single_precision_it_stays_within_the_tolerance_and_nothing_becomes_a_double(what: str, tmp_path: Path) -> None:
    """As the compiler sees it, which is told to warn of every promotion and every loss."""
    unit = single(make_unit(what, VEHICLES["bogie"]))
    check_vectors(unit, tmp_path, "-Wdouble-promotion", "-Wfloat-conversion")
    text = (tmp_path / f"{unit.name}.c").read_text() + (tmp_path / f"{unit.name}.h").read_text()
    assert "double" not in re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    with pytest.raises(ParameterError, match="an FMU has doubles"):
        write_fmu(unit, tmp_path / "one.fmu")


def test_a_law_whose_slopes_are_differences_has_no_single_precision() -> None:
    """Floats would round them away."""
    with pytest.raises(ParameterError, match=r"FASTSIM.* has no single precision: its slopes are differences"):
        single(law_unit(LAWS["fastsim"].make(CONTACT)))


def test_floats_leave_comments_and_whole_numbers_alone() -> None:
    """And literals that are floats already."""
    given = "/* 1.0 double */ double x = exp(2.0) + 1e-9 + (double)UINT64_C(3) * 0x1F + t[2] / 5.0f + fabs(y2.v1); DBL_MAX"
    made = "/* 1.0 double */ float x = expf(2.0f) + 1e-9f + (float)UINT64_C(3) * 0x1F + t[2] / 5.0f + fabsf(y2.v1); FLT_MAX"
    assert in_floats(given) == made


@pytest.mark.slow
def test_an_exported_controller_brakes_as_the_python_it_was_made_from(tmp_path: Path) -> None:
    """The library of the exported C as a controller: the same stops."""
    vehicle = VEHICLES["bogie"]
    unit = make_unit("rule-based", vehicle)
    write_c(unit, tmp_path)
    library = compiled(tmp_path, "rules.so", "controller.c", f"{unit.name}.c", flags=("-shared", "-fPIC"))
    rng = np.random.default_rng(3)
    stops = [dataclasses.replace(random_stop(vehicle, 1, rng), initial_speed=20.0, mu_cd=0.03) for _ in range(3)]
    own, other = (run(load(name), vehicle, stops, Conduct(time_limit_s=20.0)) for name in ("rule-based", str(library)))
    assert np.array_equal(own.command, other.command)
    assert np.array_equal(own.distance, other.distance)


def test_what_has_no_c_is_said() -> None:
    """The translator names what it does not know."""

    def strange(x: float) -> Iterator[float]:
        yield x

    def lists(x: float) -> Any:
        return [x]

    from wsp_env.export.kinds import REAL, variable

    for function, what in ((strange, "Yield"), (lists, "\\[x\\]")):
        with pytest.raises(UntranslatableError, match=rf"{function.__name__}: .*({what}|yield)"):
            Translator("wsp_x").call(function, [variable(REAL, "x")], None)
    with pytest.raises(ParameterError, match=r"unknown law 'mine'; valid: degraded"):
        make_unit("law", VEHICLES["bogie"], law="mine")
