"""The package as strangers get it: what the wheel carries, and that the code in the documents runs."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from wsp_env.cli import main

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    (file,) = folder.glob("*.whl")
    with zipfile.ZipFile(file) as archive:
        yield archive


@pytest.mark.slow
def test_wheel_carries_the_two_packages_and_nothing_else(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"wsp_env", "baselines"}


@pytest.mark.slow
def test_wheel_carries_every_source_and_data_file(wheel):
    for package in ("wsp_env", "baselines"):
        paths = [path for path in (ROOT / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts]
        files = {path.relative_to(ROOT).as_posix() for path in paths}
        assert f"{package}/__init__.py" in files
        assert files <= set(wheel.namelist())
    assert "wsp_env/py.typed" in wheel.namelist()


@pytest.mark.slow
def test_wheel_has_the_command_and_the_licence(wheel):
    (entry_points,) = (name for name in wheel.namelist() if name.endswith(".dist-info/entry_points.txt"))
    assert "wsp = wsp_env.cli:main" in wheel.read(entry_points).decode()
    assert any(name.endswith("licenses/LICENSE") for name in wheel.namelist())


@pytest.mark.slow
@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_code_in_the_documents_runs(document, tmp_path, monkeypatch):
    (tmp_path / "agents").symlink_to(ROOT / "agents")  # read from the repository's root, written beside it
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    exec(compile("\n".join(blocks), str(document), "exec"), {"__name__": "__main__"})


def test_links_between_documents_lead_somewhere():
    for document in [*DOCUMENTS, *sorted((ROOT / "docs/lab").glob("*.md")), ROOT / "CONTRIBUTING.md"]:
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text(encoding="utf-8")):
            assert (document.parent / link).exists(), f"{document.name}: {link}"


def test_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    assert main(["demo"]) != 0
    assert "wsp-env[report]" in capsys.readouterr().err
