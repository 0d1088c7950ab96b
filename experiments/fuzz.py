"""Damaged files by the thousand at every door: `make fuzz`. What goes wrong is kept in tests/crashes, for every test run.

Every door reads in a process of its own, so that a crash of native code or a hang ends one worker and is counted too.
"""

import argparse
import importlib
import itertools
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from wsp_env import child
from wsp_env.executor import Processes

TESTS = Path(__file__).parents[1] / "tests"
_BATCH = 50  # files of one door that a worker tries before it reports


def work(task: tuple[str, int, int]) -> bytes:
    """Try damaged files of a door with the seeds from one number to another; return what went wrong."""
    fuzzing, wrong = _fuzzing(), []
    name, first, last = task
    with tempfile.TemporaryDirectory() as place:
        door = fuzzing.doors(Path(place))[name]
        folder = Path(place) / "tried"
        folder.mkdir()
        for seed in range(first, last):
            content = fuzzing.damaged(door.content, seed)
            try:
                with child.limited(2.0 * fuzzing.LONGEST_S):
                    door.try_out(content, folder)
            except (Exception, child.TookTooLongError) as error:
                kept = TESTS / "crashes" / f"{name}--{type(error).__name__}-{seed}{door.suffix}"
                kept.parent.mkdir(exist_ok=True)
                kept.write_bytes(content)
                at = traceback.extract_tb(error.__traceback__)[-1]
                where = f"{Path(at.filename).name}:{at.lineno}"
                wrong.append(f"{type(error).__name__}: {str(error)[:200]} ({where}); kept as {kept.name}")
    return "; ".join(wrong).encode()


def _fuzzing() -> ModuleType:
    sys.path.insert(0, str(TESTS))
    return importlib.import_module("fuzzing")


def main(arguments: Sequence[str] | None = None) -> int:
    """Try so many files, spread over all doors; return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    names = _fuzzing().NAMES
    each = -(-given.files // len(names))
    starts = range(given.seed, given.seed + each, _BATCH)
    tasks = [(name, start, min(start + _BATCH, given.seed + each)) for start, name in itertools.product(starts, names)]
    began, wrong, tried = time.monotonic(), 0, 0
    for (name, first, last), found, failure in Processes(given.jobs).run(work, tasks):
        tried += last - first
        complaint = failure or found.decode()
        if complaint:
            wrong += 1
            print(f"{name}, seeds {first} to {last}: {complaint}", flush=True)
        if tried % 1000 < _BATCH:
            print(f"{tried} of {each * len(names)} files after {time.monotonic() - began:.0f} s", flush=True)
    print(f"{tried} damaged files at {len(names)} doors in {time.monotonic() - began:.0f} s: {wrong} batches went wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
