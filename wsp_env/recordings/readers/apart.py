"""Files read in a process of their own: native code that a damaged file may crash, stall or fill the memory with.

One child serves this process for as long as both live; when it takes too long it is ended, and the next file gets a new one.
Between the two go lines of JSON and the bytes of float arrays: what a file makes of the child, it can only hand back numbers.
"""

import atexit
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env import child
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers.channel_file import ChannelFile, Samples

#: Time for one request [s] of the processor: what opening takes, and so much more for each byte. Readers take in some 50
#: million bytes a second; a tenth of it is far from normal.
LEAST_S = 20.0
_PER_BYTE_S = 1.0 / 5e6

#: Share of the machine's memory that a reader may take.
_MEMORY_SHARE = 0.5

_START_S = 600.0  # by the clock, until the child has imported what it needs
_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from wsp_env.recordings.readers import served; served.main()"


class Apart(ChannelFile):
    """A file whose reader runs in the child."""

    def __init__(self, file: Path, reader: str):
        self._reader = reader
        answer, _ = _SERVANT.ask(file, {"reader": reader, "file": os.path.abspath(file)})
        super().__init__(file, answer["units"])
        self.own_clocks, self.first_line = bool(answer["own_clocks"]), int(answer["first_line"])

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels."""
        request = {"reader": self._reader, "file": os.path.abspath(self.file), "names": names}
        answer, arrays = _SERVANT.ask(self.file, request)
        found = {}
        for name, has_clock in zip(names, answer["clocks"], strict=True):
            values = next(arrays)
            found[name] = Samples(values, next(arrays) if has_clock else None)
        return found


class _Servant:
    """The child, begun at its first file."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._read = b""  # of the answer, and not used yet

    def ask(self, file: Path, request: dict[str, Any]) -> tuple[dict[str, Any], Iterator[np.ndarray]]:
        """Return the answer and its arrays; `CampaignError` with what the reader says, or how it ended."""
        cpu_s = LEAST_S + _PER_BYTE_S * _size(file)
        with self._lock:
            try:
                pipe = self._started().stdin
                assert pipe is not None
                pipe.write(json.dumps(request | {"seconds": cpu_s}).encode() + b"\n")
                deadline = time.monotonic() + child.CLOCK_PER_CPU * cpu_s
                answer = json.loads(self._line(deadline))
                arrays = [np.frombuffer(self._bytes(8 * length, deadline)) for length in answer.get("lengths", ())]
            except (OSError, EOFError, ValueError):
                how = self.end()
                raise CampaignError(f"{file} is damaged, or needs too much memory or time: its reader {how}") from None
            except BaseException:  # Ctrl-C in the middle of an answer
                self.end()
                raise
        if "error" in answer:
            raise CampaignError(answer["error"])
        return answer, iter(arrays)

    def end(self) -> str:
        """End the child; say how it ended by itself."""
        process, self._process, self._read = self._process, None, b""
        if process is None:
            return "did not start"
        try:
            how = child.ended_by(process.wait(1.0)).replace("the process it ran in", "its process")
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            how = "took too long"
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            pipe.close()
        return how

    def _started(self) -> "subprocess.Popen[bytes]":
        if self._process is not None and self._process.poll() is None:
            return self._process
        path = json.dumps([os.path.abspath(place) for place in sys.path])
        command = [sys.executable, "-P", "-c", _CODE, path]
        pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
        self._process = subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe, stderr=quiet)
        self._read = b""
        if self._line(time.monotonic() + _START_S) != b"ready":
            raise EOFError
        return self._process

    def _line(self, deadline: float) -> bytes:
        while b"\n" not in self._read:
            self._read += self._some(deadline)
        line, _, self._read = self._read.partition(b"\n")
        return line

    def _bytes(self, length: int, deadline: float) -> bytearray:
        found = bytearray(self._read)
        while len(found) < length:
            found += self._some(deadline)
        found, self._read = found[:length], bytes(found[length:])
        return found

    def _some(self, deadline: float) -> bytes:
        """Return what the child has written; `EOFError` where nothing comes in time."""
        assert self._process is not None
        pipe = self._process.stdout
        assert pipe is not None
        if sys.platform != "win32" and not select.select([pipe], [], [], max(deadline - time.monotonic(), 0.0))[0]:
            raise EOFError
        if not (part := os.read(pipe.fileno(), 1 << 20)):
            raise EOFError
        return part


def memory_limit() -> int:
    """Return how many bytes a reader may take."""
    try:
        return int(_MEMORY_SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return 2**32


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


_SERVANT = _Servant()
atexit.register(_SERVANT.end)
