"""A folder of recorded files made a campaign: what `wsp inspect FOLDER` and `wsp diagnose FOLDER` share."""

import shlex
import sys
import warnings
from pathlib import Path

from rich.console import Console

from wsp_env.output import ready, write_text
from wsp_env.parameters.quantity import number
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.recordings.folder import ASKED, Found, find, of_vehicle, open_questions, split, unused, write
from wsp_env.recordings.inspection import MEASURED
from wsp_env.recordings.origin import origin
from wsp_env.recordings.suspect import suspects, tell
from wsp_env.report import PageOptions

_SHOWN = 12  # names of a list
_ASSUMED = (
    "Assumed in it: somebody measured the brake torques. Where they were computed from pressures, change brake_torque_source: "
    "brakes that give less than computed are then looked for"
)
_PLACES = (
    "Open in it: where on the track each stop began. With start_position_m of every run the diagnosis finds more; it then "
    "compares what the stops met at the same place"
)


def make_campaign(folder: Path, vehicle: str, out: Path | None, console: Console) -> Path:
    """Write the campaign.toml of a folder of recorded files; return its folder.

    What nobody but a person knows comes from a vehicle file or is asked for on a terminal; elsewhere it stays open.

    Raises
    ------
    CampaignError
        where no stop is found, a campaign.toml is there already, or `out` has another name

    """
    file = out or folder / "campaign.toml"
    if file.name != "campaign.toml":
        right = (file if file.is_dir() else file.parent) / "campaign.toml"
        raise CampaignError(f"{file}: the file of a campaign is called campaign.toml; name {right} with --out")
    if file.exists():
        raise CampaignError(f"{file} exists already; name another file with --out, or remove it")
    known = of_vehicle(find_vehicle(vehicle)) if vehicle else {}
    ready(file)
    found = find(folder)
    text = write(found, file.parent, known)
    if not vehicle and (asked := open_questions(text)) and sys.stdin.isatty():
        text = write(found, file.parent, {key: _answer(ASKED[key]) for key in asked})
    write_text(file, text)
    _tell(found, file, console)
    if MEASURED in text:
        console.print(_ASSUMED, markup=False)
    console.print(_PLACES, markup=False)
    for reason in found.left.values():
        warnings.warn(f"left out: {reason}", CampaignWarning, stacklevel=2)
    if asked := open_questions(text):
        console.print(
            f"Still open in it: {', '.join(asked)}; give a vehicle file with --vehicle, or write them in", markup=False
        )
    else:
        console.print(f"Check the guesses in it; then: wsp tune {shlex.quote(str(file.parent))}", markup=False)
    return file.parent


def pictured(folder: Path, page: Path, console: Console, options: PageOptions = PageOptions()) -> None:
    """Write a page with every signal of a campaign, as read and before any model."""
    from wsp_env.recordings.signals import write_signals

    try:
        campaign = read_campaign(folder)
        found = suspects(campaign)
        tell(found)
        lines = [one.line for one in found]
        write_signals(page, campaign, origin("wsp inspect", campaign, folder), options, lines)
    except (CampaignError, ModuleNotFoundError) as error:
        console.print(f"no page of signals: {error}", markup=False)
    else:
        console.print(f"Signals, with what was repaired or rejected: {page}", markup=False)


def _tell(found: Found, file: Path, console: Console) -> None:
    tune, validate = split(found.runs)
    console.print(f"Written: {file}", markup=False)
    console.print(f"  {len(tune)} runs tune, {len(validate)} validate, {len(found.left)} left out", markup=False)
    if names := unused(found.channels):
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        console.print(f"  columns not used: {', '.join(names[:_SHOWN])}{more}", markup=False)


def _answer(question: str) -> float:
    while True:
        given = input(f"{question}: ")
        try:
            value = float(given.replace(",", "."))
        except ValueError:
            value = float("nan")
        if number(value) > 0.0:
            return value
        print("a number above zero, please")
