"""Channels that say nothing: those that the reader found dead."""

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.search import Search


def find(search: Search) -> None:
    """Tell dead channels; the reader has left their axles out already."""
    seen: dict[str, list[str]] = {}
    for name, run in search.campaign.runs.items():
        for channel in run.dead_channels:
            seen.setdefault(channel, []).append(name)
    for channel, names in sorted(seen.items()):
        axle = int(channel.removeprefix("axle").split("_")[0])
        search.report(
            SuspectChannel(
                channel,
                f"never changes while the vehicle moves{where(names, search.runs)}: dead",
                f"map another column to it, or give missing_axles = [{axle}] in [vehicle]",
                "dead", axle, 0.0, tuple(names),
            )
        )  # fmt: skip
