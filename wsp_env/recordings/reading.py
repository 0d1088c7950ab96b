"""Reading one recorded stop: from a file of any format to a checked `Recording`."""

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings import missing, plausibility
from wsp_env.recordings.channels import Source
from wsp_env.recordings.columns import read_columns
from wsp_env.recordings.errors import CampaignWarning, ContradictionError
from wsp_env.recordings.recording import Recording

_OPTIONAL = ("wheel_load", "cylinder_pressure", "valve_command")


def read_recording(
    file: Path, blank: Recording, mapping: Mapping[str, Source], vehicle: CampaignVehicle, sample_time_s: float,
    refuse: bool = True,
) -> Recording:  # fmt: skip
    """Read and check one stop.

    Parameters
    ----------
    blank : what campaign.toml says of the run, without samples
    mapping : other people's columns, see `channels.parse`
    refuse : whether a channel in another unit, or of the wrong sign, is an error; otherwise the recording tells of it

    Torques are computed from pressures only where the file has none.

    Raises
    ------
    CampaignError
        naming file, column and row; a `CampaignWarning` is given for everything that was repaired

    """
    axles = range(1, vehicle.axles + 1)
    there = [k for k in axles if k not in blank.missing_axles]
    brakes = ("brake_torque", "cylinder_pressure") if vehicle.torque_per_bar_nm > 0.0 else ("brake_torque",)
    required = ["vehicle_speed", *(f"axle{k}_wheel_speed" for k in there)]
    optional = ["position", *(f"axle{k}_{channel}" for channel in ("wheel_speed", "brake_torque") for k in blank.missing_axles)]
    optional += [f"axle{k}_{channel}" for channel in _OPTIONAL for k in axles]
    alternatives = [[f"axle{k}_{channel}" for k in there] for channel in brakes]
    columns = read_columns(file, required, optional, mapping, sample_time_s, vehicle.wheel_radius_m, alternatives)
    from_pressure = not all(name in columns.values for name in alternatives[0])
    needed = ("wheel_speed", "cylinder_pressure" if from_pressure else "brake_torque")
    for name in (f"axle{k}_{channel}" for channel in needed for k in blank.missing_axles):
        if name not in columns.values:
            columns.values[name] = np.full(len(columns.time_s), np.nan)
            columns.suspect[name] = np.ones(len(columns.time_s), dtype=bool)
    wheel_speed, braked_by = (_stacked(columns.values, channel, vehicle.axles) for channel in needed)
    wheel_speed_suspect, braked_by_suspect = (_stacked(columns.suspect, channel, vehicle.axles) for channel in needed)
    suspect = wheel_speed_suspect | braked_by_suspect
    others = {channel: _stacked_if_all(columns.values, channel, vehicle.axles) for channel in _OPTIONAL}
    run = dataclasses.replace(
        blank,
        time_s=columns.time_s,
        vehicle_speed_mps=columns.values["vehicle_speed"],
        wheel_speed_radps=wheel_speed,
        brake_torque_nm=vehicle.torque_per_bar_nm * braked_by if from_pressure else braked_by,
        wheel_load_n=others["wheel_load"],
        torque_from_pressure=from_pressure,
        cylinder_pressure_bar=braked_by if from_pressure else others["cylinder_pressure"],
        valve_command=others["valve_command"],
        position_m=columns.values.get("position"),
        suspect=suspect | columns.suspect["vehicle_speed"][:, None],
    )
    run, said = missing.filled(run, blank.missing_axles, vehicle, str(file))
    found, contradiction = (*columns.notes, *said), None
    try:
        found += tuple(plausibility.check(run, vehicle, str(file)))
    except ContradictionError as error:
        if refuse:
            raise
        contradiction = error.with_traceback(None)
    for sentence in found:
        warnings.warn(sentence, CampaignWarning, stacklevel=3)
    suspect = run.suspect | plausibility.constant_torques(run)
    return dataclasses.replace(run, warnings=found, suspect=suspect, contradiction=contradiction)


def _stacked(values: dict[str, np.ndarray], channel: str, axles: int) -> np.ndarray:
    """Take one channel of every axle out of `values`: (T, axles)."""
    names = [f"axle{k}_{channel}" for k in range(1, axles + 1)]
    first = values[names[0]]
    stacked = np.empty((len(first), axles), dtype=first.dtype)
    for k, name in enumerate(names):
        stacked[:, k] = values.pop(name)  # a long recording fills half the memory
    return stacked


def _stacked_if_all(values: dict[str, np.ndarray], channel: str, axles: int) -> np.ndarray | None:
    """Return the same where every axle has the channel, else None."""
    complete = all(f"axle{k}_{channel}" in values for k in range(1, axles + 1))
    return _stacked(values, channel, axles) if complete else None
