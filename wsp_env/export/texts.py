"""How declarations look in C: structs, names and headings, with what the Python says of them."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from wsp_env.export import kinds
from wsp_env.export.kinds import Array, Record, Type
from wsp_env.export.source import fits, members


def struct_text(record: Record, c_type: Callable[[Type], str]) -> str:
    """Return the typedef of a record, with what the class says of its members."""
    said = members(record.python)
    lines = [*(fits(_first_sentence(record.python), "")), "typedef struct {"]
    for name, t in record.fields:
        if kinds.erased(t):
            continue
        own = kinds.safe(name)
        if isinstance(t, Array):
            if record.view:
                rest = "".join(f"[{size}]" for size in t.sizes[1:])
                declared = f"{t.kind.value} (*{own}){rest}" if rest else f"{t.kind.value} *{own}"
                declared = f"const {declared}" if t.const and len(t.sizes) < 2 else declared
            else:
                declared = t.declared(own)
        elif record.view and kinds.stored(t):
            declared = f"{'const ' if getattr(t, 'const', False) else ''}{c_type(t)} *{own}"
        else:
            declared = f"{c_type(t)} {own}"
        comment = f"  /* {said[name]} */" if name in said else ""
        lines.append(f"    {declared};{comment}")
    return "\n".join([*lines, f"}} {record.name};"])


def several_texts(several: Mapping[tuple[Type, ...], str], c_type: Callable[[Type], str]) -> list[str]:
    """Return the typedefs of what functions with several values return."""
    texts = []
    for items, name in several.items():
        listed = [f"    {c_type(t)} v{n};" for n, t in enumerate(items) if not kinds.erased(t)]
        texts.append("\n".join(["typedef struct {", *listed, f"}} {name};"]))
    return texts


def snake(name: str) -> str:
    """Return a class's name as C has names."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower().strip("_")


def _first_sentence(python: Any) -> str:
    text = inspect.getdoc(python) or ""
    return (
        "" if text.startswith(("Parameters(", "Mechanisms(")) else text.split("\n\n")[0].replace("\n", " ") or python.__name__
    )


def first_paragraphs(docstring: str) -> str:
    """Return a docstring without the underlined headings of numpy's style."""
    lines = docstring.splitlines()
    return "\n".join(line for line in lines if not re.fullmatch(r"-+", line.strip()) or not line.strip()).strip()


def listed(head: str, parts: Sequence[str], tail: str, width: int = 128) -> str:
    """Return a head with its arguments, in as many lines as they take."""
    lines, line = [], head
    for n, part in enumerate(parts):
        piece = part + (", " if n + 1 < len(parts) else tail)
        if len(line) + len(piece.rstrip()) > width:
            lines.append(line.rstrip())
            line = "    "
        line += piece
    return "\n".join([*lines, line])
