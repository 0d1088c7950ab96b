"""The one place where numba is touched.

`kernel` compiles a pure scalar function; `elementwise` makes a numpy ufunc out of such a kernel, so that scalars
and arrays of any shape are computed by one source. With `NUMBA_DISABLE_JIT=1` both fall back to plain Python
(slow, for coverage and debugging).
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

# Untyped: releases of numba differ in what they type, none of them `vectorize` and the configuration.
_numba: Any = numba

# error_model "numpy": a division by zero gives inf or nan as in numpy, and costs no branch in the hot loop.
_OPTIONS = {"cache": True, "error_model": "numpy"}


def kernel(function: Function) -> Function:
    """Compile a pure function of scalars (or of NamedTuples of scalars and arrays); compiled code is cached on disk."""
    return cast(Function, _numba.njit(**_OPTIONS)(function))


def inlined(function: Function) -> Function:
    """Compile a small kernel that its caller's optimiser should see through."""
    return cast(Function, _numba.njit(inline="always", **_OPTIONS)(function))


def elementwise(function: Callable[..., float]) -> np.ufunc:
    """Return the numpy ufunc of a scalar float function that may call kernels; it broadcasts like numpy's own."""
    if _numba.config.DISABLE_JIT:
        return cast(np.ufunc, np.vectorize(function, otypes=[np.float64]))
    arguments = function.__code__.co_argcount
    signature = f"float64({', '.join(['float64'] * arguments)})"
    return cast(np.ufunc, _numba.vectorize([signature], cache=True)(function))
