"""Files read in a process of their own: native code that a damaged file may crash, stall or fill the memory with.

One child (`wsp_env.servant`) serves this process for as long as both live; when it takes too long it is ended, and the next
file gets a new one.
"""

import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers.channel_file import ChannelFile, Samples
from wsp_env.servant import GoneError, Servant

#: Time for one request [s] of the processor: what opening takes, and so much more for each byte. Readers take in some 50
#: million bytes a second; a tenth of it is far from normal.
LEAST_S = 20.0
_PER_BYTE_S = 1.0 / 5e6

#: Share of the machine's memory that a reader may take.
_MEMORY_SHARE = 0.5


class Apart(ChannelFile):
    """A file whose reader runs in the child."""

    def __init__(self, file: Path, reader: str):
        self._reader = reader
        answer, _ = _READER.ask(file, {"reader": reader, "file": os.path.abspath(file)})
        super().__init__(file, answer["units"])
        self.own_clocks, self.first_line = bool(answer["own_clocks"]), int(answer["first_line"])

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels."""
        request = {"reader": self._reader, "file": os.path.abspath(self.file), "names": names}
        answer, arrays = _READER.ask(self.file, request)
        found = {}
        for name, has_clock in zip(names, answer["clocks"], strict=True):
            values = next(arrays)
            found[name] = Samples(values, next(arrays) if has_clock else None)
        return found


class _Reader:
    """The child, begun at its first file; one thread at a time asks it."""

    def __init__(self) -> None:
        self._servant: Servant | None = None
        self._lock = threading.Lock()

    def ask(self, file: Path, request: dict[str, Any]) -> tuple[dict[str, Any], Iterator[np.ndarray]]:
        """Return the answer and its arrays; `CampaignError` with what the reader says, or how it ended."""
        with self._lock:
            try:
                if self._servant is None or not self._servant.alive:
                    self._servant = Servant("wsp_env.recordings.readers.served")
                answer, arrays = self._servant.ask(request, LEAST_S + _PER_BYTE_S * _size(file))
            except GoneError as gone:
                how = "took too long" if gone.late else "ended its process"
                raise CampaignError(f"{file} is damaged, or needs too much memory or time: its reader {how}") from None
        if "error" in answer:
            raise CampaignError(answer["error"])
        return answer, iter(arrays)


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


_READER = _Reader()
