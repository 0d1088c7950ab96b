"""Recorded files of a workspace, their channels, and the columns that channels come from."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.recordings.inspection import InspectedChannel
from wsp_env.recordings.quality import Quality


@dataclasses.dataclass
class File:
    """One recorded file."""

    path: Path
    channels: list[InspectedChannel] = dataclasses.field(default_factory=list)
    rows: int = 0
    slid: float = 0.0  # share of its speed that its wheels lack
    error: str = ""  # why it cannot be read
    group: str = "tune"  # or "validate", or "left out"
    looked: bool = False

    @property
    def name(self) -> str:
        """Its name."""
        return self.path.name

    @property
    def usable(self) -> bool:
        """Whether it was read."""
        return self.looked and not self.error


@dataclasses.dataclass(frozen=True)
class Column:
    """Where a channel comes from."""

    name: str
    unit: str = ""
    suggested: bool = True


def channel_words(channel: str) -> str:
    """Return a channel's name in words."""
    axle = re.match(r"axle(\d+)_(.*)", channel)
    return f"axle {axle[1]} {axle[2].replace('_', ' ')}" if axle else channel.replace("_", " ")


def channel_of(given: dict[str, Any]) -> InspectedChannel:
    """Return a channel as `work.look` wrote it."""
    numbers = given["quality"]
    return InspectedChannel(
        **{**given, "quality": Quality(*(numbers.get(f.name, np.nan) for f in dataclasses.fields(Quality)))}
    )


def speed_of(file: File) -> float:
    """Return the highest speed of a stop, in the unit of its file; 0 where nobody knows its column."""
    return next((one.quality.highest for one in file.channels if one.guess == "vehicle_speed"), 0.0)
