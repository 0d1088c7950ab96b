"""Vehicles as TOML files: reading with one error for every fault, and writing with unit and source behind each value.

The keys are the fields of `Vehicle`; `[contact]`, `[brake]` and `[tachometer]` hold those of its parts. `REQUIRED` must be
there, what else is left out takes the field's default, the coach's. `wsp vehicle show coach > mine.toml` is where to start.
"""

import dataclasses
import difflib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsp_env.contact.port import LAWS
from wsp_env.parameters.document import DocumentError, read_toml
from wsp_env.parameters.quantity import ParameterError, check, replace, shown
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle

#: Keys that a file must have: what no vehicle has in common with another.
REQUIRED = ("name", "axle_positions_m", "mass_kg", "wheelset_inertia_kgm2", "wheel_radius_m")

_WIDTH = 110  # of a list of numbers before it is broken into lines
_WHAT = {
    "name": "what it is called",
    "bodies": "axles of each bogie, body by body from the front",
    "traction_law": f"contact law, one of {', '.join(LAWS)}",
}


def find_vehicle(given: str | os.PathLike[str] | Mapping[str, Any], base: Vehicle | None = None) -> Vehicle:
    """Return a vehicle by its name, from its file, or as `base` with other values {field: value}.

    This is what every option `vehicle` takes; a name goes before a file of the same name (./coach is the file).

    Raises
    ------
    ParameterError
        for a name that none has, a file or values that cannot be, values without a `base`

    """
    if isinstance(given, Mapping):
        if base is None:
            raise ParameterError(f"vehicle = {shown(given)} must be a name ({', '.join(VEHICLES)}) or a vehicle file")
        changed: Vehicle = replace(base, dict(given), "vehicle parameter")
        return changed
    if isinstance(given, str) and given in VEHICLES:
        return VEHICLES[given]
    if isinstance(given, os.PathLike) or (isinstance(given, str) and _names_a_file(given)):
        return read_vehicle(Path(given))
    raise ParameterError(
        f"unknown vehicle {shown(given)}; valid: {', '.join(VEHICLES)}, or a vehicle file such as mine.toml "
        "(wsp vehicle show coach > mine.toml writes one)"
    )


def _names_a_file(text: str) -> bool:
    return text.endswith(".toml") or os.sep in text or os.path.exists(text)


def read_vehicle(path: str | os.PathLike[str]) -> Vehicle:
    """Return the vehicle of a file.

    Raises
    ------
    ParameterError
        naming the file and, one to a line, every fault: key, what is wrong with it, what would be right

    """
    document = _document(path)
    faults: list[str] = []
    values = _values("", Vehicle, document, faults)
    faults += [f"{key} is missing; add {_added(key)}" for key in REQUIRED if key not in document]
    vehicle = _made(Vehicle, values, faults) if not faults else None
    if vehicle is None:
        lines = faults[0] if len(faults) == 1 else f"{len(faults)} faults\n  " + "\n  ".join(faults)
        raise ParameterError(f"vehicle file {path}: {lines}")
    return vehicle


def left_out(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the keys that a file leaves to the defaults, as `mass_kg` or `brake.dead_time_s`; `ParameterError` for no TOML."""
    document, found = _document(path), []
    for field in dataclasses.fields(Vehicle):
        part = _part(field)
        if part is None:
            found += [field.name] if field.name not in document else []
        else:
            given = document.get(field.name, {})
            found += [f"{field.name}.{own.name}" for own in dataclasses.fields(part) if own.name not in given]
    return tuple(found)


def write_vehicle(vehicle: Vehicle) -> str:
    """Return a vehicle as the text of its file; reading it again gives exactly the same."""
    lines = [
        "# A vehicle for wsp-env: `wsp vehicle check FILE` says what it is, `--vehicle FILE` brakes with it.",
        f"# Needed: {', '.join(REQUIRED)}. What else is left out is as the coach's.",
        "",
        *(_line(vehicle, field) for field in dataclasses.fields(Vehicle) if _part(field) is None),
    ]
    for field in dataclasses.fields(Vehicle):
        if part := _part(field):
            record = getattr(vehicle, field.name)
            lines += ["", f"[{field.name}]", *(_line(record, own) for own in dataclasses.fields(part))]
    return "\n".join(lines) + "\n"


def _document(path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        return read_toml(Path(path))
    except DocumentError as error:
        advice = "; wsp vehicle show coach > mine.toml writes one" if "cannot be read" in str(error) else ""
        raise ParameterError(f"vehicle file {path} {error}{advice}") from None


def _part(field: "dataclasses.Field[Any]") -> type | None:
    """Return the record that a field of `Vehicle` holds, if it holds one."""
    made = field.default_factory
    return made if isinstance(made, type) and dataclasses.is_dataclass(made) else None


def _values(section: str, record: type, table: dict[str, Any], faults: list[str]) -> dict[str, Any]:
    """Return the values of a table for its record; what is wrong with them goes to `faults`."""
    where = f"[{section}] " if section else ""
    fields = {field.name: field for field in dataclasses.fields(record)}
    values: dict[str, Any] = {}
    for key, given in table.items():
        if key not in fields:
            close = difflib.get_close_matches(key, fields, 1)
            meant = f"did you mean {close[0]}? " if close else ""
            faults.append(f"{where}unknown key {shown(key)}; {meant}valid: {', '.join(fields)}")
            continue
        part = _part(fields[key])
        if part is not None:
            if not isinstance(given, dict):
                faults.append(f"{key} = {shown(given)} must be a table: write [{key}] on a line of its own, its keys below")
                continue
            before = len(faults)
            own = _values(key, part, given, faults)
            values[key] = _made(part, own, faults) if len(faults) == before else None
            continue
        try:
            values[key] = _value(where + key, fields[key], given)
        except ParameterError as error:
            faults.append(str(error))
    return values


def _value(name: str, field: "dataclasses.Field[Any]", given: Any) -> Any:
    """Return one value as its field takes it; `ParameterError` for what it cannot be."""
    if field.name in ("name", "traction_law"):
        if not isinstance(given, str) or not given.strip():
            example = "mine" if field.name == "name" else field.default
            raise ParameterError(f'{name} = {shown(given)} must be a text in quotes, such as "{example}"')
        return given
    if field.name == "bodies":  # checked against the axles when the vehicle is made
        if not isinstance(given, list) or not all(isinstance(body, list) for body in given):
            raise ParameterError(
                f"bodies = {shown(given)} must be a list of lists: [[2, 2]] is a coach on two bogies of two axles"
            )
        return tuple(tuple(body) for body in given)
    if not isinstance(field.default, tuple):
        check(name, given, field.metadata)
        return given
    if not isinstance(given, list):
        raise ParameterError(
            f"{name} = {shown(given)} must be a list of numbers in {field.metadata['unit']}, such as [0.0, 2.56]"
        )
    for number, value in enumerate(given, start=1):
        check(f"{name}, number {number},", value, field.metadata)
    return tuple(given)


def _made(record: type, values: dict[str, Any], faults: list[str]) -> Any:
    try:
        return record(**values)
    except ParameterError as error:
        faults.append(str(error))
        return None


def _added(key: str) -> str:
    field = Vehicle.__dataclass_fields__[key]
    return f"it in {field.metadata['unit']}" if "unit" in field.metadata else f'{key} = "..."'


def _line(record: Any, field: "dataclasses.Field[Any]") -> str:
    """Return a key, its value, and as a comment its unit and the source of the default."""
    value = getattr(record, field.name)
    if field.name == "bodies" and not value:
        usual = _toml(record.running_gear, math.inf)
        return f"# bodies = {usual}  # {_WHAT['bodies']}; left out: these, the usual ones (assumption)"
    if field.name in _WHAT:
        return f"{field.name} = {_toml(value)}  # {_WHAT[field.name]}"
    unit, source = field.metadata["unit"], field.metadata["source"]
    if value != field.default and not isinstance(value, tuple):
        source = f"state your source (the default, {_toml(field.default)}: {source})"
    return f"{field.name} = {_toml(value)}  # [{unit}] {source}"


def _toml(value: Any, width: float = _WIDTH) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if not isinstance(value, tuple):
        return repr(int(value) if isinstance(value, int) else float(value))  # numpy's numbers too
    items = [_toml(one, math.inf) for one in value]
    text = f"[{', '.join(items)}]"
    if len(text) <= width:
        return text
    lines: list[str] = [""]
    for item in items:
        if len(lines[-1]) + len(item) > width:
            lines.append("")
        lines[-1] += f"{' ' if lines[-1] else ''}{item},"
    return "[\n  " + "\n  ".join(lines) + "\n]"
