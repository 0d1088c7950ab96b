"""What every reader gives: the channels of one file, their units, and their samples as they stand there.

A cell that is no number comes out as nan; what to do about it is decided in `recordings.quality`.
"""

import dataclasses
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from wsp_env.recordings.errors import CampaignError


@dataclasses.dataclass(frozen=True)
class Samples:
    """One channel as it stands in the file; nan where it has no number."""

    values: np.ndarray  # (n,) in the file's unit
    time_s: np.ndarray | None = None  # (n,) [s], where the format gives every channel its clock


class ChannelFile(ABC):
    """One open file of recorded channels."""

    own_clocks = False  # whether the format gives every channel its clock
    first_line = 2  # of the file that holds the first sample, where the file is text

    def __init__(self, file: Path, units: dict[str, str]):
        self.file = file
        self.units = units  # channel -> unit stated in the file, "" where it states none

    @abstractmethod
    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels, which must be in `units`; `CampaignError` when the file is damaged."""

    def require(self, names: list[str]) -> None:
        """Raise `CampaignError` naming the channels that the file does not have."""
        if missing := [name for name in names if name not in self.units]:
            has = ", ".join(list(self.units)[:40]) + (", ..." if len(self.units) > 40 else "")
            axles = any(name.startswith("axle") for name in missing)
            remedy = "; an axle without a sensor is named in missing_axles of the run" if axles else ""
            raise CampaignError(f"{self.file} lacks the column {', '.join(missing)}; it has: {has}{remedy}")
