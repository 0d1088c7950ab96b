"""Which column of a third-party file may be which channel: by native and common names, by units and numbers."""

import re

from wsp_env.recordings import channels, units
from wsp_env.recordings.channels import CHANNELS, Source
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers.channel_file import ChannelFile

#: Words (beginnings of words) in names that speak for a channel, and the unit it has where none is stated.
_WORDS = {
    "wheel_speed": (("speed", "vel", "omega", "rpm", "drehz", "wheel"), "rad/s"),
    "brake_torque": (("torq", "moment", "mbr"), "N*m"),
    "cylinder_pressure": (("press", "bcp", "cyl", "zyl", "druck", "pbr"), "bar"),
    "wheel_load": (("load", "vertical", "last"), "N"),
    "valve_command": (("valve", "cmd", "command", "ventil", "dump"), ""),
    "vehicle_speed": (("speed", "vel", "geschw"), "m/s"),
    "position": (("pos", "dist", "chain", "weg"), "m"),
    "time": (("time", "zeit", "uhr", "timestamp"), "s"),
}

# Endings of names that are units; longer ones first.
_ENDINGS = {
    "radps": "rad/s", "rads": "rad/s", "kmph": "km/h", "kmh": "km/h", "kph": "km/h", "mph": "mph", "mps": "m/s", "rpm": "rpm",
    "mbar": "mbar", "bar": "bar", "kpa": "kPa", "psi": "psi", "knm": "kN*m", "nm": "N*m", "kn": "kN", "n": "N", "km": "km",
    "m": "m", "ms": "ms", "s": "s",
}  # fmt: skip

#: Letters that stand for a quantity where a number of an axle follows: "V_AXLE_1", "p_Zyl_1", "omega.3".
_LETTERS = {"wheel_speed": ("v", "n", "w", "om"), "brake_torque": ("m", "mb"), "cylinder_pressure": ("p",)}

_AXLE = re.compile(r"(?:axle|axl|ax|wheelset|wheel|ws|achse|rad|w|a)[ _.-]?(\d{1,2})(?!\d)", re.IGNORECASE)
_ALONE = {"time": ("t",), "vehicle_speed": ("v",)}  # letters that need no number
_LAST_NUMBER = re.compile(r"(?<=[A-Za-z_ .-])(\d{1,2})$")
_BY_UNIT = ("wheel_speed", "brake_torque", "cylinder_pressure")  # what a unit and a number in the name may speak for
_MOST_DIGITS = 4  # of an axle's number: a damaged name may have thousands
_MOST_AXLES = 8
_ALIKE = (0.8, 1.25)  # highest wheel speed over the vehicle's where both have one unit; wheels slide, tyres wear

#: A vehicle speed without unit above this is taken for km/h.
FASTEST_MPS = 60.0


def guess(opened: ChannelFile, highest: dict[str, float]) -> dict[str, Source]:
    """Guess which column is which channel, from native and common names and the units in them; the first that fits is taken."""
    guessed: dict[str, Source] = {}
    used = set()
    for by_unit in (False, True):  # names first; what they leave open, units and numbers may tell
        for column, stated in opened.units.items():
            if column not in highest or column in used:
                continue
            unit = stated or _ending(column)
            name = _measured(column, unit) if by_unit else named(column, unit)
            if not name or name in guessed:
                continue
            kind = name.split("_", 1)[1] if name.startswith("axle") else name
            if kind == "wheel_speed" and unit in units.TURNS:
                unit = "rpm"
            if not unit:
                unit = _WORDS[kind][1]
                if name == "vehicle_speed" and highest[column] > FASTEST_MPS:
                    unit = "km/h"
            guessed[name] = Source(column, unit)
            used.add(column)
    return _as_the_vehicle(guessed, opened, highest)


def _as_the_vehicle(guessed: dict[str, Source], opened: ChannelFile, highest: dict[str, float]) -> dict[str, Source]:
    """Give wheel speeds without a unit that of the vehicle's speed where they reach the same number."""
    vehicle = guessed.get("vehicle_speed")
    found = dict(guessed)
    for name, source in guessed.items():
        unstated = not opened.units[source.column] and not _ending(source.column)
        if vehicle is not None and name.endswith("_wheel_speed") and unstated and highest[vehicle.column] > 0.0:
            ratio = highest[source.column] / highest[vehicle.column]
            if _ALIKE[0] < ratio < _ALIKE[1]:
                found[name] = Source(source.column, vehicle.unit)
    return found


def named(column: str, unit: str) -> str:
    """Name the channel that a column may be, "" for none."""
    for name, kind in CHANNELS.items():
        pattern = re.escape(kind.column).replace(r"\{k\}", rf"(\d{{1,{_MOST_DIGITS}}})")
        if match := re.fullmatch(pattern, column):
            return name.replace("{k}", match[1]) if match.groups() else name
    leaf = re.sub(r"\.(\d+)$", r"_\1", column).rsplit(".", 1)[-1]  # of structures, `data.t`; columns of matrices, `omega.1`
    words = [word.lower() for word in re.findall(r"[A-Za-z]+?(?=[A-Z][a-z]|\d|[^A-Za-z]|$)", leaf)]
    axle = _AXLE.search(leaf) or _LAST_NUMBER.search(re.sub(r"\s*[\[(].*", "", leaf))
    if axle and not _is_axle(axle[1]):
        axle = None
    for kind_name, (beginnings, _) in _WORDS.items():
        name = f"axle{axle[1]}_{kind_name}" if axle and f"axle{{k}}_{kind_name}" in CHANNELS else kind_name
        if name not in CHANNELS and not name.startswith("axle"):
            continue
        if axle and not name.startswith("axle"):
            continue
        letters = _ALONE.get(kind_name, ()) or (_LETTERS.get(kind_name, ()) if axle else ())
        spoken = any(word.startswith(beginnings) for word in words) or words[:1] in [[letter] for letter in letters]
        if spoken and _fits(unit, name):
            return name
    return ""


def _measured(column: str, unit: str) -> str:
    """Name the channel that a column may be by its unit and the last number in its name, "" for none."""
    if not unit:
        return ""
    number = re.search(r"(\d+)\D*$", re.sub(r"[\[(].*", "", column))
    if not number:
        return "vehicle_speed" if _fits(unit, "vehicle_speed") else ""
    names = [f"axle{int(number[1])}_{kind}" for kind in _BY_UNIT] if _is_axle(number[1]) else []
    return next((name for name in names if _fits(unit, name)), "")


def _is_axle(digits: str) -> bool:
    return len(digits) <= _MOST_DIGITS and 1 <= int(digits) <= _MOST_AXLES


def _fits(unit: str, name: str) -> bool:
    if not unit or (unit in units.TURNS and name.endswith("_wheel_speed")):
        return True
    try:
        channels.factor(unit, name, 1.0, "")
    except CampaignError:
        return False
    return True


def _ending(column: str) -> str:
    last = re.split(r"[ _.\-]", column.lower())[-1]
    return _ENDINGS.get(last, "")
