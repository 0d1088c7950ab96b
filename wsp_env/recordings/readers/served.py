"""The child of `apart`: answers requests for files, one line of JSON each, until there are none."""

import gc
import importlib
import json
import logging
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from wsp_env import child
from wsp_env.recordings.errors import CampaignError, first_line
from wsp_env.recordings.readers.apart import memory_limit
from wsp_env.recordings.readers.channel_file import ChannelFile


def main() -> None:
    """Serve the parent."""
    child.end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # whatever a library prints
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)  # libraries log what they then raise, and what does not matter
    sys.unraisablehook = lambda _: None
    answers.write(b"ready\n")
    answers.flush()
    last: tuple[Any, ChannelFile] | None = None
    limited = False
    used: set[str] = set()
    for line in sys.stdin.buffer:
        request = json.loads(line)
        reader = importlib.import_module(f"wsp_env.recordings.readers.{request['reader']}")
        if not limited:  # what libraries map when they are imported is not the file's
            child.limit_memory(memory_limit())
            limited = True
        child.limit_processor(request["seconds"])
        last = _answer(answers, reader, request, last)
        if request["reader"] not in used:
            used.add(request["reader"])
            gc.freeze()  # every damaged file ends in a collection of what it left: what was imported is not looked at again
        answers.flush()


def _answer(
    answers: BinaryIO, reader: Any, request: dict[str, Any], last: tuple[Any, ChannelFile] | None
) -> tuple[Any, ChannelFile] | None:
    """Write the answer to a request; return the file that is open now."""
    file = Path(request["file"])
    try:
        state = file.stat()
        key = (request["file"], state.st_size, state.st_mtime_ns)
        opened = last[1] if last is not None and last[0] == key else reader.open_file(file)
        if "names" not in request:
            head = {"units": opened.units, "own_clocks": opened.own_clocks, "first_line": opened.first_line}
            answers.write(json.dumps(head).encode() + b"\n")
            return key, opened
        arrays: list[np.ndarray] = []
        clocks = []
        samples = opened.read(request["names"])
        for name in request["names"]:
            found = samples[name]
            clocks.append(found.time_s is not None)
            arrays += [found.values] if found.time_s is None else [found.values, found.time_s]
        answers.write(json.dumps({"clocks": clocks, "lengths": [len(values) for values in arrays]}).encode() + b"\n")
        for values in arrays:
            answers.write(np.ascontiguousarray(values, dtype=np.float64).view(np.uint8).data)
    except MemoryError:
        answers.write(json.dumps({"error": f"{file} needs more memory than there is for a file"}).encode() + b"\n")
        return None
    except CampaignError as error:
        answers.write(json.dumps({"error": str(error)}).encode() + b"\n")
        return None
    except Exception as error:  # whatever a library stumbles over
        answers.write(json.dumps({"error": f"{file} cannot be read: {first_line(error)}"}).encode() + b"\n")
        return None
    return key, opened
