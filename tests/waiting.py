"""Waiting for other processes in tests."""

import time
from collections.abc import Callable
from pathlib import Path


def until(holds: Callable[[], bool], seconds: float = 60.0) -> None:
    """Wait until something holds; fail after some time."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def runs(process: int | str) -> bool:
    """Whether a process runs and is not waited for only (Linux)."""
    try:
        return Path("/proc", str(process), "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
