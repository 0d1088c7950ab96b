"""The shape of the house: no circle among modules, no module without a purpose, controllers without training code."""

import ast
import importlib.util
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from wsp_env.cli import COMMANDS
from wsp_env.recordings.readers import FORMATS

ROOT = Path(__file__).parents[1]
PACKAGES = ("wsp_env", "baselines", "agents", "experiments")

#: What is imported by a computed name: module -> modules.
BY_NAME = {
    "wsp_env.cli": {f"wsp_env.cli.{command.replace('-', '_')}" for command in COMMANDS},
    "wsp_env.recordings.readers": {f"wsp_env.recordings.readers.{reader}" for reader in FORMATS.values()},
}


def module_name(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(file): file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))}


def imports(name: str, tree: ast.AST) -> set[str]:
    """The modules of this house that a source imports, at its top or inside a function, for types only or not."""
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            source = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            # A submodule is one of its own; whatever else is named comes from the module itself.
            found |= {f"{source}.{alias.name}" if f"{source}.{alias.name}" in FILES else source for alias in node.names}
    return found & set(FILES)


@pytest.fixture(scope="module")
def graph() -> dict[str, set[str]]:
    parsed = {name: ast.parse(file.read_text(encoding="utf-8")) for name, file in FILES.items()}
    return {name: imports(name, tree) | BY_NAME.get(name, set()) for name, tree in parsed.items()}


def test_the_graph_sees_imports_of_every_kind(graph):
    assert "wsp_env.contact.degraded" in graph["wsp_env.recordings.tuning"]  # from module import name
    assert "wsp_env.recordings.bootstrap" in graph["wsp_env.recordings.tuning"]  # from package import module
    assert "wsp_env.recordings.validation_report" in graph["wsp_env.cli.tune"]  # inside a function
    assert "wsp_env.recordings.readers.csv_text" in graph["wsp_env.recordings.readers"]  # by a computed name
    assert sum(map(len, graph.values())) > 500


def test_modules_import_each_other_in_no_circle(graph):
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))


def test_what_is_imported_by_name_exists():
    assert set().union(*BY_NAME.values()) <= set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_the_first_line_says_what_a_module_is_for(name):
    docstring = ast.get_docstring(ast.parse(FILES[name].read_text(encoding="utf-8"))) or ""
    purpose = docstring.partition("\n")[0]
    assert len(purpose.split()) >= 3
    assert purpose[-1] in ".:;?"


def test_every_folder_of_modules_is_a_package():
    folders = {file.parent for file in FILES.values()}
    assert all((folder / "__init__.py").exists() for folder in folders)
