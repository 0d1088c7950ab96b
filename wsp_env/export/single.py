"""A unit of C in single precision: the same text with floats, their functions and their literals.

For processors that compute doubles slowly or not at all. Whole numbers stay as they are. What the test vectors hold is what the
Python computes in double precision: the runner says how far floats are from it.
"""

import dataclasses
import re

from wsp_env.export.library import MATH
from wsp_env.export.unit import Unit
from wsp_env.parameters.quantity import ParameterError

#: By how much floats may differ, relative from 1 on, and which share of the numbers may differ by more: a threshold is crossed
#: an interval earlier or later, and what a controller does changes what it believes. Twice what 100,000 steps show, or more;
#: see docs/export.md.
TOLERANCES = {"wsp_law": (5e-6, 2e-4), "wsp_plant": (1e-3, 1e-5), "wsp_adaptive": (5e-3, 0.2), "wsp_policy": (5e-3, 0.1)}
OF_RULES = (1e-3, 2e-3)

_TOKEN = re.compile(
    r"(?P<said>/\*.*?\*/)|(?P<whole>\b0x[0-9A-Fa-f]+\b|UINT64_C\([^)]*\))"
    r"|(?P<number>(?<![\w.])(?:\d+\.\d*|\.\d+|\d+(?=[eE][-+]?\d))(?:[eE][-+]?\d+)?(?![\w.]))"
    r"|(?P<function>\b(?:" + "|".join(sorted((*MATH, "floor", "ceil", "rint", "fmin", "fmax"), key=len, reverse=True)) + r")\()"
    r"|(?P<word>\bdouble\b|\bDBL_MAX\b)",
    re.DOTALL,
)


def in_floats(text: str) -> str:
    """Return C with floats for doubles; comments stay."""

    def other(found: re.Match[str]) -> str:
        token = found[0]
        if found["number"]:
            return f"{token}f"
        if found["function"]:
            return f"{token[:-1]}f("
        return {"double": "float", "DBL_MAX": "FLT_MAX"}.get(token, token)

    return _TOKEN.sub(other, text)


def single(unit: Unit) -> Unit:
    """Return a unit in single precision; `ParameterError` for one that floats are too coarse for."""
    if unit.why_double:
        raise ParameterError(f"{unit.title} has no single precision: {unit.why_double}")
    tolerance, share = TOLERANCES.get(unit.name, OF_RULES)
    return dataclasses.replace(
        unit, single=True, title=f"{unit.title}; single precision", tolerance=tolerance, allowed_share=share
    )  # fmt: skip
