"""From a folder of recorded files to a campaign.toml: which files are stops of one logger, which tune and which validate."""

import dataclasses
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.parameters.vehicle import Vehicle
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.inspection import InspectedChannel, draft, inspect
from wsp_env.recordings.readers import FORMATS
from wsp_env.recordings.sliding import slid

#: What a draft must say of the vehicle, with what it is; the last only where pressures stand for torques.
ASKED = {
    "mass_kg": "mass of the vehicle as tested [kg]",
    "wheelset_inertia_kgm2": "moment of inertia of a wheelset about its axle [kg m2]",
    "wheel_radius_m": "wheel radius [m]",
    "torque_per_bar_nm": "brake torque of a wheelset for one bar in its cylinders [N m/bar]",
}

_MOST_FILES = 500  # of a folder that are looked at
_VALIDATES = 3  # one run of so many validates, and one at least


@dataclasses.dataclass(frozen=True)
class Found:
    """What is in a folder."""

    runs: tuple[Path, ...]  # with the same columns, by how much their wheels slide
    channels: list[InspectedChannel]  # of the first of them
    left: dict[Path, str]  # file -> why it is no run


def find(folder: Path) -> Found:
    """Look at all files of known formats in a folder and below; `CampaignError` where none is a recorded stop."""
    suffixes = {suffix for group in FORMATS for suffix in group}
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in suffixes and file.is_file())
    if not files:
        raise CampaignError(f"{folder} holds no file of a known format ({', '.join(sorted(suffixes))})")
    if len(files) > _MOST_FILES:
        raise CampaignError(
            f"{folder} holds {len(files)} files, more than {_MOST_FILES}: name a folder with one campaign's stops"
        )
    left: dict[Path, str] = {}
    inspected = {}
    for file in files:
        try:
            inspected[file] = inspect(file)
        except CampaignError as error:
            left[file] = str(error)
    groups: dict[frozenset[tuple[str, str]], list[Path]] = {}
    for file, channels in inspected.items():
        guessed = {channel.guess: channel for channel in channels if channel.guess}
        if "vehicle_speed" not in guessed or not any(name.endswith("_wheel_speed") for name in guessed):
            left[file] = f"{file}: no speed of a vehicle with those of its wheels was found in it"
            continue
        groups.setdefault(frozenset((name, channel.name) for name, channel in guessed.items()), []).append(file)
    if not groups:
        raise CampaignError(next(iter(left.values())))
    chosen = max(groups.values(), key=len)
    for group in groups.values():
        if group is not chosen:
            others = f"its columns are others than those of {chosen[0].name}; it can be added to campaign.toml by hand"
            left |= {file: f"{file}: {others}" for file in group}
    runs = tuple(sorted(chosen, key=lambda file: (_slid(file, inspected[file]), _speed(inspected[file]), file)))
    return Found(runs, inspected[runs[0]], left)


def split(runs: tuple[Path, ...]) -> tuple[list[Path], list[Path]]:
    """Return which runs tune and which validate: a third of them validates, spread evenly over their order.

    Runs come in the order of their sliding. Both groups then have gentle stops and hard ones; the run that slides most, which
    says most of tau, tunes.
    """
    count = max(len(runs) // _VALIDATES, 1) if len(runs) > 1 else 0
    validate = [runs[(one + 1) * (len(runs) - 1) // (count + 1)] for one in range(count)]
    return [run for run in runs if run not in validate], validate


def in_order(runs: Sequence[Path]) -> list[Path]:
    """Return runs as they were made, by their names, of which the numbers count: a campaign lists its runs in that order."""

    def parts(run: Path) -> list[tuple[str, int]]:
        return [(words.casefold(), int(digits or -1)) for words, digits in re.findall(r"(\D*)(\d{0,18})", str(run))]

    return sorted(runs, key=parts)


def write(found: Found, folder: Path, known: Mapping[str, Any]) -> str:
    """Return the campaign.toml of a folder.

    Parameters
    ----------
    folder : that it will stand in, and that the campaign is called after
    known : of the vehicle: what is `ASKED` for, and what else of [vehicle] is known; positions of another number of axles than
        the recordings have are left out

    """
    tune, validate = map(in_order, split(found.runs))
    text = draft(found.runs[0], found.channels, in_order(found.runs), folder)
    text = text.replace(f"\nname = {json.dumps(found.runs[0].stem)}\n", f"\nname = {json.dumps(folder.resolve().name)}\n", 1)
    names = run_names(found.runs, folder)
    for key, group in (("tune", tune), ("validate", validate)):
        start = text.index(f"\n{key} = ") + 1
        listed = ", ".join(f'"{names[run]}"' for run in group)
        rest = text[text.index("\n", start) + 1 :]
        text = f"{text[:start]}{key} = [{listed}]   # a third validates, spread over how much the wheels slide\n{rest}"
    return with_vehicle(text, known)


def with_vehicle(text: str, known: Mapping[str, Any]) -> str:
    """Return a draft with what is known of its vehicle, as `write` takes it."""
    axles = int(re.findall(r"^axles = (\d+)$", text, re.MULTILINE)[0])
    for key, value in known.items():
        start = text.find(f"\n# {key} = ") + 1
        if (key == "axle_positions_m" and len(value) != axles) or (key == "bodies" and sum(map(sum, value)) != axles):
            continue
        if start:
            text = f"{text[:start]}{key} = {value!r}\n{text[text.index(chr(10), start) + 1 :]}"
        elif key not in ASKED:
            text = text.replace("\n\n[contact]\n", f"\n{key} = {value!r}\n\n[contact]\n", 1)
    return text


def run_names(runs: tuple[Path, ...], folder: Path) -> dict[Path, str]:
    """Return a name for each run: its file's, with its folder where two files are called the same."""
    stems = [run.stem for run in runs]
    relative = {run: Path(os.path.relpath(run, folder)).with_suffix("").as_posix() for run in runs}
    return {run: run.stem if stems.count(run.stem) == 1 else relative[run] for run in runs}


def of_vehicle(vehicle: Vehicle) -> dict[str, Any]:
    """Return what a draft takes from a described vehicle."""
    resistance = [vehicle.resistance_a_n, vehicle.resistance_b_ns_per_m, vehicle.resistance_c_ns2_per_m2]
    return {
        "axle_positions_m": list(vehicle.axle_positions_m),
        **({"bodies": [list(body) for body in vehicle.bodies]} if vehicle.bodies else {}),
        "gravity_mps2": vehicle.gravity_mps2,
        **({"resistance_n": resistance} if any(resistance) else {}),
        "mass_kg": vehicle.mass_kg,
        "wheelset_inertia_kgm2": vehicle.wheelset_inertia_kgm2,
        "wheel_radius_m": vehicle.wheel_radius_m,
        "torque_per_bar_nm": vehicle.brake.torque_per_bar_nm,
    }


def open_questions(text: str) -> list[str]:
    """Return what a draft still asks for."""
    return [key for key in ASKED if f"\n# {key} = ..." in text]


def unused(channels: list[InspectedChannel]) -> list[str]:
    """Return the columns that no channel was found for."""
    return [channel.name for channel in channels if not channel.guess]


def _slid(file: Path, channels: list[InspectedChannel]) -> float:
    try:
        return slid(file, channels)
    except CampaignError:  # its samples are damaged, which is said when the campaign is read
        return 0.0


def _speed(channels: list[InspectedChannel]) -> float:
    highest = next(channel.quality.highest for channel in channels if channel.guess == "vehicle_speed")
    return float(np.nan_to_num(highest))
