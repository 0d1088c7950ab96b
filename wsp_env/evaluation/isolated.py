"""A process of its own for a controller in native code: a crash, an endless loop or a leak ends that process only."""

import signal
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsp_env.servant import GoneError, Servant

#: Time for one decision on all stops of a batch [s] of the processor (assumption: real units decide within 20 ms); by the clock
#: `wsp_env.child.CLOCK_PER_CPU` times as much.
DECISION_LIMIT_S = 2.0

#: The same for opening the file and for beginning the stops: an FMU is unpacked and instantiated (assumption).
OPENING_LIMIT_S = 20.0

#: What a process may have done that a signal ended; of others it is memory.
_CAUSES = {
    "SIGABRT": "look for an assertion, abort(), or memory that was freed twice",
    "SIGFPE": "look for a whole number divided by zero",
    "SIGILL": "look for code that can never be reached, or was built for another processor",
    "SIGKILL": "ended from outside; is there enough memory?",
}


class NativeError(RuntimeError):
    """What went wrong with a controller in native code."""


class RefusedError(Exception):
    """What is wrong with the file, on the other side; the message is the end of a sentence that begins with its name."""


class Isolated:
    """The process, see `wsp_env.evaluation.served`; it ends with the object.

    Parameters
    ----------
    what : how messages call what runs in it

    """

    def __init__(self, what: str) -> None:
        self._what = what
        try:
            self._servant = Servant("wsp_env.evaluation.served")
        except GoneError:
            raise NativeError(f"{what}: the process for it did not start") from None

    def ask(self, request: Mapping[str, Any], limit_s: float, *arrays: np.ndarray) -> np.ndarray:
        """Return the numbers that answer a request; `NativeError` with what it says, or how the process ended."""
        try:
            answer, (numbers, *_) = self._servant.ask(request, limit_s, *arrays)
        except GoneError as gone:
            raise NativeError(f"{self._what} {_words(gone)}") from None
        if "error" in answer:
            raise NativeError(f"{self._what} {answer['error']}")
        return numbers

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._servant.alive


def _words(gone: GoneError) -> str:
    """Say how the process ended, and what usually is the cause."""
    if gone.late:
        return "took too long and was ended"
    named = {-number: number.name for number in signal.Signals}
    how = named.get(gone.code or 0)
    if how is None:
        return f"ended its process (exit status {gone.code}): it must return, and never call exit"
    return f"crashed ({how}): {_CAUSES.get(how, 'look for memory beyond an array or a null pointer')}"
