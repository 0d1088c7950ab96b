"""What is recorded: the channels, their SI columns, and other people's columns and units mapped to them.

`[channels]` in campaign.toml maps a channel to a column of the files:

    vehicle_speed = {column = "FS_SPEED_KPH", unit = "km/h"}
    axle1_cylinder_pressure = {column = "BCP_M_AXLE1_IN_BAR", unit = "bar"}

`unit` may be left out where the file states it; `scale` multiplies the values (-1 for a torque counted negative in
braking, 2 for a torque per wheel); `time` names the column of the channel's own clock where the file has several.
A channel that is not mapped is looked for under its native column (`CHANNELS`), in SI.
"""

import dataclasses
import re
from pathlib import Path

from wsp_env.parameters.quantity import number, shown
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.units import conversion, counts_radians, is_compatible


@dataclasses.dataclass(frozen=True)
class Channel:
    """One kind of channel; `{k}` in a name stands for the axle, from 1."""

    column: str  # native column, whose ending says the unit
    unit: str  # SI unit (pressure: bar) that recordings are kept in
    fastest: float  # [unit/s] a change faster than this, and back, is a fault of the recorder
    required: bool = False


# The fastest changes are assumptions: far above what a vehicle of some 10 t per axle can do (5 m/s2; C / J = 40 rad/s2 for
# a wheel in the air; a brake cylinder that empties in 0.2 s), far below what a lost sample looks like.
CHANNELS = {
    "time": Channel("time_s", "s", float("inf"), required=True),
    "vehicle_speed": Channel("vehicle_speed_mps", "m/s", 30.0, required=True),
    "position": Channel("position_m", "m", 500.0),
    "axle{k}_wheel_speed": Channel("axle{k}_wheel_speed_radps", "rad/s", 500.0, required=True),
    "axle{k}_brake_torque": Channel("axle{k}_brake_torque_nm", "N m", 1e6, required=True),
    "axle{k}_wheel_load": Channel("axle{k}_wheel_load_n", "N", 1e7),
    "axle{k}_cylinder_pressure": Channel("axle{k}_cylinder_pressure_bar", "bar", 300.0),
    "axle{k}_valve_command": Channel("axle{k}_valve_command", "", float("inf")),
}

_KEYS = ("column", "unit", "scale", "time")


@dataclasses.dataclass(frozen=True)
class Source:
    """Where a channel comes from."""

    column: str
    unit: str | None = None  # None: as the file states
    scale: float = 1.0
    time: str | None = None  # column of its own clock


def channel(name: str) -> Channel:
    """Return the kind of a channel such as `axle2_brake_torque`."""
    return CHANNELS[re.sub(r"^axle\d+_", "axle{k}_", name)]


def native(name: str) -> Source:
    """Return where a channel stands in the native format."""
    kind = channel(name)
    axle = re.match(r"axle(\d+)_", name)
    return Source(kind.column.replace("{k}", axle[1] if axle else ""), kind.unit)


def names(axles: int) -> list[str]:
    """Return the names of all channels of a vehicle."""
    once = [name for name in CHANNELS if "{k}" not in name]
    each = [name for name in CHANNELS if "{k}" in name]
    return once + [name.replace("{k}", str(k)) for k in range(1, axles + 1) for name in each]


def parse(path: Path, table: object, axles: int) -> dict[str, Source]:
    """Read `[channels]`.

    Raises
    ------
    CampaignError
        for an unknown channel or key, a value of another kind, a unit that does not exist or is of another dimension

    """
    if not isinstance(table, dict):
        raise CampaignError(
            f'{path}: [channels] must be a table such as time = {{column = "t", unit = "s"}}, got {shown(table)}'
        )
    valid = names(axles)
    sources = {}
    for name, entry in table.items():
        if name not in valid:
            raise CampaignError(f"{path}: unknown channel {name} in [channels]; valid: {', '.join(valid)}")
        if isinstance(entry, str):
            entry = {"column": entry}
        if not isinstance(entry, dict) or not isinstance(entry.get("column"), str):
            raise CampaignError(f'{path}: [channels] {name} must name a column, such as {{column = "x", unit = "m/s"}}')
        if unknown := sorted(set(entry) - set(_KEYS)):
            raise CampaignError(f"{path}: unknown key {', '.join(unknown)} in [channels] {name}; valid: {', '.join(_KEYS)}")
        scale = entry.get("scale", 1.0)
        if not abs(number(scale)) > 0.0:
            raise CampaignError(f"{path}: [channels] {name} scale must be a finite number other than 0, got {shown(scale)}")
        for key in ("unit", "time"):
            if not isinstance(entry.get(key, ""), str):
                raise CampaignError(f"{path}: [channels] {name} {key} must be text, got {shown(entry[key])}")
        source = Source(entry["column"], entry.get("unit"), float(scale), entry.get("time"))
        if source.unit is not None:
            factor(source.unit, name, 1.0, f"{path}: [channels] {name}")
        sources[name] = source
    return sources


def factor(unit: str, name: str, wheel_radius_m: float, where: str) -> float:
    """Return what a value in `unit` is multiplied with to stand in the channel's own unit.

    A wheel speed may also be given as a speed: that of the circumference, at the believed wheel radius.

    Raises
    ------
    CampaignError
        beginning with `where`, for an unknown unit, one of another dimension, or an ambiguous one

    """
    target = channel(name).unit
    if unit == target:
        return 1.0
    if name.endswith("_wheel_speed"):
        if is_compatible(unit, "1/s", where) and not counts_radians(unit, where):
            raise CampaignError(f'{where}: {unit!r} may mean turns or radians; write "rpm", "turn/s", "deg/s" or "rad/s"')
        if is_compatible(unit, "m/s", where):
            return conversion(unit, "m/s", "the speed of the circumference", where) / wheel_radius_m
    return conversion(unit, target, f"the channel {name}", where)
