"""The child of `apart`: answers requests for files."""

import gc
import importlib
import logging
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env import child
from wsp_env.recordings.errors import CampaignError, first_line
from wsp_env.recordings.readers.apart import memory_limit
from wsp_env.recordings.readers.channel_file import ChannelFile
from wsp_env.servant import Message, serve


class _Files:
    """The file that is open: the last one."""

    def __init__(self) -> None:
        self._opened: ChannelFile | None = None
        self._key: Any = None
        self._limited = False
        self._used: set[str] = set()  # readers

    def answer(self, request: dict[str, Any], arrays: list[np.ndarray]) -> Message:
        """Return what a file states, or the samples of the channels asked for."""
        reader = importlib.import_module(f"wsp_env.recordings.readers.{request['reader']}")
        if not self._limited:  # what libraries map when they are imported is not the file's
            child.limit_memory(memory_limit())
            self._limited = True
        if request["reader"] not in self._used:
            self._used.add(request["reader"])
            gc.freeze()  # every damaged file ends in a collection of what it left: what was imported is not looked at again
        file = Path(request["file"])
        try:
            opened = self._open(reader, file)
            if "names" not in request:
                return {"units": opened.units, "own_clocks": opened.own_clocks, "first_line": opened.first_line}, []
            return _samples(opened, request["names"])
        except MemoryError:
            said = f"{file} needs more memory than there is for a file"
        except CampaignError as error:
            said = str(error)
        except Exception as error:  # whatever a library stumbles over
            said = f"{file} cannot be read: {first_line(error)}"
        self._opened = None
        return {"error": said}, []

    def _open(self, reader: Any, file: Path) -> ChannelFile:
        state = file.stat()
        key = (file, state.st_size, state.st_mtime_ns)
        if self._opened is None or self._key != key:
            self._opened, self._key = None, key
            self._opened = reader.open_file(file)
        opened: ChannelFile = self._opened
        return opened


def _samples(opened: ChannelFile, names: list[str]) -> Message:
    arrays: list[np.ndarray] = []
    clocks = []
    samples = opened.read(names)
    for name in names:
        found = samples[name]
        clocks.append(found.time_s is not None)
        arrays += [found.values] if found.time_s is None else [found.values, found.time_s]
    return {"clocks": clocks}, arrays


def main() -> None:
    """Serve the parent."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)  # libraries log what they then raise, and what does not matter
    sys.unraisablehook = lambda _: None
    serve(_Files().answer)
