"""A child process that answers requests: for what may crash, stall or fill the memory, and is not to take this one along.

Between the two go lines of JSON and the bytes of float arrays: whatever goes on in the child, it can hand back numbers only.
"""

import json
import math
import os
import select
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env import child

#: A request or an answer: what is asked or said, and numbers.
Message = tuple[dict[str, Any], Sequence[np.ndarray]]

_START_S = 600.0  # by the clock, until the child has imported what it needs

#: Begins the child without the package's own start, which loads the environments and the compiler: a second for nothing.
_CODE = """
import importlib, json, sys, types
sys.path[:] = json.loads(sys.argv[1])
package = sys.modules["wsp_env"] = types.ModuleType("wsp_env")
package.__path__ = [sys.argv[2]]
importlib.import_module(sys.argv[3]).main()
"""


class GoneError(Exception):
    """The child has ended without an answer.

    Parameters
    ----------
    code : its exit status; None where it took too long and was ended

    """

    def __init__(self, code: int | None) -> None:
        super().__init__(code)
        self.code = code

    @property
    def late(self) -> bool:
        """Whether its time was over."""
        return self.code is None or child.ended_by(self.code) == child.TOO_LONG


class Servant:
    """The child; it ends with the object.

    Parameters
    ----------
    module : whose function `main` calls `serve`

    Raises
    ------
    GoneError
        where it does not start

    """

    def __init__(self, module: str) -> None:
        path = json.dumps([os.path.abspath(place) for place in sys.path])
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CODE, path, str(Path(__file__).parent), module],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._read = bytearray()  # of an answer, and not used yet
        self.end = weakref.finalize(self, _end, self._process)
        try:
            started = self._line(time.monotonic() + _START_S)
        except (OSError, EOFError):
            started = b""
        if started != b"ready":
            raise GoneError(self._ended())

    @property
    def alive(self) -> bool:
        """Whether the child still runs."""
        return self._process.poll() is None

    def ask(self, request: Mapping[str, Any], limit_s: float, *arrays: np.ndarray) -> Message:
        """Return the answer to a request; the child may take `limit_s` of the processor for it.

        By the clock `wsp_env.child.CLOCK_PER_CPU` times as much. `GoneError` where there is none.
        """
        deadline = time.monotonic() + child.CLOCK_PER_CPU * limit_s
        assert self._process.stdin is not None
        try:
            data = memoryview(b"".join(_packed({**request, "limit_s": limit_s}, arrays)))
            while data:
                data = data[self._process.stdin.write(data) :]
            head = json.loads(self._line(deadline))
            return head, [np.frombuffer(self._bytes(8 * length, deadline)) for length in head["lengths"]]
        except (OSError, EOFError, ValueError):
            raise GoneError(self._ended()) from None
        except BaseException:  # Ctrl-C in the middle of an answer
            self.end()
            raise

    def _ended(self) -> int | None:
        """Return how the child has ended; end it where it still runs."""
        try:
            return self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return None
        finally:
            self.end()

    def _line(self, deadline: float) -> bytes:
        while b"\n" not in self._read:
            self._read += self._some(deadline)
        line, _, self._read = self._read.partition(b"\n")
        return bytes(line)

    def _bytes(self, length: int, deadline: float) -> bytearray:
        while len(self._read) < length:
            self._read += self._some(deadline)
        found, self._read = self._read[:length], self._read[length:]
        return found

    def _some(self, deadline: float) -> bytes:
        """Return what the child has written; `EOFError` where nothing comes in time."""
        pipe = self._process.stdout
        assert pipe is not None
        if sys.platform != "win32" and not select.select([pipe], [], [], max(deadline - time.monotonic(), 0.0))[0]:
            raise EOFError
        if not (some := os.read(pipe.fileno(), 1 << 20)):
            raise EOFError
        return some


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        pipe.close()


def _packed(head: Mapping[str, Any], arrays: Sequence[np.ndarray]) -> list[Any]:
    """Return a message as what is written one after the other."""
    flat = [np.ascontiguousarray(array, dtype=np.float64).ravel() for array in arrays]
    line = json.dumps({**head, "lengths": [len(array) for array in flat]}).encode() + b"\n"
    return [line, *(array.view(np.uint8).data for array in flat)]


def serve(answer: Callable[[dict[str, Any], list[np.ndarray]], Message]) -> None:
    """Answer requests until there are none; what is printed meanwhile goes nowhere."""
    child.become_worker()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    requests = os.fdopen(0, "rb", closefd=False)
    answers.write(b"ready\n")
    answers.flush()
    while line := requests.readline():
        request = json.loads(line)
        given = [np.frombuffer(requests.read(8 * length)) for length in request["lengths"]]
        child.limit_processor(request["limit_s"])
        for part in _packed(*answer(request, given)):
            answers.write(part)
        answers.flush()
        child.limit_processor(math.inf)
