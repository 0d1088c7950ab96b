"""Compiled functions, kept in this package's `__pycache__` and made anew after any change of its sources."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

# numba has no type stubs, and its releases differ in what they type.
_numba: Any = numba


def _cache_folder() -> str:
    """Folder of the compiled code; numba by itself does not see that what a function calls in another file has changed."""
    package = Path(__file__).parent
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sorted(package.glob("*.py"))))
    return str(package / "__pycache__" / f"kernels-{digest.hexdigest()[:16]}")


_CACHE_FOLDER = _cache_folder()


def kernel(function: Function, **options: Any) -> Function:
    """Compile a function; NUMBA_CACHE_DIR goes before this package's own folder."""
    before = _numba.config.CACHE_DIR
    _numba.config.CACHE_DIR = before or _CACHE_FOLDER
    try:
        return cast(Function, _numba.njit(cache=True, **options)(function))
    finally:
        _numba.config.CACHE_DIR = before


def loop(function: Function) -> Function:
    """Compile a function that works on the arrays it is given and makes none: references to them are not counted."""
    return kernel(function, _nrt=False)


def part(function: Function) -> Function:
    """Compile into the caller, which may be a loop."""
    return cast(Function, _numba.njit(inline="always")(function))
