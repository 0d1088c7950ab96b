"""Work of the single runs, on the threads that evaluate candidates while these have nothing else to do."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

#: The pool of the diagnosis in this thread. A pool's own threads see none: work inside a candidate is not handed on.
_POOL: ContextVar[Executor | None] = ContextVar("pool", default=None)


@contextmanager
def on_threads(pool: Executor) -> Iterator[None]:
    """Let `side_by_side` use a pool, in the thread that calls this."""
    before = _POOL.set(pool)
    try:
        yield
    finally:
        _POOL.reset(before)


def side_by_side(function: Callable[..., Any], *arguments: Any) -> list[Any]:
    """Return `function` of each set of arguments, in their order, which does not depend on the threads.

    A single set is evaluated in this thread, which may hand on work of its own.
    """
    pool, every = _POOL.get(), list(zip(*arguments, strict=True))
    if pool is None or len(every) < 2:
        return [function(*one) for one in every]
    return list(pool.map(function, *zip(*every, strict=True)))
