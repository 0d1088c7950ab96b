"""The package as strangers get it: what the wheel carries, and that the code in the documents runs."""

import functools
import importlib
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import tyro

from wsp_env.cli import COMMANDS, main

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
#: Whose code other tests run: test_tutorial.py among its commands, test_diagnosis.py, test_creep_curves.py.
RUN_ELSEWHERE = ("tutorial.md", "diagnosis.md", "creep_curves.md")
LONG = ("multibody.md", "drive_it.md", "contact_geometry.md")


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
def test_wheel_carries_the_two_packages_and_the_command_and_nothing_else(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"wsp_env", "baselines", "wsp_command.py"}


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
    assert "wsp = wsp_command:main" in wheel.read(entry_points).decode()
    assert any(name.endswith("licenses/LICENSE") for name in wheel.namelist())


def test_ctrl_c_while_the_libraries_are_being_loaded_is_one_line(tmp_path):
    slow = tmp_path / "wsp_env"  # in place of the package: interrupted in the middle of a class, as a library may be
    slow.mkdir()
    interrupted = "import os, signal, time\nclass Half:\n    os.kill(os.getpid(), signal.SIGINT)\n    time.sleep(30)\n"
    (slow / "__init__.py").write_text(interrupted)
    code = "import sys, wsp_command; sys.exit(wsp_command.main())"
    paths = {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, env={**os.environ, **paths})
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "wsp: interrupted\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    "document",
    [
        pytest.param(one, marks=[pytest.mark.long] * (one.name in LONG), id=one.name)
        for one in DOCUMENTS
        if one.name not in RUN_ELSEWHERE
    ],
)
def test_code_in_the_documents_runs(document, tmp_path, monkeypatch):
    (tmp_path / "agents").symlink_to(ROOT / "agents")  # read from the repository's root, written beside it
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    exec(compile("\n".join(blocks), str(document), "exec"), {"__name__": "__main__"})


def test_links_between_documents_lead_somewhere():
    for document in [*DOCUMENTS, *sorted((ROOT / "docs/lab").glob("*.md")), ROOT / "CONTRIBUTING.md"]:
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text(encoding="utf-8")):
            assert (document.parent / link).exists(), f"{document.name}: {link}"


def blocks(*languages):
    """Every block of code of the documents in some languages, as (document, text)."""
    for document in [*DOCUMENTS, *sorted((ROOT / "docs/lab").glob("*.md")), ROOT / "CONTRIBUTING.md"]:
        found = re.findall(r"^```(\w*)\n(.*?)^```", document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
        yield from ((document.name, text) for language, text in found if language in languages)


def commands():
    """Every command of the documents, as (document, words): what follows a pipe or goes into a file is left out."""
    for name, text in blocks("console", "sh", ""):
        lines = text.replace("\\\n", " ").splitlines()
        for line in [one for one in lines if one.startswith("$ ")] or lines:  # the others are what a command prints
            for part in re.split(r"&&|\|", line.strip().removeprefix("$ ")):
                words = shlex.split(part.partition(">")[0], comments=True)
                while words and "=" in words[0]:  # a variable of the environment
                    words = words[1:]
                if words:
                    yield name, words


def test_every_command_in_the_documents_exists(monkeypatch):
    told = set()
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for name, words in commands():
        where = f"{name}: {' '.join(words)}"
        if words[0] == "wsp" and words[1] not in ("--help", "COMMAND"):
            module = importlib.import_module(f"wsp_env.cli.{words[1].replace('-', '_')}")
            tyro.cli(parsed(module.main), prog="wsp", args=words[2:], console_outputs=False)  # exits where it does not fit
            told.add(words[1])
        elif words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= set(targets), where
        elif words[0] == "python":
            file = ROOT / (words[1] if words[1] != "-m" else words[2].replace(".", "/"))
            assert any(one.exists() for one in (file, file.with_suffix(".py"), file / "__main__.py")) or words[2] == "build", (
                where
            )
    assert told == set(COMMANDS), "every command of wsp is shown somewhere"


def parsed(function):
    """The same arguments, and nothing done."""

    @functools.wraps(function)
    def nothing(*arguments, **options):
        return None

    return nothing


def test_every_toml_and_json_in_the_documents_is_valid():
    for _, text in blocks("toml"):
        tomllib.loads(text)
    for _, text in blocks("json"):
        json.loads(text)


def test_no_page_is_too_long():
    for document in DOCUMENTS:
        assert len(document.read_text(encoding="utf-8").splitlines()) <= 200, document.name


def test_every_block_that_is_run_shows_what_it_prints():
    """`make docs` compares the words; here nothing is run."""
    marked = r"^<!-- run(?: \d+)? -->\n```(console|python)\n(.*?)^```(?:\n\n?```text\n(.*?)^```)?"
    found = 0
    for document in DOCUMENTS:
        for language, block, text in re.findall(marked, document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
            printed = text if language == "python" else "".join(one for one in block.splitlines() if not one.startswith("$ "))
            assert printed.strip(), f"{document.name}: {block[:60]}"
            found += 1
    assert found > 10


def test_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    assert main(["demo"]) != 0
    assert "wsp-env[report]" in capsys.readouterr().err
