"""How a parameter carries its unit, bounds and source, and how impossible values are refused."""

import dataclasses
import math
import re
import reprlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")


#: Characters of a line of a message, of which some quote what others wrote.
_LONGEST_LINE = 1000


class ParameterError(ValueError):
    """A parameter that does not exist or cannot be; the message says which, why, and what is possible."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


def readable(message: str) -> str:
    """Return a message without control characters, its lines cut in the middle where they are longer than a screen.

    Lines after the first begin with blanks; any other line break came along with what is quoted.
    """
    lines = re.split(r"\n(?=  )", message)
    return "\n".join(_cut("".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in line)) for line in lines)


def _cut(line: str) -> str:
    if len(line) <= _LONGEST_LINE:
        return line
    return f"{line[: _LONGEST_LINE * 2 // 3]} ... {line[-_LONGEST_LINE // 3 :]}"


def number(value: object) -> float:
    """Return a number as a float; nan for what is none, is not finite, or is beyond the floats."""
    if isinstance(value, str | bytes | bool | None):
        return math.nan
    try:
        found = float(value)  # type: ignore[arg-type]  # whatever it is
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return found if math.isfinite(found) else math.nan


def quantity(
    default: Any,
    unit: str,
    source: str,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
) -> Any:
    """Return a dataclass field with its unit, its source and the closed range [low, high] that makes sense.

    `open_low` excludes the lower bound itself (a mass must be above zero). The field may hold a number or a tuple of
    numbers.
    """
    metadata = {"unit": unit, "source": source, "low": low, "high": high, "open_low": open_low}
    return dataclasses.field(default=default, metadata=metadata)


class Checked:
    """Base of the frozen parameter records: every `quantity` field is checked against its range when made."""

    def __post_init__(self) -> None:
        """Raise `ParameterError` for a value that is not finite, lies outside its range, or is a tuple where none belongs."""
        for field in dataclasses.fields(self):  # type: ignore[arg-type]  # subclasses are dataclasses
            if "unit" in field.metadata:
                name, value = f"{type(self).__name__}.{field.name}", getattr(self, field.name)
                several = isinstance(field.default, tuple)
                if several and not isinstance(value, tuple):
                    raise ParameterError(f"{name} must be a list of numbers in {field.metadata['unit']}, got {shown(value)}")
                for number in value if several else (value,):
                    check(name, number, field.metadata)
                if several:  # a whole number would be another type to compiled code, which is then compiled for anew
                    object.__setattr__(self, field.name, tuple(map(float, value)))
                elif isinstance(field.default, float):
                    object.__setattr__(self, field.name, float(value))


def check(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    """Raise `ParameterError` unless `value` is a finite number in the range that `metadata` (of `quantity`) states."""
    low, high, unit = metadata["low"], metadata["high"], metadata["unit"]
    bracket = "(" if metadata["open_low"] else "["
    try:
        if isinstance(value, str | bytes | bool):  # which float() takes
            raise TypeError
        number = float(value)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be a number in {unit}, got {shown(value)}") from None
    except OverflowError:  # a whole number beyond the floats
        number = math.inf
    inside = low < number <= high if metadata["open_low"] else low <= number <= high
    if not math.isfinite(number) or not inside:
        raise ParameterError(
            f"{name} = {shown(value)} {unit} is impossible: it must be finite and in {bracket}{low:g}, {high:g}]"
        )


def shown(value: Any) -> str:
    """Return a value as a message shows it: no longer than a line, whatever it is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # Python writes out no whole number of so many digits
        return "a number of thousands of digits"


def replace(record: Record, changes: Mapping[str, object], what: str) -> Record:
    """Return `record` (a dataclass) with `changes`; an unknown name raises `ParameterError` listing the valid ones.

    A field that is itself a record takes a dictionary of changes; a field that is a tuple takes a list too, nested or not.
    """
    names = [field.name for field in dataclasses.fields(record) if field.init]
    unknown = sorted(set(map(str, changes)) - set(names))
    if unknown:
        raise ParameterError(f"unknown {what} {', '.join(map(str, unknown))}; valid: {', '.join(names)}")
    values = {}
    for name, value in changes.items():
        present = getattr(record, name)
        if dataclasses.is_dataclass(present) and not isinstance(present, type) and isinstance(value, Mapping):
            value = replace(present, dict(value), f"{what} {name}:")
        elif dataclasses.is_dataclass(present) and not isinstance(value, type(present)):
            raise ParameterError(f"{what} {name} = {shown(value)} must be a dictionary, {{name: value}}")
        elif isinstance(present, tuple):
            value = _tuples(value)
        values[name] = value
    return dataclasses.replace(record, **values)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value
