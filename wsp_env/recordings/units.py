"""Units as files and test teams write them, converted by pint."""

import functools
import re
from typing import TYPE_CHECKING

from wsp_env.recordings.errors import CampaignError

if TYPE_CHECKING:  # pint takes 0.3 s and is needed for other people's units only
    from pint import Unit, UnitRegistry

# Units as test teams write them, which pint does not know or takes for something else.
_SPELLINGS = {
    "nm": "N*m",
    "knm": "kN*m",
    "n m": "N*m",
    "kn m": "kN*m",
    "kmh": "km/h",
    "km/hr": "km/h",
    "sec": "s",
    "u/min": "rpm",
    "-": "",
}

#: Units that files state for turns, though they may mean radians: never taken for either without a word in `[channels]`.
TURNS = ("1/min", "min-1", "min^-1", "/min")


def is_unit(text: str) -> bool:
    """Whether the text is a unit that can be converted."""
    try:
        _unit(text, "")
    except CampaignError:
        return False
    return True


def stated_unit(name: str) -> str:
    """Return the unit in a name such as "Speed [km/h]" or "Pressure (bar)"."""
    match = re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name)
    return match[1].strip() if match else ""


def conversion(given: str, target: str, what: str, where: str) -> float:
    """Return what a value in the unit `given` is multiplied with to stand in the unit `target`.

    Parameters
    ----------
    what : what has the unit `target`, for the message
    where : file and column, with which the message begins

    Raises
    ------
    CampaignError
        for an unknown unit or one of another dimension

    """
    if given == target:
        return 1.0
    unit, wanted = _unit(given, where), _registry().Unit(target)
    if not unit.is_compatible_with(wanted):
        raise CampaignError(
            f"{where}: {given!r} is a unit of {_dimension(unit)}, but {what} is one of {_dimension(wanted)} "
            f"({target or 'no unit'})"
        )
    return float(_registry().Quantity(1.0, unit).to(wanted).magnitude)


def is_compatible(unit: str, other: str, where: str) -> bool:
    """Whether a unit has the dimension of another one; `CampaignError` for an unknown unit."""
    return bool(_unit(unit, where).is_compatible_with(other))


def counts_radians(unit: str, where: str) -> bool:
    """Whether a unit of angular speed says which angle it counts; `CampaignError` for an unknown unit."""
    return "radian" in str(_registry().get_root_units(_unit(unit, where))[1])


@functools.cache
def _registry() -> "UnitRegistry[float]":
    import pint

    return pint.UnitRegistry()


@functools.cache
def _unit(text: str, where: str) -> "Unit":
    spelled = _SPELLINGS.get(text.strip().lower(), text.strip())
    for spelling in (spelled, spelled.lower()):
        try:
            unit = _registry().Unit(spelling)
            _registry().Quantity(1.0, unit).to_base_units()
            return unit
        except Exception:  # pint raises its own, tokenizer's, and attribute errors on text that is no unit
            continue
    raise CampaignError(f'{where}: {text!r} is no unit known; write it as "km/h", "bar", "N*m", "rpm", "ms"')


def _dimension(unit: "Unit") -> str:
    return str(unit.dimensionality) if not unit.dimensionless else "no dimension"
