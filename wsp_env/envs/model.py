"""A tuned model from a file, as `wsp diagnose` writes it: the law and the mechanisms that recordings asked for."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsp_env.parameters.quantity import ParameterError

_KEYS = {"tau_m_per_J": float, "mu_cd": Mapping, "contact": Mapping, "mechanisms": Mapping}


def read_model(path: str) -> dict[str, dict[str, Any]]:
    """Return what a model file means for an environment: options `vehicle`, `mechanisms` and `scenario` of `Task`.

    The file is JSON with `tau_m_per_J` [m/J], `mu_cd` {run: value} [-], `contact` {field of `ContactParameters`: value} and
    `mechanisms` {name: {parameter: value}}, each optional; other keys are notes. tau is then the file's, mu_cd drawn from the
    range of its runs.

    Raises
    ------
    ParameterError
        for a file that is none, is no JSON or holds something else under a key

    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"model {path} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ParameterError(f"model {path} is not JSON: {error}") from None
    if not isinstance(document, dict):
        raise ParameterError(f"model {path} must hold an object with any of {', '.join(_KEYS)}")
    for key, kind in _KEYS.items():
        value = document.get(key)
        if value is not None and not isinstance(value, (int, float) if kind is float else kind):
            raise ParameterError(f"model {path}: {key} = {value!r} must be {'a number' if kind is float else 'an object'}")
    scenario: dict[str, Any] = {}
    if (tau := document.get("tau_m_per_J")) is not None:
        scenario["tau"] = (tau, tau)
    if frictions := list((document.get("mu_cd") or {}).values()):
        scenario["mu_cd"] = (min(frictions), max(frictions))
    vehicle = {"contact": document["contact"]} if document.get("contact") else {}
    return {"vehicle": vehicle, "mechanisms": document.get("mechanisms") or {}, "scenario": scenario}
