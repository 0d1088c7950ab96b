"""`wsp inspect`: what is in a third-party file, and a campaign.toml to start from."""

import sys
import warnings
from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.cli.folder import make_campaign, pictured
from wsp_env.cli.out import OutFile
from wsp_env.cli.pages import Pages
from wsp_env.output import ready, write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.recordings.inspection import InspectedChannel, draft, inspect, suspicions
from wsp_env.recordings.suspect import suspects
from wsp_env.report import PageOptions

_WIDTH = 160  # of the table in a file or a pipe


def main(
    file: tyro.conf.Positional[Path],
    /,
    out: Annotated[OutFile | None, tyro.conf.arg(metavar="FILE")] = None,
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "",
    page: Pages = PageOptions(),
) -> None:
    """List a recording's channels with units, rates, range, noise and what they may be; draft a campaign.toml.

    Of a folder: find the recorded stops in it, write its campaign.toml and a page with all signals. Mass, inertia and radius
    come from --vehicle, or are asked for on a terminal. A campaign.toml that is there is kept, and the page drawn by it.

    Parameters
    ----------
    file
        CSV, Parquet, MDF4 (.mf4) or MAT file, or a folder of such files.
    out
        Where to write campaign.toml (a folder's: into it); not written over what is there.
    vehicle
        Gives a folder's campaign mass, inertia and radius: a name (wsp vehicle list) or a vehicle file.
    page
        How the page of a folder's signals is written.

    """
    from rich.console import Console

    from wsp_env.report import Table, terminal_table

    if file.is_dir():
        console = Console(highlight=False, soft_wrap=True)
        page.files(file / "signals.html")
        if out is None and (file / "campaign.toml").exists():  # of an earlier run, perhaps one that was broken off
            made = file
            console.print(f"Kept as it is: {file / 'campaign.toml'}; remove it to have it written anew", markup=False)
        else:
            made = make_campaign(file, vehicle, out, console)
        pictured(made, made / "signals.html", console, page)
        return
    if out is not None:
        if out.exists():
            remedy = "is a folder; name a file in it" if out.is_dir() else "exists already; name another file or remove it"
            raise CampaignError(f"{out} {remedy}")
        ready(out)
    found = inspect(file)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    header = ("channel", "unit", "samples", "missing", "rate [Hz]", "lowest", "highest", "noise", "resolution", "may be")
    console.print(
        terminal_table(Table(header, [_row(channel) for channel in found], "noise and resolution in the channel's unit"))
    )
    for sentence in (*suspicions(found), *_beside(file)):
        warnings.warn(sentence, CampaignWarning, stacklevel=2)
    text = draft(file, found)
    if out is None:
        console.print("Draft of campaign.toml (--out FILE writes it):\n")
        console.print(text, markup=False, soft_wrap=True)
        return
    write_text(out, text)
    console.print(f"Draft written: {out}", markup=False)


def _beside(file: Path) -> list[str]:
    """Return the suspect channels of the campaign that the file belongs to, where one is beside it and can be read."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)  # the reader's own are told when the campaign is used
        try:
            campaign = read_campaign(file.parent)
        except (CampaignError, ParameterError):
            return []
    return [f"campaign {campaign.name}: suspect channel {one.line}" for one in suspects(campaign)]


def _row(channel: InspectedChannel) -> tuple[str, ...]:
    q = channel.quality
    rate = "?" if channel.rate_hz is None else f"{channel.rate_hz:.4g}"
    guessed = f"{channel.guess} [{channel.guessed_unit}]" if channel.guess else ""
    numbers = (f"{value:.4g}" for value in (q.lowest, q.highest, q.noise, q.resolution))
    return (channel.name, channel.unit, str(channel.samples), str(channel.missing), rate, *numbers, guessed)
