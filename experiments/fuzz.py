"""Damaged files by the thousand at every door: `make fuzz`. What goes wrong is kept in tests/crashes, for every test run.

Every door reads in a process of its own, so that a crash of native code or a hang ends one worker and is counted too. With
`--log FILE` what is done is written down batch by batch, and not tried again.
"""

import argparse
import functools
import importlib
import itertools
import json
import os
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from wsp_env import child
from wsp_env.executor import Processes

TESTS = Path(__file__).parents[1] / "tests"
_BATCH = 50  # files of one door that a worker tries before it reports


def work(task: tuple[str, int, int]) -> bytes:
    """Try damaged files of a door with the seeds from one number to another; return what became of them, as JSON."""
    fuzzing, wrong, became = _fuzzing(), [], Counter[str]()
    name, first, last = task
    door = _doors()[name]
    with tempfile.TemporaryDirectory() as place:
        for seed in range(first, last):
            content = fuzzing.damaged(door.content, seed)
            try:
                with child.limited(2.0 * fuzzing.LONGEST_S):
                    became["refused" if door.try_out(content, Path(place)) else "read"] += 1
            except (Exception, child.TookTooLongError) as error:
                kept = TESTS / "crashes" / f"{name}--{type(error).__name__}-{seed}{door.suffix}"
                kept.parent.mkdir(exist_ok=True)
                kept.write_bytes(content)
                at = traceback.extract_tb(error.__traceback__)[-1]
                where = f"{Path(at.filename).name}:{at.lineno}"
                wrong.append(f"{type(error).__name__}: {str(error)[:200]} ({where}); kept as {kept.name}")
    return json.dumps({"read": became["read"], "refused": became["refused"], "wrong": wrong}).encode()


@functools.cache
def _doors() -> dict[str, Any]:
    """Return the doors of this process; their sound files are made once."""
    return dict(_fuzzing().doors(Path(tempfile.mkdtemp())))


def _fuzzing() -> ModuleType:
    sys.path.insert(0, str(TESTS))
    return importlib.import_module("fuzzing")


def _batches(tasks: Sequence[tuple[str, int, int]], jobs: int, log: Path | None) -> Iterator[dict[str, Any]]:
    """Yield what became of every batch, those of the log first; a worker that ended says so."""
    done = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()] if log and log.exists() else []
    yield from done
    known = {(one["door"], one["first"], one["last"]) for one in done}
    left = [task for task in tasks if task not in known]
    for (name, first, last), answer, failure in Processes(jobs).run(work, left):
        found = {"read": 0, "refused": 0, "wrong": [failure]} if failure else json.loads(answer)
        batch = {"door": name, "first": first, "last": last, **found}
        if log:
            with log.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(batch) + "\n")
        yield batch


def main(arguments: Sequence[str] | None = None) -> int:
    """Try so many files, spread over all doors; return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path)
    given = parser.parse_args(arguments)
    names = _fuzzing().NAMES
    each = -(-given.files // len(names))
    starts = range(given.seed, given.seed + each, _BATCH)
    tasks = [(name, start, min(start + _BATCH, given.seed + each)) for start, name in itertools.product(starts, names)]
    began, wrong, tried, refused = time.monotonic(), 0, Counter[str](), Counter[str]()
    for batch in _batches(tasks, given.jobs, given.log):
        before = sum(tried.values()) // 1000
        tried[batch["door"]] += batch["last"] - batch["first"]
        refused[batch["door"]] += batch["refused"]
        wrong += len(batch["wrong"])
        for complaint in batch["wrong"]:
            print(f"{batch['door']}, seeds {batch['first']} to {batch['last']}: {complaint}", flush=True)
        if sum(tried.values()) // 1000 > before:
            print(f"{sum(tried.values())} of {each * len(names)} files after {time.monotonic() - began:.0f} s", flush=True)
    for name in names:
        print(f"{name:14} {tried[name]:6} tried {refused[name]:6} refused")
    print(f"{sum(tried.values())} damaged files at {len(names)} doors in {time.monotonic() - began:.0f} s: {wrong} went wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
