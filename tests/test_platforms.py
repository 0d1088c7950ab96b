"""FMUs for other platforms, by ziglang; without it these tests are skipped, `make platforms` installs it."""

import zipfile
from pathlib import Path

import pytest

from experiments.other_platforms import measure, with_rows
from wsp_env.export.fmu import PLATFORMS, here, write_fmu
from wsp_env.export.law import law_unit
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.velim import CONTACT

#: How a library of each platform begins, where it names its processor, and how: ELF (e_machine), PE, Mach-O (cputype).
BEGINS = {
    "linux64": (b"\x7fELF", 18, 62),
    "linux-aarch64": (b"\x7fELF", 18, 183),
    "win64": (b"MZ", None, 0),
    "darwin64": (b"\xcf\xfa\xed\xfe", 4, 7),
    "darwin-aarch64": (b"\xcf\xfa\xed\xfe", 4, 12),
}


@pytest.mark.slow
def test_an_fmu_holds_a_binary_of_every_platform(tmp_path: Path) -> None:
    """Each of the kind that its loader asks for."""
    pytest.importorskip("ziglang")
    built = write_fmu(law_unit(CONTACT.law), tmp_path / "law.fmu", 3, tuple(PLATFORMS))
    assert set(built) == {names[1] for names in PLATFORMS.values()}
    with zipfile.ZipFile(tmp_path / "law.fmu") as archive:
        for name, (magic, at, processor) in BEGINS.items():
            content = archive.read(f"binaries/{PLATFORMS[name][1]}/wsp_law{PLATFORMS[name][3]}")
            assert content.startswith(magic)
            if at is not None:
                assert content[at] == processor


@pytest.mark.slow
def test_c_and_fmu_give_what_the_python_gives_by_the_cross_compiler_too(tmp_path: Path) -> None:
    """On this machine, whose programs need no emulator."""
    pytest.importorskip("ziglang")
    if here() not in PLATFORMS:
        pytest.skip(f"no target of ziglang for {here()}")
    unit = law_unit(CONTACT.law)
    rows = list(unit.reference(1))
    assert measure(here(), with_rows(unit, rows), tmp_path, []) == ("500 steps, 0", "500 steps, 0")


def test_without_the_cross_compiler_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With how to install it."""
    monkeypatch.setattr("wsp_env.export.fmu.find_spec", lambda name: None)
    other = next(name for name in PLATFORMS if name != here())
    with pytest.raises(ParameterError, match=rf"{other} needs a cross-compiler: pip install ziglang"):
        write_fmu(law_unit(CONTACT.law), tmp_path / "law.fmu", 3, (other,))
