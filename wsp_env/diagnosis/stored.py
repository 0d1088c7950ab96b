"""A diagnosis read from its diagnosis.json."""

import dataclasses
import types
import typing
from pathlib import Path
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.parameters.document import DocumentError, read_json
from wsp_env.recordings import CampaignError


def read_diagnosis(file: Path) -> Diagnosis:
    """Return the diagnosis of recorded stops in a diagnosis.json.

    Raises
    ------
    CampaignError
        if the file contains none, or one in the format of another version

    """
    try:
        found = _made(Diagnosis, read_json(file))
    except (DocumentError, TypeError, KeyError, ValueError, AttributeError) as error:
        raise CampaignError(f"{file} holds no diagnosis of recorded stops: {error}") from None
    assert isinstance(found, Diagnosis)
    return found


def _made(kind: Any, value: Any) -> Any:
    """Convert plain data to the type of a hint: a dataclass, a tuple, a dictionary of dataclasses, or unchanged."""
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        hints = typing.get_type_hints(kind)
        return kind(**{name: _made(hints[name], item) for name, item in value.items()})
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _made(next(one for one in inside if one is not type(None)), value)
    if origin is tuple:
        of = inside[:1] * len(value) if len(inside) == 2 and inside[1] is Ellipsis else inside
        return tuple(_made(one, item) for one, item in zip(of, value, strict=True))
    if origin is dict and dataclasses.is_dataclass(inside[1]):
        return {key: _made(inside[1], item) for key, item in value.items()}
    return value
