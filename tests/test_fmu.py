"""FMUs made of the same C: run as any tool runs them, against the Python; and FMUs as controllers."""

import ctypes
import dataclasses
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from wsp_env.evaluation.controller import load
from wsp_env.evaluation.fmu import Fmu, _Binary, _library, describe
from wsp_env.evaluation.isolated import RefusedError
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.export.fmu import variables, write_fmu
from wsp_env.export.law import evaluate_many, law_unit, random_states
from wsp_env.export.make import make_unit
from wsp_env.export.plant import plant_outputs, plant_unit, random_stop, stop_parameters
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.velim import CONTACT
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.port import Setup

TRAINED = Path(__file__).parents[1] / "agents" / "trained"
COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")


class Running:
    """One instance of an FMU, by its functions."""

    def __init__(self, file: Path, folder: Path) -> None:
        from xml.etree import ElementTree

        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        self.described = describe(ElementTree.parse(folder / "modelDescription.xml").getroot())
        self.code = _Binary(_library(folder, self.described), self.described, folder)
        self.own = self.code.instance("one")

    def numbers(self, causality: str) -> list[int]:
        """Return the value references of a causality, in order."""
        return [one.number for one in self.described.variables.values() if one.causality == causality]


@pytest.mark.parametrize("version", [2, 3])
def test_a_laws_fmu_equals_the_law_and_gives_its_derivatives(version: int, tmp_path: Path) -> None:
    """Bit for bit; derivatives by slip and speed exact, those by other inputs from differences."""
    write_fmu(law_unit(CONTACT.law), tmp_path / "law.fmu", version)
    fmu = Running(tmp_path / "law.fmu", tmp_path / "unpacked")
    fmu.code.initialise(fmu.own)
    inputs, outputs = fmu.numbers("input"), fmu.numbers("output")
    states = random_states(200)
    expected = np.empty((len(states), 6))
    evaluate_many(states, CONTACT.law, expected)
    derive = getattr(fmu.code._code, f"fmi{version}GetDirectionalDerivative")
    for state, row in zip(states, expected, strict=True):
        fmu.code.set(fmu.own, inputs, state.tolist())
        assert np.array_equal(fmu.code.get(fmu.own, outputs), row)
        result, seed, one = ctypes.c_double(), ctypes.c_double(1.0), ctypes.c_size_t(1)
        of, by = ctypes.c_uint(outputs[0]), ctypes.c_uint(inputs[0])
        ends = (ctypes.byref(seed), ctypes.byref(result)) if version == 2 else (
            ctypes.byref(seed), one, ctypes.byref(result), one)  # fmt: skip
        assert derive(fmu.own, ctypes.byref(of), one, ctypes.byref(by), one, *ends) == 0
        assert result.value == (row[3] if state[0] >= 0.0 else -row[3])


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_a_plants_fmu_stops_as_pythons_plant(version: int, tmp_path: Path) -> None:
    """A whole stop to 1e-12, and its second half once more from a saved state."""
    vehicle = VEHICLES["bogie"]
    write_fmu(plant_unit(vehicle), tmp_path / "plant.fmu", version)
    fmu = Running(tmp_path / "plant.fmu", tmp_path / "unpacked")
    stop = dataclasses.replace(random_stop(vehicle, 1, np.random.default_rng(5)), initial_speed=12.0, noise=0.05)
    fmu.code.set(fmu.own, fmu.numbers("parameter"), stop_parameters(stop))
    fmu.code.initialise(fmu.own)
    plant = LongitudinalPlant(vehicle, 1, Setup())
    plant.start(0, stop)
    names = [name for name, *_ in variables(plant_unit(vehicle))]
    assert list(fmu.described.variables)[: len(names)] == names
    state, saved = ctypes.c_void_p(), "FMUstate" if version == 2 else "FMUState"
    inputs, outputs = fmu.numbers("input"), fmu.numbers("output")
    rng = np.random.default_rng(0)
    expected, step, command = [], 0, np.ones(2, dtype=int)
    while plant.moving[0]:
        command = rng.integers(-1, 2, 2) if step % 10 == 0 else command
        fmu.code.set(fmu.own, inputs, [*map(float, command), stop.demand])
        if step == 100:
            fmu.code._do(f"Get{saved}", fmu.own, ctypes.byref(state))
        fmu.code.step(fmu.own, 0.02 * step, 0.02)
        plant.step(command[None, :].astype(float))
        expected.append(plant_outputs(plant)[1:])  # the time is FMI's own
        assert np.allclose(fmu.code.get(fmu.own, outputs), expected[-1], rtol=1e-12, atol=1e-12)
        step += 1
    assert step > 200
    fmu.code._do(f"Set{saved}", fmu.own, state)
    fmu.code.step(fmu.own, 2.0, 0.02)
    assert np.array_equal(fmu.code.get(fmu.own, outputs), expected[100])


@pytest.mark.slow
@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.long), 3])
def test_a_controllers_fmu_brakes_as_the_python_it_was_made_from(version: int, tmp_path: Path) -> None:
    """As a controller of `wsp evaluate`: the same commands and stops."""
    vehicle = VEHICLES["bogie"]
    write_fmu(make_unit("rule-based", vehicle), tmp_path / "rules.fmu", version)
    rng = np.random.default_rng(3)
    stops = [dataclasses.replace(random_stop(vehicle, 1, rng), initial_speed=20.0, mu_cd=0.03) for _ in range(2)]
    own, other = (
        run(load(name), vehicle, stops, Conduct(time_limit_s=15.0)) for name in ("rule-based", str(tmp_path / "rules.fmu"))
    )
    assert np.array_equal(own.command, other.command)
    assert np.array_equal(own.distance, other.distance)


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_a_policy_becomes_an_fmu_too(version: int, tmp_path: Path) -> None:
    """It has no parameters; what it decides first is what the Python decides."""
    pytest.importorskip("onnx")
    unit = make_unit(str(TRAINED / "bogie"), VEHICLES["bogie"])
    write_fmu(unit, tmp_path / "policy.fmu", version)
    fmu = Running(tmp_path / "policy.fmu", tmp_path / "unpacked")
    assert fmu.numbers("parameter") == []
    fmu.code.initialise(fmu.own)
    rows = (row for row in unit.reference(1) if row[0] == "step")
    for step, (_, seen, made) in zip(range(100), rows, strict=False):
        fmu.code.set(fmu.own, fmu.numbers("input"), list(seen[1:]))  # the time is FMI's own
        fmu.code.step(fmu.own, 0.02 * step, 0.02)
        assert np.array_equal(fmu.code.get(fmu.own, fmu.numbers("output")), made, equal_nan=True)


def changed(file: Path, out: Path, *changes: tuple[str, str], without: str = "/none/") -> Path:
    """Copy an FMU with another model description."""
    with zipfile.ZipFile(file) as given, zipfile.ZipFile(out, "w") as made:
        for name in given.namelist():
            content = given.read(name)
            if name == "modelDescription.xml":
                text = content.decode()
                for old, new in changes:
                    assert old in text
                    text = text.replace(old, new)
                content = text.encode()
            if without not in name:
                made.writestr(name, content)
    return out


def test_what_is_wrong_with_an_fmu_is_said(tmp_path: Path) -> None:
    """Version, platform, kind, names, causality, unit, map."""
    good = tmp_path / "good.fmu"
    write_fmu(make_unit("rule-based", VEHICLES["bogie"]), good, 2)
    bogie = {"axles": 2}
    cases = (
        ((('fmiVersion="2.0"', 'fmiVersion="1.0"'),), "", r"of FMI 1.0; versions 2.0 and 3.0"),
        ((("<CoSimulation", "<ModelExchange"), ("</CoSimulation", "</ModelExchange")), "", "model exchange only"),
        ((), "binaries/", r"no binary for this machine \(\w+64\); it has none"),
    )
    for number, (changes, without, said) in enumerate(cases):
        with pytest.raises(RefusedError, match=said):
            Fmu(changed(good, tmp_path / f"{number}.fmu", *changes, without=without or "/none/"))
    of_axle = 'name="wheel_speed[1]"'
    for number, (changes, said) in enumerate(
        (
            (((of_axle, 'name="omega"'),), r"no variable wheel_speed\[1\]; its inputs: omega"),
            ((('unit="rad/s"', 'unit="km"'),), r"unit that does not fit"),
        )
    ):
        fmu = Fmu(changed(good, tmp_path / f"x{number}.fmu", *changes))
        with pytest.raises(RefusedError, match=said):
            fmu.reset(1, bogie)
    (tmp_path / "x0.toml").write_text('[variables]\nwheel_speed = "command[{axle}]"\n')
    with pytest.raises(RefusedError, match=r"has command\[1\] as output, where an input is needed"):
        Fmu(tmp_path / "x0.fmu").reset(1, bogie)
    (tmp_path / "x0.toml").write_text('[variables]\nspeed = "omega"\n')
    with pytest.raises(RefusedError, match=r"map x0.toml with speed in \[variables\]; valid: command, demand"):
        Fmu(tmp_path / "x0.fmu")
    (tmp_path / "x0.toml").write_text('[commands]\nvent = "open"\n')
    with pytest.raises(RefusedError, match=r"map x0.toml with vent = 'open' in \[commands\]: a number is needed"):
        Fmu(tmp_path / "x0.fmu")
    stranger = Fmu(changed(good, tmp_path / "stranger.fmu", ('guid="{', 'guid="{0')))
    with pytest.raises(RefusedError, match=r"could not be instantiated: do its binary and .* belong together \(guid\)"):
        stranger.reset(1, bogie)
    (tmp_path / "text.fmu").write_text("no zip")
    with pytest.raises(ParameterError, match="no FMU"):
        load(str(tmp_path / "text.fmu"))


def test_units_and_codes_of_an_fmu_are_converted(tmp_path: Path) -> None:
    """Wheel speeds in turns per minute and commands of other numbers decide as ours do."""
    unit = make_unit("rule-based", VEHICLES["bogie"])
    write_fmu(unit, tmp_path / "own.fmu", 3)
    changed(tmp_path / "own.fmu", tmp_path / "mine.fmu", ('unit="rad/s"', 'unit="rpm"'))
    (tmp_path / "mine.toml").write_text("[commands]\nvent = 0\nhold = 5\napply = 1\n[parameters]\ncut_out_mps = 2.0\n")
    fmu = Fmu(tmp_path / "mine.fmu")
    fmu.reset(1, {"axles": 2})
    assert np.allclose(fmu._wheel[1], 60.0 / (2.0 * np.pi))
    assert fmu._ours(np.array([[0.0, 5.0, 1.0]])).tolist() == [[-1.0, 0.0, 1.0]]


def test_another_platform_or_version_of_fmi_is_refused(tmp_path: Path) -> None:
    """With what there is."""
    unit = law_unit(CONTACT.law)
    with pytest.raises(ParameterError, match="FMI 4: valid: 2, 3"):
        write_fmu(unit, tmp_path / "law.fmu", 4)
    with pytest.raises(ParameterError, match="unknown platform 'amiga'"):
        write_fmu(unit, tmp_path / "law.fmu", 2, ("amiga",))
