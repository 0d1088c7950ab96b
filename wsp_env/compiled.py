"""The one place where numba is touched.

`kernel`, `inlined` and `loop` compile functions of scalars and arrays. `elementwise` makes a numpy ufunc of one, so that
scalars and arrays of any shape are computed by one source. `generated` compiles source that is made from data. `by_type`
chooses a kernel by the type of a record. `rebuilder` makes records from plain tuples. `with_math` compiles a kernel once more
with other elementary functions. `cuda_kernel` compiles one for a GPU. With `NUMBA_DISABLE_JIT=1` all but the last fall back to
plain Python (slow, for coverage and debugging).
"""

import copy
import hashlib
import linecache
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import codegen, inline_closurecall

Function = TypeVar("Function", bound=Callable[..., Any])

# Untyped: releases of numba differ in what they type, none of them `vectorize` and the configuration.
_numba: Any = numba

# error_model "numpy": a division by zero gives inf or nan as in numpy, and costs no branch in the hot loop.
# nogil: kernels touch no Python object, threads may run them side by side.
_OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True}


class _CopyOfBlocks:
    """Stands for the module `copy` in numba's inliner, which uses its `deepcopy` for the blocks of a kernel that it inlines.

    With each block numba 0.68 copies the table of all names of the kernel, twice, and only reads it: half of the time that
    compiling the plant took. Here the blocks of a kernel share that table.
    """

    @staticmethod
    def deepcopy(block: Any) -> Any:
        return copy.deepcopy(block, {id(block.scope): block.scope})


if getattr(inline_closurecall, "copy", None) is copy:
    vars(inline_closurecall)["copy"] = _CopyOfBlocks


def _as_one_module(library: Any, module: Any) -> None:
    """Stand for numba's optimisation of each function of a module, and leave the functions of this package as they are.

    Their kernels are one function each, which sees through what it calls, and the whole module is optimised afterwards. Before
    it, the same passes over that function took a third of the time that compiling the plant took, and gained nothing.
    """
    if any("wsp_env" in function.name for function in module.functions if not function.is_declaration):
        module.data_layout = library._codegen._data_layout
    else:
        _each_function(library, module)


_each_function: Any = getattr(codegen.CPUCodeLibrary, "_optimize_functions", None)
if _each_function is not None:
    setattr(codegen.CPUCodeLibrary, "_optimize_functions", _as_one_module)  # noqa: B010  # mypy refuses to assign a method

#: Folders that hold kernels, or what kernels are made of.
_KERNELS = ("contact", "observer", "parameters", "plant")


def third_party_mechanisms() -> list[str]:
    """Return the modules of mechanisms that other packages bring along: entry points of group "wsp_env.mechanisms".

    An entry point is `name = "package.module"`; what may stand behind a colon does not matter, the card is the module's `CARD`.
    """
    return sorted({point.module for point in entry_points(group="wsp_env.mechanisms")})


def _files(modules: Iterable[str]) -> Iterator[Path]:
    for module in modules:
        try:
            spec = find_spec(module)
        except ImportError:  # said with more words when the mechanisms are loaded
            continue
        if spec is not None and spec.origin:
            yield Path(spec.origin)


def _cache_folder() -> str:
    """Folder of the compiled code, another for every state of the sources.

    numba looks at the time stamp of a kernel's own file only, and would keep code compiled from what the kernel calls in
    other files before these changed.
    """
    package = Path(__file__).parent
    digest = hashlib.sha256()
    own = [source for folder in _KERNELS for source in sorted(package.glob(f"{folder}/**/*.py"))]
    for source in [Path(__file__), *own, *_files(third_party_mechanisms())]:
        digest.update(source.read_bytes())
    beside = package / "__pycache__"
    parent = beside if os.access(beside if beside.exists() else package, os.W_OK) else Path.home() / ".cache" / "wsp-env"
    return str(parent / f"kernels-{digest.hexdigest()[:16]}")


@contextmanager
def _own_cache() -> Iterator[None]:
    """While functions are decorated, numba caches them in this package's own folder; NUMBA_CACHE_DIR goes before it."""
    before = _numba.config.CACHE_DIR
    _numba.config.CACHE_DIR = before or _CACHE_FOLDER
    try:
        yield
    finally:
        _numba.config.CACHE_DIR = before


_CACHE_FOLDER = _cache_folder()


def kernel(function: Function) -> Function:
    """Compile a pure function of scalars (or of NamedTuples of scalars and arrays); compiled code is cached on disk."""
    with _own_cache():
        return cast(Function, _numba.njit(**_OPTIONS)(function))


def inlined(function: Function) -> Function:
    """Compile a small kernel that its caller's optimiser should see through."""
    with _own_cache():
        return cast(Function, _numba.njit(inline="always", **_OPTIONS)(function))


def loop(function: Function) -> Function:
    """Compile a kernel that works on the arrays it is given and makes none.

    numba then counts no references to arrays, which cost a step of the plant three times its arithmetic.
    """
    with _own_cache():
        return cast(Function, _numba.njit(_nrt=False, **_OPTIONS)(function))


def elementwise(function: Callable[..., float]) -> np.ufunc:
    """Return the numpy ufunc of a scalar float function that may call kernels; it broadcasts like numpy's own."""
    if _numba.config.DISABLE_JIT:
        return cast(np.ufunc, np.vectorize(function, otypes=[np.float64]))
    arguments = function.__code__.co_argcount
    signature = f"float64({', '.join(['float64'] * arguments)})"
    with _own_cache():
        return cast(np.ufunc, _numba.vectorize([signature], cache=True)(function))


def generated(name: str, source: str, names: Mapping[str, Any]) -> Callable[..., Any]:
    """Compile Python source that defines the function `name` from other kernels, given in `names`; seen through like `inlined`.

    It has no cache of its own: it lives inside the kernels that call it.
    """
    file = f"<generated {name} {hashlib.sha256(source.encode()).hexdigest()[:8]}>"  # others may bear that name too
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)  # for tracebacks
    namespace = dict(names)
    exec(compile(source, file, "exec"), namespace)
    return cast(Callable[..., Any], _numba.njit(inline="always", error_model="numpy", nogil=True)(namespace[name]))


def with_math(function: Function, math: ModuleType) -> Function:
    """Compile a kernel once more, with another module as `math` in it and in the kernels that it calls by global names.

    The second bears another name, by which numba's cache tells the two apart. The caller's optimiser sees through it.
    """
    first: Any = getattr(function, "py_func", function)
    known = first.__globals__
    named = {name: known[name] for name in first.__code__.co_names if name in known}
    called = {name: with_math(k, math) for name, k in named.items() if isinstance(getattr(k, "py_func", k), FunctionType)}
    names = {**known, **called, "math": math}
    second = FunctionType(first.__code__, names, first.__name__, first.__defaults__, first.__closure__)
    second.__qualname__ = f"{first.__qualname__}_with_{math.__name__}"
    with _own_cache():
        return cast(Function, _numba.njit(forceinline=True, **_OPTIONS)(second))


def record_reader(record: type[Any]) -> Callable[..., Any]:
    """Return the kernel (rows, i) -> `record`, a NamedTuple of floats whose values stand in row i of `rows` (N, fields)."""
    values = ", ".join(f"rows[i, {column}]" for column in range(len(record._fields)))
    return generated("read", f"def read(rows, i):\n    return record({values})\n", {"record": record})


def plain(value: Any) -> Any:
    """Return NamedTuples within NamedTuples as plain tuples, which numba takes from Python three times as fast."""
    return tuple(plain(item) for item in value) if isinstance(value, tuple) else value


def rebuilder(example: Any) -> Callable[..., Any]:
    """Return the kernel that makes records of the types of `example`, NamedTuples in NamedTuples, from `plain` tuples."""
    names: dict[str, type[Any]] = {}

    def call(value: Any, where: str) -> str:
        if not isinstance(value, tuple):
            return where
        name = f"made_{len(names)}"
        names[name] = type(value)
        return f"{name}({', '.join(call(item, f'{where}[{i}]') for i, item in enumerate(value))})"

    return generated("rebuild", f"def rebuild(plain):\n    return {call(example, 'plain')}\n", names)


def row_taker(example: Any) -> Callable[..., Any]:
    """Return the kernel (rows, i) -> `plain` tuples of arrays as `example` is, with row i alone of each: a batch of one."""

    def call(value: Any, where: str) -> str:
        if not isinstance(value, tuple):
            return f"{where}[i : i + 1]"
        return f"({''.join(call(item, f'{where}[{j}]') + ', ' for j, item in enumerate(value))})"

    return generated("row", f"def row(rows, i):\n    return {call(example, 'rows')}\n", {})


def cuda_kernel(function: Callable[..., None], arguments: str) -> Any:
    """Compile a CUDA kernel whose thread i calls `function(i, arguments)`, while i is below the first argument's length.

    It is launched as `kernel[blocks, threads](...)` with arrays of `on_device`.
    """
    from numba import cuda

    jit: Any = cuda.jit
    first = arguments.partition(",")[0]
    source = f"def launch({arguments}):\n    i = cuda.grid(1)\n    if i < {first}.shape[0]:\n        function(i, {arguments})\n"
    namespace: dict[str, Any] = {"cuda": cuda, "function": function}
    exec(source, namespace)
    return jit(namespace["launch"])


def on_device(value: Any) -> Any:
    """Return tuples within tuples with their arrays on the GPU; numbers stay."""
    from numba import cuda

    if isinstance(value, tuple):
        return tuple(on_device(item) for item in value)
    return cuda.to_device(value) if isinstance(value, np.ndarray) else value


def by_type(
    function: Callable[..., Any],
    chooser: str,
    kernels: Mapping[type[Any], Callable[..., Any]],
    passed: Sequence[str] | None = None,
) -> None:
    """Let compiled code that calls `function` call the kernel for the type of its argument `chooser`, a NamedTuple.

    `passed` names the arguments that the kernel takes, all by default. The type is known when the caller is compiled.
    """
    if _numba.config.DISABLE_JIT:
        return
    from numba.extending import overload

    arguments = function.__code__.co_varnames[: function.__code__.co_argcount]
    inside = ", ".join(passed or arguments)
    source = f"def choose({', '.join(arguments)}):\n    kernel = kernels.get({chooser}.instance_class)\n" + (
        f"    if kernel is None:\n        return None\n    return lambda {', '.join(arguments)}: kernel({inside})\n"
    )
    namespace: dict[str, Any] = {"kernels": kernels}
    exec(source, namespace)
    overload(function, jit_options={"forceinline": True, "error_model": "numpy", "nogil": True})(namespace["choose"])
