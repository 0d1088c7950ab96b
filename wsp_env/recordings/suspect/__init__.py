"""Suspect channels before suspect physics: units, copies, offsets, factors, exchanged axles and delays.

`suspects` looks at a read campaign. What it finds is mended in what it goes on with, so that one fault is told once; the
campaign itself is left as it is.
"""

import warnings
from collections.abc import Iterable

from threadpoolctl import threadpool_limits

from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.errors import CampaignWarning
from wsp_env.recordings.suspect import copies, dead, delays, factors, offsets, speeds, swaps
from wsp_env.recordings.suspect.channel import SuspectChannel
from wsp_env.recordings.suspect.search import Search

__all__ = ["SuspectChannel", "suspects", "tell", "warn_of_suspects"]

_STEPS = (
    dead.find,
    speeds.find,
    copies.find,
    offsets.find,
    factors.find,
    swaps.find,
    delays.find,
)


def suspects(campaign: Campaign) -> tuple[SuspectChannel, ...]:
    """Return the channels that contradict the others as no physics does, each with how to mend it."""
    search = Search(campaign)
    with threadpool_limits(1, "blas"):  # the matrices are small: threads would only wait for each other
        for step in _STEPS:
            step(search)
    return tuple(search.found)


def warn_of_suspects(campaign: Campaign) -> None:
    """Give one `CampaignWarning` for every suspect channel that the reader has not told already."""
    tell(suspects(campaign))


def tell(found: Iterable[SuspectChannel]) -> None:
    """Give one `CampaignWarning` for each of these that the reader has not told already."""
    for one in found:
        if one.kind != "dead":
            warnings.warn(f"suspect channel {one.line}", CampaignWarning, stacklevel=2)
