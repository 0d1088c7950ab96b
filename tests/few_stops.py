"""Campaigns of three stops, where a test needs no more: a diagnosis takes the time of the stops that it is given."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from experiments.concealed import campaign, setup
from wsp_env.recordings import demo_campaign

#: Of the concealed bank's eight stops: one that slides and one that does not to tune on, and one that slides to validate.
TUNE, VALIDATE = ("A1", "A4"), ("B1",)
#: Stops of the demo campaign that are left out.
_LEFT_OUT = ("A5", "B1")


@contextmanager
def few_stops() -> Iterator[None]:
    """Let cases of the concealed bank have the stops TUNE and VALIDATE."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setup, "RUNS", TUNE + VALIDATE)
        patch.setattr(campaign, "TUNE", TUNE)
        patch.setattr(campaign, "VALIDATE", VALIDATE)
        yield


def small_demo(folder: Path) -> Path:
    """Write the demo campaign with three of its five stops, A1 and A3 to tune on and B2 to validate; return the folder."""
    shutil.copytree(demo_campaign(), folder)
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    for name in _LEFT_OUT:
        text = re.sub(rf"\[runs\.{name}\]\n(?:\w.*\n)*", "", re.sub(rf'"{name}",? ?', "", text))
        (folder / f"{name}.csv").unlink()
    file.write_text(text.replace(", ]", "]"), encoding="utf-8")
    return folder
