"""What is exported: a unit with parameters, inputs and outputs, and the C that starts it and takes a step."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from wsp_env.export import kinds
from wsp_env.export.library import HELPERS
from wsp_env.export.source import fits
from wsp_env.export.texts import several_texts, struct_text
from wsp_env.export.translator import Translator

WIDTH = 128


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of the interface, a number or `size` of them."""

    name: str
    unit: str
    meaning: str
    start: tuple[float, ...] = (0.0,)
    size: int | None = None

    @property
    def count(self) -> int:
        """How many numbers it holds."""
        return self.size or 1

    def starts(self) -> tuple[float, ...]:
        """Return the value of each of its numbers at the start."""
        return self.start if len(self.start) == self.count else self.start * self.count

    def elements(self) -> Iterator[tuple[str, float]]:
        """Iterate over its numbers: how C gets at them in a struct, and their start."""
        for n, start in enumerate(self.starts()):
            yield self.name if self.size is None else f"{self.name}[{n}]", start


@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit of C.

    `start` and `step` are the bodies of its two functions, which see `self`, the parameters `p`, the inputs `u` and the outputs
    `y`. `reference(times)` yields what the Python makes: ("start", parameters) and ("step", inputs, outputs),
    flat; so many times the test vectors that come along.
    """

    name: str
    title: str
    translator: Translator
    parameters: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    state: tuple[str, ...]
    start: tuple[str, ...]
    step: tuple[str, ...]
    reference: Callable[[int], Iterator[tuple[str, Sequence[float], Sequence[float]]]]
    read: tuple[str, ...] = ()  # C that fills in `y` without a step; none: outputs come of steps
    interval_s: float | None = None  # between two steps; None: it has no time
    tolerance: float = 0.0  # by which C and Python may differ, relative from 1 on
    allowed_share: float = 0.0  # of the numbers that may differ by more
    why_tolerance: str = ""
    why_double: str = ""  # why it cannot be written with floats, as the end of a sentence
    tables: str = ""  # C before the functions
    controller: bool = False  # takes time, wheel_speed and demand, gives command
    axles: int = 0
    single: bool = False  # floats for doubles, see `wsp_env.export.single`

    @property
    def real(self) -> str:
        """The type of its numbers."""
        return "float" if self.single else "double"

    @property
    def groups(self) -> dict[str, tuple[Variable, ...]]:
        """The structs of the interface."""
        return {"parameters": self.parameters, "input": self.inputs, "output": self.outputs}


def flat(values: object) -> list[float]:
    """Return numbers and arrays of numbers one after another."""
    if isinstance(values, tuple | list):
        return [one for value in values for one in flat(value)]
    return [float(one) for one in np.asarray(values, dtype=np.float64).reshape(-1)]


def assigned(place: str, value: Any, t: kinds.Type) -> list[str]:
    """Return the assignments that give a record the values of an example, of the first vehicle of its batch; zeros left out."""
    if isinstance(t, kinds.Record):
        return [
            line
            for name, own in t.fields
            if not kinds.erased(own)
            for line in assigned(f"{place}.{kinds.safe(name)}", getattr(value, name), own)
        ]
    if isinstance(t, kinds.Array):
        first = np.asarray(value)[(0,) if kinds.BATCH in t.shape else ()]
        return [
            f"{place}{''.join(f'[{i}]' for i in at)} = {_text(one, t.kind)};" for at, one in np.ndenumerate(first) if one != 0
        ]
    if isinstance(t, kinds.Scalar):
        return [f"{place} = {_text(value, t)};"] if value != 0 else []
    return []


def _text(value: Any, kind: kinds.Scalar) -> str:
    if kind is kinds.BOOL:
        return "true" if value else "false"
    if kind is kinds.WORD:
        return f"UINT64_C({int(value)})"
    return str(int(value)) if kind is kinds.INT else kinds.literal(float(value))


def header(unit: Unit) -> str:
    """Return the header of a unit."""
    guard, name = f"{unit.name.upper()}_H", unit.name
    parts = [
        "\n".join(fits(unit.title, "")),
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdbool.h>\n#include <stdint.h>\n\n"
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        *(struct_text(record, unit.translator.c_type) for record in unit.translator.structs.values() if not record.view),
        *(_struct(f"{name}_{group}", variables) for group, variables in unit.groups.items()),
        "\n".join(
            [
                "/* All that one instance remembers. */",
                "typedef struct {",
                *(f"    {line}" for line in unit.state),
                f"}} {name};",
            ]
        ),
        f"/* Fill in the usual parameters. */\nvoid {name}_defaults({name}_parameters *p);",
        f"/* Begin anew with these parameters. */\nvoid {name}_start({name} *self, const {name}_parameters *p);",
        f"/* {_step_said(unit)} */\nvoid {name}_step({name} *self, const {name}_input *u, {name}_output *y);",
        *(
            [f"/* Say what is, without a step. */\nvoid {name}_read(const {name} *self, {name}_output *y);"]
            if unit.read
            else ()
        ),
        "#ifdef __cplusplus\n}\n#endif\n\n#endif",
    ]
    return "\n\n".join(parts) + "\n"


def _step_said(unit: Unit) -> str:
    return f"Take a step of {unit.interval_s:g} s." if unit.interval_s else "Compute the outputs from the inputs."


def _struct(name: str, variables: Sequence[Variable]) -> str:
    lines = ["typedef struct {"]
    for v in variables:
        declared = v.name if v.size is None else f"{v.name}[{v.size}]"
        lines += fits(f"{v.meaning} [{v.unit}]", "    ")
        lines.append(f"    double {declared};")
    if not variables:
        lines.append("    double none; /* nothing */")
    return "\n".join([*lines, f"}} {name};"])


def source(unit: Unit) -> str:
    """Return the C of a unit."""
    t, name = unit.translator, unit.name
    used = "\n".join([*t.functions, *unit.step, *unit.start])
    helpers = [text for helper, text in HELPERS.items() if f"wsp_{helper}(" in used]
    starts = [
        f"    p->{place} = {kinds.literal(value)};" for variable in unit.parameters for place, value in variable.elements()
    ]
    parts = [
        "\n".join(
            fits(
                f"{unit.title}\n\nWritten by wsp-env from its Python. Keep the order of operations: compile without "
                "-ffast-math and with -ffp-contract=off.",
                "",
            )
        ),
        f'#include "{name}.h"\n\n#include <float.h>\n#include <math.h>\n#include <string.h>',
        "\n".join(t.constants.values()),
        *(struct_text(record, t.c_type) for record in t.structs.values() if record.view),
        *several_texts(t.several_structs, t.c_type),
        unit.tables,
        *helpers,
        *t.functions,
        "\n".join([f"void {name}_defaults({name}_parameters *p)", "{", *(starts or ["    p->none = 0.0;"]), "}"]),
        _function(f"void {name}_start({name} *self, const {name}_parameters *p)", unit.start, ("self", "p")),
        *(
            [_function(f"void {name}_read(const {name} *self, {name}_output *y)", unit.read, ("self", "y"))]
            if unit.read
            else ()
        ),
        _function(f"void {name}_step({name} *self, const {name}_input *u, {name}_output *y)", unit.step, ("self", "u", "y")),
    ]
    return wrapped("\n\n".join(part for part in parts if part)) + "\n"


def _function(head: str, lines: Sequence[str], arguments: Sequence[str]) -> str:
    text = "\n".join(lines)
    unused = [
        f"    (void){name};"
        for name in arguments
        if f"{name}->" not in text and f"{name};" not in text and f"*{name}" not in text
    ]
    return "\n".join([head, "{", *unused, *(f"    {line}" for line in lines), "}"])


def wrapped(text: str) -> str:
    """Break lines that are too long behind an operator or a comma, if they are no comments."""
    lines = []
    for line in text.splitlines():
        indent = line[: len(line) - len(line.lstrip())] + "    "
        while len(line) > WIDTH and not line.lstrip().startswith(("/*", "*", "#")) and "/*" not in line:
            at = max(
                line.rfind(sign, len(indent), WIDTH) + len(sign.rstrip())
                for sign in (", ", " + ", " - ", " * ", " && ", " || ", " = ")
            )
            if at <= len(indent):
                break
            lines.append(line[:at].rstrip())
            line = indent + line[at:].lstrip()
        lines.append(line)
    return "\n".join(lines)
