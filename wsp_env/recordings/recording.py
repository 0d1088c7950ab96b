"""One recorded stop, as the rest of the package uses it."""

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.channels import Source
from wsp_env.recordings.reading import read_columns
from wsp_env.recordings.table import CampaignWarning

_OPTIONAL = ("wheel_load", "cylinder_pressure", "valve_command")


@dataclasses.dataclass(frozen=True)
class Recording:
    """One recorded stop; T samples at the campaign's sample time."""

    name: str
    time_s: np.ndarray  # (T,) [s]
    vehicle_speed_mps: np.ndarray  # (T,) [m/s]
    wheel_speed_radps: np.ndarray  # (T, axles) [rad/s]
    brake_torque_nm: np.ndarray  # (T, axles) [Nm] per wheelset, positive in braking
    start_position_m: float  # [m] of the leading axle along the track
    mass_kg: float  # [kg] of the whole vehicle in this run
    kinetic_friction_d: float  # [-] mu_cd as believed by the test team
    gradient: float = 0.0  # [-] rise per metre, positive uphill
    direction: str = ""
    notes: str = ""
    wheel_load_n: np.ndarray | None = None  # (T, axles) [N], where recorded on every axle; so the next two
    cylinder_pressure_bar: np.ndarray | None = None
    valve_command: np.ndarray | None = None  # -1 vent, 0 hold, 1 apply
    position_m: np.ndarray | None = None  # (T,) [m]
    suspect: np.ndarray | None = None  # (T, axles) bool: mended samples, never compared with the law; None: none
    warnings: tuple[str, ...] = ()  # what was mended or looks wrong, and where


def read_recording(
    file: Path, blank: Recording, mapping: Mapping[str, Source], vehicle: CampaignVehicle, sample_time_s: float
) -> Recording:
    """Read and check one stop.

    Parameters
    ----------
    blank : what campaign.toml says of the run, without samples
    mapping : other people's columns, see `channels.parse`

    Raises
    ------
    CampaignError
        naming file, column and row; a `CampaignWarning` is given for everything that was mended

    """
    from_pressure = vehicle.torque_per_bar_nm > 0.0
    needed = ("wheel_speed", "cylinder_pressure" if from_pressure else "brake_torque")
    axles = range(1, vehicle.axles + 1)
    required = ["vehicle_speed", *(f"axle{k}_{channel}" for channel in needed for k in axles)]
    optional = ["position", *(f"axle{k}_{channel}" for channel in _OPTIONAL if channel not in needed for k in axles)]
    columns = read_columns(file, required, optional, mapping, sample_time_s, vehicle.wheel_radius_m)
    stacked = {channel: _stacked(columns.values, channel, vehicle.axles) for channel in dict.fromkeys((*needed, *_OPTIONAL))}
    torque = vehicle.torque_per_bar_nm * stacked["cylinder_pressure"] if from_pressure else stacked["brake_torque"]
    suspect = _stacked(columns.suspect, needed[0], vehicle.axles) | _stacked(columns.suspect, needed[1], vehicle.axles)
    run = dataclasses.replace(
        blank,
        time_s=columns.time_s,
        vehicle_speed_mps=columns.values["vehicle_speed"],
        wheel_speed_radps=stacked["wheel_speed"],
        brake_torque_nm=torque,
        wheel_load_n=stacked["wheel_load"],
        cylinder_pressure_bar=stacked["cylinder_pressure"],
        valve_command=stacked["valve_command"],
        position_m=columns.values.get("position"),
        suspect=suspect | columns.suspect["vehicle_speed"][:, None],
    )
    from wsp_env.recordings import plausibility  # it takes a recording

    found = (*columns.notes, *plausibility.check(run, vehicle, str(file)))
    for sentence in found:
        warnings.warn(sentence, CampaignWarning, stacklevel=3)
    return dataclasses.replace(run, warnings=found, suspect=run.suspect | plausibility.constant_torques(run))


def _stacked(values: dict[str, np.ndarray], channel: str, axles: int) -> Any:
    """Take one channel of every axle out of `values`: (T, axles), or None where an axle lacks it."""
    names = [f"axle{k}_{channel}" for k in range(1, axles + 1)]
    if not all(name in values for name in names):
        return None
    first = values[names[0]]
    stacked = np.empty((len(first), axles), dtype=first.dtype)
    for k, name in enumerate(names):
        stacked[:, k] = values.pop(name)  # a long recording fills half the memory
    return stacked
