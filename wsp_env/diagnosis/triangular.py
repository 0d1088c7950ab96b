"""Cholesky factors and triangular systems by LAPACK and BLAS, called without Python's lock.

`scipy.linalg` keeps the lock while it calls the same routines, so that threads which evaluate candidates wait for each other.
Row-major arrays need no copy: to LAPACK, which is column-major, a lower triangle is the upper one of the transpose.
"""

import ctypes
from typing import Any

import numpy as np
from numba.extending import get_cython_function_address


def _routine(module: str, name: str, arguments: int) -> Any:
    """Return a routine of `scipy.linalg`; all arguments are pointers."""
    address = get_cython_function_address(f"scipy.linalg.{module}", name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


_POTRF, _POTRI = _routine("cython_lapack", "dpotrf", 5), _routine("cython_lapack", "dpotri", 5)
_TRSM = _routine("cython_blas", "dtrsm", 11)
_ONE = ctypes.c_double(1.0)


def cholesky(matrix: np.ndarray) -> np.ndarray:
    """Return the lower Cholesky factor (n, n) of a symmetric matrix.

    Raises
    ------
    numpy.linalg.LinAlgError : if the matrix is not positive definite

    """
    factor = np.tril(matrix)
    _called(_POTRF, factor)
    return factor


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Return the inverse (n, n) of a matrix from its lower Cholesky factor, in a third of the work of solving for it."""
    half = np.tril(factor)
    _called(_POTRI, half)
    result: np.ndarray = half + np.tril(half, -1).T
    return result


def solved(factor: np.ndarray, y: np.ndarray, transposed: bool = False) -> np.ndarray:
    """Return L^-1 Y, or L^-T Y, for a lower triangular L (n, n) and Y (n,) or (n, k)."""
    result, root = np.array(y, dtype=float, order="C"), np.ascontiguousarray(factor, dtype=float)
    columns = result.size // max(len(result), 1)
    if columns and len(factor):
        lines, width = ctypes.c_int(columns), ctypes.c_int(len(factor))
        _TRSM(
            b"R", b"U", b"T" if transposed else b"N", b"N", ctypes.byref(lines), ctypes.byref(width), ctypes.byref(_ONE),
            root.ctypes.data, ctypes.byref(width), result.ctypes.data, ctypes.byref(lines),
        )  # fmt: skip
    return result


def _called(routine: Any, triangle: np.ndarray) -> None:
    """Call a routine that overwrites a lower triangle (n, n)."""
    if not len(triangle):
        return
    width, failed = ctypes.c_int(len(triangle)), ctypes.c_int(0)
    routine(b"U", ctypes.byref(width), triangle.ctypes.data, ctypes.byref(width), ctypes.byref(failed))
    if failed.value:
        raise np.linalg.LinAlgError(f"the matrix is not positive definite (leading minor {failed.value})")
