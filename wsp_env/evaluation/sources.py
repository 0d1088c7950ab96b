"""Which code a result was computed with: a hash that changes when the results may."""

import ast
import functools
import hashlib
import importlib.util
import sys
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from wsp_env.evaluation.controller import SHORT_NAMES
from wsp_env.evaluation.native import is_native

#: Folders of installed packages: not taken for what lies beside a controller.
_INSTALLED = ("site-packages", "dist-packages")


def code_digest(controller: str | None) -> str:
    """Return a hash of this package's sources, of the versions it runs on and, if any, of the controller's sources.

    These are a policy's whole folder; a file and what it imports, at any depth, from its own folder; the folder of a module in
    a package. Not tracked: other installed packages, what is imported under a name computed at run time, files that are read.
    """
    place = SHORT_NAMES.get(controller or "", controller or "").partition(":")[0]
    return _digest(_package_digest(), own_files(place) or (_module_files(place) if place else ()))


def own_files(place: str) -> set[Path]:
    """Return what a controller that is named by its file or folder is made of, absolute; nothing for any other."""
    path = Path(place).resolve()
    if is_native(place) and path.is_file():
        beside = path.with_suffix(".toml")  # the map of an FMU's variables
        return {path, *([beside] if beside.is_file() else [])}
    if path.suffix == ".py" and path.is_file():
        return imported_beside(path)
    if place and path.is_dir():
        return {file for file in path.rglob("*") if file.is_file()}
    return set()


def imported_beside(file: Path) -> set[Path]:
    """Return the file and the sources in its folder that it imports, these import, and so on; a package is taken whole."""
    folder = file.resolve().parent
    found: set[Path] = set()
    waiting = [file.resolve()]
    while waiting:
        source = waiting.pop()
        if source in found:
            continue
        found.add(source)
        for name in _imports(source):
            module, package = folder / f"{name}.py", folder / name
            waiting += [module] if module.is_file() else package.rglob("*.py")
    return found


def _imports(source: Path) -> set[str]:
    """Return the top-level names of what a source imports; none if it cannot be parsed, which loading it will tell."""
    try:
        tree = ast.parse(source.read_bytes())
    except (SyntaxError, ValueError):
        return set()
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    return {name.partition(".")[0] for name in names}


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


def _module_files(module: str) -> set[Path]:
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return set()
    origin = Path(found.origin)
    if "." in module:
        return set(origin.parent.rglob("*.py"))
    return {origin} if set(_INSTALLED) & set(origin.parts) else imported_beside(origin)
