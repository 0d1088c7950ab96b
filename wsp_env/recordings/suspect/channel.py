"""A channel that contradicts the others as no physics does."""

import dataclasses
from collections.abc import Collection
from typing import Literal

Kind = Literal["unit", "factor", "copy", "swap", "offset", "delay", "dead"]


@dataclasses.dataclass(frozen=True)
class SuspectChannel:
    """A channel that contradicts the others as no physics does."""

    channel: str  # as `channels.CHANNELS` names it; "axle*_..." for that of every axle
    suspicion: str
    remedy: str
    kind: Kind = "factor"
    axle: int = 0  # from 1; 0: the vehicle, or every axle
    value: float = 0.0  # unit, factor: recorded over true [-]; offset [N m]; delay [s]; copy, swap: the other axle
    runs: tuple[str, ...] = ()  # in which it was seen

    @property
    def line(self) -> str:
        """All of it in one line."""
        return f"{self.channel}: {self.suspicion}; {self.remedy}"


def where(runs: Collection[str], everyone: Collection[str]) -> str:
    """Say in which runs something was seen, "" for all."""
    return "" if len(runs) == len(everyone) else f" in run {', '.join(runs)}"
