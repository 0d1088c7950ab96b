"""Limits on code that is not ours: time for one call, and processes that do not outlive their parent.

Time is the processor's, so that a busy machine fails nobody, beside a much longer one by the clock for what only waits. What
numba compiles meanwhile does not count. POSIX alone has both; elsewhere nothing is limited.
"""

import contextlib
import ctypes
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing import connection, parent_process, resource_tracker
from types import FrameType

from numba.core import event

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]  # not there on Windows

#: Clock time per processor time that is allowed: so slow a busy machine may be (assumption).
CLOCK_PER_CPU = 30.0

_GRACE_S = 5.0  # of the processor, for code that swallows the exception; then its process is ended, if it is a worker
_PR_SET_PDEATHSIG = 1  # prctl(2)

#: How a process may end, as the end of a sentence.
TOO_LONG, ENDED = "took too long and was ended", "ended the process it ran in"


class TookTooLongError(BaseException):
    """What is raised in code whose time is over; no `Exception`, which third-party code may well swallow."""


class _Process:
    expendable = False  # whether this process may be ended by a signal: a worker's


def become_worker() -> None:
    """Say that this process may be ended; it ends with its parent, and leaves Ctrl-C to it."""
    become_expendable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    parent = parent_process()
    if parent is not None:  # of `multiprocessing`; also where the system does not see to it
        threading.Thread(target=lambda: (connection.wait([parent.sentinel]), os._exit(1)), daemon=True).start()


@contextlib.contextmanager
def deaf_children() -> Iterator[None]:
    """While processes are begun: they are deaf to Ctrl-C from their first instant, before `become_worker` can say so.

    Ctrl-C reaches this process at the end, by whichever of its threads the system delivers it.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # beginning it would let Ctrl-C through again
    pressed = []
    with _handled_by(lambda *_: pressed.append(True)):  # a thread whose mask is its own lets it through
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if pressed:
        signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Answer Ctrl-C so meanwhile, in the main thread; elsewhere Python has no handlers to set."""
    if threading.current_thread() is not threading.main_thread() or (before := signal.getsignal(signal.SIGINT)) is None:
        yield
        return
    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def become_expendable() -> None:
    """Say that this process may be ended where a limit of time is not kept."""
    _Process.expendable = True


def end_with_parent() -> None:
    """Let the system end this process when the parent's thread that began it ends (Linux)."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@contextlib.contextmanager
def limited(cpu_s: float) -> Iterator[None]:
    """Raise `TookTooLongError` in what runs here for longer than so many seconds of the processor.

    Or for longer than `CLOCK_PER_CPU` times that by the clock. A worker is ended where even that does not help: in compiled
    code, or where everything is caught. Only the main thread can be limited.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    timers = ((signal.ITIMER_PROF, signal.SIGPROF, cpu_s), (signal.ITIMER_REAL, signal.SIGALRM, CLOCK_PER_CPU * cpu_s))
    handlers = [signal.signal(number, _over) for _, number, _ in timers]
    before = [signal.setitimer(timer, seconds) for timer, _, seconds in timers]
    processor_s = 2.0 * cpu_s + _GRACE_S
    _limit_processor(processor_s)
    try:
        with event.install_listener("numba:compile", _Compiling(processor_s)):
            yield
    finally:
        _limit_processor(math.inf)
        for (timer, number, _), handler, (left, interval) in zip(timers, handlers, before, strict=True):
            signal.setitimer(timer, left, interval)
            signal.signal(number, handler)


class _Compiling(event.Listener):
    """Stops the clocks of `limited` while numba compiles, and the system's limit on the processor's time [s]."""

    def __init__(self, processor_s: float) -> None:
        self._processor_s, self._depth, self._left = processor_s, 0, (0.0, 0.0)

    def on_start(self, event: event.Event) -> None:
        self._depth += 1
        if self._depth == 1:
            self._left = (signal.setitimer(signal.ITIMER_PROF, 0.0)[0], signal.setitimer(signal.ITIMER_REAL, 0.0)[0])
            _limit_processor(math.inf)

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            for timer, left in zip((signal.ITIMER_PROF, signal.ITIMER_REAL), self._left, strict=True):
                signal.setitimer(timer, left)
            _limit_processor(self._processor_s)


def _over(number: int, frame: FrameType | None) -> None:
    if _Process.expendable:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, _GRACE_S)
    raise TookTooLongError


def _limit_processor(seconds: float) -> None:
    """Let the system end this process, if it is a worker, once it has taken so much more of the processor."""
    if _Process.expendable and resource is not None:
        limit_processor(seconds)


def limit_processor(seconds: float) -> None:
    """Let the system end this process once it has taken so much more of the processor [s]; inf: never."""
    if resource is None:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    soft = hard if math.isinf(seconds) else math.ceil(used.ru_utime + used.ru_stime + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))


def limit_memory(more: int) -> None:
    """Let this process take so many bytes more at most."""
    if resource is None:
        return
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            now = int(file.read().split()[0]) * resource.getpagesize()
    except OSError:
        now = 0
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    with contextlib.suppress(ValueError, OSError):  # not on macOS
        resource.setrlimit(resource.RLIMIT_AS, (now + more, hard))


def ended_by(exit_code: int | None) -> str:
    """Say how a process ended."""
    over = {-getattr(signal, name) for name in ("SIGPROF", "SIGXCPU", "SIGALRM") if hasattr(signal, name)}
    if exit_code in over:
        return TOO_LONG
    return ENDED
