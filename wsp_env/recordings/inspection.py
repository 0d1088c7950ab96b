"""What is in a third-party file: its channels, what they may be, and a campaign.toml to start from.

Guesses are for a person to confirm: they are only ever written into a commented draft, never used to read.
"""

import dataclasses
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wsp_env.recordings import channels, clock, guessing, quality
from wsp_env.recordings.channels import Source
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.quality import Quality
from wsp_env.recordings.readers import open_file

#: What a draft says of torques that stand in the file; no number tells whether anybody measured them.
MEASURED = 'brake_torque_source = "measured"    # EDIT: "cylinder pressure times the nominal gain" where nobody measured them'
_FROM_PRESSURES = (  # of a draft
    "# torque_per_bar_nm = ...           # EDIT: required, torque of a wheelset for one bar in its brake cylinders",
    'brake_torque_source = "cylinder pressure times the nominal gain"   # no torques found in the file',
)


@dataclasses.dataclass(frozen=True)
class InspectedChannel:
    """One channel of a file."""

    name: str
    unit: str  # as the file states it
    samples: int
    missing: int  # of them without a number
    rate_hz: float | None  # None where its clock is not known
    quality: Quality
    guess: str  # channel it may be, "" for none
    guessed_unit: str


def inspect(file: Path) -> list[InspectedChannel]:
    """List the channels of a file of any known format, each with what it may be.

    Raises
    ------
    CampaignError
        when the file cannot be opened

    """
    opened = open_file(file)
    raw: dict[str, tuple[np.ndarray, np.ndarray | None]] = {}
    problem = CampaignError(f"{file} holds no channels")
    for name in opened.units:  # one by one: one that cannot be read leaves the others
        try:
            samples = opened.read([name])[name]
        except CampaignError as error:
            problem = error
            continue
        raw[name] = (samples.values, samples.time_s)
    if not raw:
        raise problem
    guesses = guessing.guess(opened, {name: _highest(values) for name, (values, _) in raw.items()})
    by_name = {source.column: (channel, source.unit or "") for channel, source in guesses.items()}
    time = guesses.get("time")
    found = []
    # The bits of a damaged file may be no number, or so large that differences overflow: they are described as they are.
    with np.errstate(invalid="ignore", over="ignore"):
        for name, (values, own) in raw.items():
            shared = _seconds(raw[time.column][0], time) if time and time.column in raw else None
            rate = _rate(own if own is not None else shared, len(values))
            missing = int((~np.isfinite(values)).sum())
            channel, unit = by_name.get(name, ("", ""))
            described = quality.describe(values) if missing < len(values) else Quality(np.nan, 0.0, np.nan, np.nan)
            found.append(InspectedChannel(name, opened.units[name], len(values), missing, rate, described, channel, unit))
    return found


def alike(file: Path, found: list[InspectedChannel]) -> list[Path]:
    """Return the file and those beside it of the same format that have its guessed columns, too, by name."""
    columns = {channel.name for channel in found if channel.guess}
    files = []
    for other in sorted(file.parent.glob(f"*{file.suffix}")):
        try:
            same = other == file or columns <= set(open_file(other).units)
        except CampaignError:
            continue
        if same:
            files.append(other)
    return files


def dead(found: list[InspectedChannel]) -> list[InspectedChannel]:
    """Return the wheel speeds and torques that never change while others do."""
    wheels = [channel for channel in found if channel.guess.endswith(("_wheel_speed", "_brake_torque"))]
    moving = any(channel.quality.highest > channel.quality.lowest for channel in found if channel.guess.endswith("_speed"))
    return [channel for channel in wheels if moving and channel.quality.highest == channel.quality.lowest]


def absent(found: list[InspectedChannel], axles: int) -> set[int]:
    """Return the axles without a wheel speed, where others have one; none where all are left out."""
    there = {_axle(channel) for channel in found if channel.guess.endswith("_wheel_speed")}
    return set(range(1, axles + 1)) - there if there else set()


def suspicions(found: list[InspectedChannel]) -> list[str]:
    """Say which channels of a single file look dead, each with what to do."""
    return [
        f"{channel.name} ({channel.guess}) never changes: dead, or a brake isolated; map another column to it, or give "
        f"missing_axles = [{_axle(channel)}] in [vehicle]"
        for channel in dead(found)
    ]


def _axle(channel: InspectedChannel) -> int:
    return int(channel.guess.removeprefix("axle").split("_")[0])


def draft(file: Path, found: list[InspectedChannel], runs: Sequence[Path] = (), folder: Path | None = None) -> str:
    """Return a campaign.toml to edit: what is known is filled in, what only a person can know is left out and asked for.

    Parameters
    ----------
    file, found : one file, and its channels
    runs : files of the campaign; none: the file and those like it beside it, see `alike`
    folder : that campaign.toml will stand in; None: that of the file

    """
    runs = runs or alike(file, found)
    stems = [run.stem for run in runs]
    places = {run: Path(os.path.relpath(run, folder or file.parent)).as_posix() for run in runs}
    named = {run: run.stem if stems.count(run.stem) == 1 else str(Path(places[run]).with_suffix("")) for run in runs}
    guesses = {channel.guess: channel for channel in found if channel.guess}
    axles = max((int(match[1]) for name in guesses if (match := re.match(r"axle(\d+)_", name))), default=4)
    rates = [channel.rate_hz for channel in found if channel.rate_hz and channel.guess]
    step = 1.0 / max(rates) if rates and max(rates) < 100.0 else 0.01
    pressures = any("pressure" in name for name in guesses) and not any("torque" in name for name in guesses)
    clocked = all(channel.rate_hz for channel in found)  # every channel brings its clock
    silent = sorted(
        {_axle(channel) for channel in dead(found) if channel.guess.endswith("_wheel_speed")} | absent(found, axles)
    )
    lines = [
        f"# Draft by `wsp inspect` from {file.name}. Lines with EDIT need you; check every guess.",
        "[campaign]",
        f"name = {json.dumps(file.stem)}",
        f"tune = {json.dumps(list(named.values()))}      # EDIT: runs to tune on",
        "validate = []             # EDIT: runs that are only scored",
        f"sample_time_s = {step:.4g}      # all channels are brought to this clock",
        "",
        "[vehicle]",
        f"axles = {axles}",
        "# axle_positions_m = [0.0, ...]     # behind the leading axle",
        "# mass_kg = ...                     # EDIT: required",
        "# wheelset_inertia_kgm2 = ...       # EDIT: required; 160 for a coach's wheelset with discs",
        "# wheel_radius_m = ...              # EDIT: required",
        *(
            [f"missing_axles = {silent}                # EDIT: no wheel speed found, or one that never changes"]
            if silent
            else []
        ),
        *(_FROM_PRESSURES if pressures else (MEASURED,)),
        "",
        "[contact]",
        'set = "velim"                       # the seed paper\'s Table 2; single values may be given instead',
        "",
        "[channels]",
    ]
    for name in channels.names(axles):
        kind = channels.channel(name)
        if name in guesses:
            entry = f"{{column = {json.dumps(guesses[name].name)}, unit = {json.dumps(guesses[name].guessed_unit)}}}"
            lines.append(f"{name} = {entry}   # guessed")
        elif kind.required and not (
            (name == "time" and clocked)
            or (pressures and name.endswith("brake_torque"))
            or any(name.startswith(f"axle{k}_") for k in silent)
        ):
            example = f'{{column = "...", unit = "{kind.unit}"}}'
            unless = ", or pressures and torque_per_bar_nm" if name.endswith("brake_torque") else ""
            lines.append(f"# {name} = {example}   # EDIT: required{unless}; none found")
    for run in runs:
        place = "# start_position_m = ...           # of the leading axle along the track; leave it out where nobody knows"
        lines += ["", f"[runs.{json.dumps(named[run])}]", f"file = {json.dumps(places[run])}", place]
    return "\n".join(lines) + "\n"


def _highest(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def _seconds(time: np.ndarray, source: Source) -> np.ndarray:
    return time * channels.factor(source.unit or "s", "time", 1.0, source.column)


def _rate(time: np.ndarray | None, samples: int) -> float | None:
    if time is None or len(time) != samples or samples < 3:
        return None
    try:
        return 1.0 / clock.repair(time, "")[0].step_s
    except CampaignError:
        return None
