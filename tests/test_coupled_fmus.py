"""A plant and its controller as two coupled FMUs: the same stop as in Python; FMPy's validation, where it is installed."""

import shutil
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.coupled_fmus import TOLERANCE, Coupled, couple, in_python, names, worst_difference
from wsp_env.evaluation.fmu import _Binary, _library, describe
from wsp_env.export.fmu import write_fmu
from wsp_env.export.make import make_unit
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.port import Stop

COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")


class Ours:
    """An FMU by the functions that `wsp evaluate` calls."""

    def __init__(self, file: Path, folder: Path) -> None:
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        described = describe(ElementTree.parse(folder / "modelDescription.xml").getroot())
        self._code = _Binary(_library(folder, described), described, folder)
        self._own = self._code.instance("one")
        self._numbers = {name: one.number for name, one in described.variables.items()}

    def set(self, values: Mapping[str, float]) -> None:
        self._code.set(self._own, [self._numbers[name] for name in values], list(values.values()))

    def initialise(self) -> None:
        self._code.initialise(self._own)

    def get(self, wanted: Sequence[str]) -> list[float]:
        return self._code.get(self._own, [self._numbers[name] for name in wanted]).tolist()

    def step(self, time: float, length: float) -> None:
        self._code.step(self._own, time, length)


@pytest.fixture(scope="module")
def coach(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A coach of FMI 2.0 and its rules of FMI 3.0."""
    folder = tmp_path_factory.mktemp("fmus")
    write_fmu(make_unit("plant", VEHICLES["coach"]), folder / "coach.fmu", 2)
    write_fmu(make_unit("rule-based", VEHICLES["coach"]), folder / "rules.fmu", 3)
    return folder / "coach.fmu", folder / "rules.fmu"


@pytest.mark.slow
def test_a_plant_and_its_wsp_as_two_fmus_stop_as_in_python(coach: tuple[Path, Path], tmp_path: Path) -> None:
    """On rail that slides all wheels and is cleaned by it, until standstill."""
    vehicle, one = VEHICLES["coach"], np.ones(1)
    parameters = {"mu_cd": 0.03, "tau": 2e-4, "initial_speed": 20.0, "mass": vehicle.mass_kg + 5e3, "gradient": -0.005}
    rest = {"demand": 1.0, "noise": 0.0, "key": 0, "profile": one, "coverage": one}
    stop = Stop(**parameters, **rest, radius=np.full(4, vehicle.wheel_radius_m))  # type: ignore[arg-type]  # fields by name
    plant, wsp = (Ours(file, tmp_path / file.stem) for file in coach)
    made, own = couple(plant, wsp, parameters, 1.0, 4, 0.02), in_python(vehicle, stop, "rule-based", 0.02)
    speed, wheels = own[:, names(4).index("speed")], own[:, [names(4).index(f"wheel_speed[{k}]") for k in (1, 2, 3, 4)]]
    slip = speed[:, None] - vehicle.wheel_radius_m * wheels
    assert slip.max() > 1.0  # m/s: the protection has to act
    assert worst_difference(made, own) <= TOLERANCE


@pytest.mark.slow
def test_fmpy_couples_them_alike(coach: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """As the page on exporting says."""
    pytest.importorskip("fmpy")
    assert Coupled(*coach, initial_speed=15.0).run() <= TOLERANCE
    assert "FMUs in FMPy" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize("what", ["law", "plant", "rule-based"])
def test_fmpy_finds_nothing_to_mend(what: str, version: int, tmp_path: Path) -> None:
    """Its validation of the description and the binary."""
    validation = pytest.importorskip("fmpy.validation")
    write_fmu(make_unit(what, VEHICLES["bogie"]), tmp_path / "one.fmu", version)
    assert validation.validate_fmu(str(tmp_path / "one.fmu")) == []
