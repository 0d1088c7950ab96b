"""What all machines that compute one result must have alike."""

import functools
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

#: Packages whose arithmetic goes into results.
_PACKAGES = ("numpy", "scipy", "numba")


@functools.cache  # what this process runs is what it has imported, whatever happens to the files meanwhile
def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that compute, and a hash of this package's sources."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for file in sorted(file for kind in ("*.py", "*.toml") for file in package.rglob(kind)):
        digest.update(file.relative_to(package).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    packages = {name: version(name) for name in _PACKAGES}
    return {"Python": platform.python_version()} | packages | {"wsp-env": f"sources {digest.hexdigest()[:12]}"}


def difference(expected: dict[str, str], found: dict[str, str]) -> str:
    """Say what differs; nothing where all is alike."""
    return ", ".join(f"{name} {found.get(name)} and not {one}" for name, one in expected.items() if found.get(name) != one)
