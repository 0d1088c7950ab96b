"""A process of its own for a controller in native code: a crash, an endless loop or a leak ends that process only.

Between the two go lines of JSON and the bytes of float arrays.
"""

import json
import os
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env import child

#: Time for one decision on all stops of a batch [s] of the processor (assumption: real units decide within 20 ms); by the clock
#: `wsp_env.child.CLOCK_PER_CPU` times as much.
DECISION_LIMIT_S = 2.0

#: The same for opening the file and for beginning the stops: an FMU is unpacked and instantiated (assumption).
OPENING_LIMIT_S = 20.0

_START_S = 600.0  # by the clock, until the process has imported what it needs

#: Begins the process without the package's own start, which loads the environments and the compiler: a second for nothing.
_CODE = """
import json, sys, types
sys.path[:] = json.loads(sys.argv[1])
package = sys.modules["wsp_env"] = types.ModuleType("wsp_env")
package.__path__ = [sys.argv[2]]
from wsp_env.evaluation import served
served.main()
"""


class NativeError(RuntimeError):
    """What went wrong with a controller in native code."""


class RefusedError(Exception):
    """What is wrong with the file, on the other side; the message is the end of a sentence that begins with its name."""


class Isolated:
    """The process; it ends with the object.

    Parameters
    ----------
    what : how messages call what runs in it

    """

    def __init__(self, what: str) -> None:
        self._what = what
        path = json.dumps([os.path.abspath(place) for place in sys.path])
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CODE, path, str(Path(__file__).parents[1])],
            bufsize=0,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
        )
        self._read = b""
        self._end = weakref.finalize(self, _end, self._process)
        try:
            started = self._line(time.monotonic() + _START_S)
        except (EOFError, OSError):
            started = b""
        if started != b"ready":
            self._end()
            raise NativeError(f"{what}: the process for it did not start")

    def ask(self, request: Mapping[str, Any], limit_s: float, *arrays: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
        """Return the answer to a request and its numbers; `NativeError` with what it says, or how the process ended."""
        head = json.dumps({**request, "limit_s": limit_s, "lengths": [array.size for array in arrays]}).encode()
        deadline = time.monotonic() + child.CLOCK_PER_CPU * limit_s
        try:
            assert self._process.stdin is not None
            data = memoryview(head + b"\n" + b"".join(np.ascontiguousarray(array, np.float64).tobytes() for array in arrays))
            while data:
                data = data[self._process.stdin.write(data) :]
            answer = json.loads(self._line(deadline))
            numbers = np.frombuffer(self._bytes(8 * int(answer.get("length", 0)), deadline))
        except (OSError, EOFError, ValueError):
            how = self._ended()
            raise NativeError(f"{self._what} {how}") from None
        except BaseException:  # Ctrl-C in the middle of an answer
            self._end()
            raise
        if "error" in answer:
            raise NativeError(f"{self._what} {answer['error']}")
        return answer, numbers

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the process."""
        self._end()

    def _ended(self) -> str:
        """Say how the process ended; end it where it still runs."""
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._end()
            return "took too long and was ended"
        finally:
            self._end()
        if code in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
            return "took too long and was ended"
        named = {-number: number.name for number in signal.Signals}
        return f"crashed ({named.get(code, f'exit status {code}')}): look for memory beyond an array or a null pointer"

    def _line(self, deadline: float) -> bytes:
        while b"\n" not in self._read:
            self._read += self._some(deadline)
        line, _, self._read = self._read.partition(b"\n")
        return line

    def _bytes(self, length: int, deadline: float) -> bytes:
        while len(self._read) < length:
            self._read += self._some(deadline)
        found, self._read = self._read[:length], self._read[length:]
        return found

    def _some(self, deadline: float) -> bytes:
        assert self._process.stdout is not None
        left = deadline - time.monotonic()
        ready, _, _ = select.select([self._process.stdout], [], [], max(left, 0.0))
        if not ready:
            raise EOFError
        some = os.read(self._process.stdout.fileno(), 1 << 20)
        if not some:
            raise EOFError
        return some


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
