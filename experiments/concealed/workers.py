"""Work on the cases of a bank in several processes of one thread each; answers are written whole or not at all."""

import json
import multiprocessing
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import track

from wsp_env.recordings import Campaign, CampaignWarning, read_campaign

T = TypeVar("T")

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "POLARS_MAX_THREADS"), "1"
)


def each(work: Callable[[T], None], tasks: Sequence[T], jobs: int, title: str) -> None:
    """Do all tasks, which may be done in any order.

    The libraries read their number of threads when they are loaded: the processes are fresh ones, which inherit it.
    """
    if not tasks:
        return
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        with multiprocessing.get_context("spawn").Pool(min(jobs, len(tasks))) as pool:
            for _ in track(pool.imap_unordered(work, tasks), title, total=len(tasks)):
                pass
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def quietly_read(folder: Path) -> Campaign:
    """Read a campaign without a word on the quality of its channels, which are what they are."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        return read_campaign(folder)


def write_whole(file: Path, content: Any) -> None:
    """Write JSON under a temporary name first: a file that is there is whole."""
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(".tmp")
    unfinished.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    unfinished.replace(file)
