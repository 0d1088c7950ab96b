"""Python source as the translator reads it: syntax tree, docstring, comments of functions, constants and members."""

import ast
import dataclasses
import functools
import inspect
import io
import textwrap
import tokenize
from collections.abc import Callable
from typing import Any

from wsp_env.export.kinds import UntranslatableError


@dataclasses.dataclass(frozen=True)
class Source:
    """A function: its tree, names it can see, comments by line (alone on it, or behind code)."""

    function: Callable[..., Any]
    tree: ast.FunctionDef
    names: dict[str, Any]
    alone: dict[int, str]
    behind: dict[int, str]

    @property
    def docstring(self) -> str:
        """What the function says of itself."""
        return ast.get_docstring(self.tree) or ""

    @property
    def body(self) -> list[ast.stmt]:
        """The statements without the docstring."""
        return self.tree.body[1:] if ast.get_docstring(self.tree) is not None else self.tree.body


def plain_function(function: Any) -> Callable[..., Any]:
    """Return the Python function that was compiled, or the function itself."""
    inner: Callable[..., Any] = getattr(function, "py_func", function)
    return inner


@functools.cache
def read(function: Callable[..., Any]) -> Source:
    """Return the source of a function, compiled or not."""
    inner: Any = plain_function(function)
    try:
        text = textwrap.dedent(inspect.getsource(inner))
    except (OSError, TypeError):
        raise UntranslatableError(f"{inner!r} has no source") from None
    tree = next(node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
    alone, behind = comments(text)
    names = dict(inner.__globals__)
    if inner.__closure__:
        names |= {n: cell.cell_contents for n, cell in zip(inner.__code__.co_freevars, inner.__closure__, strict=True)}
    return Source(inner, tree, names, alone, behind)


def comments(text: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return the comments of a source by line: those alone on their line, those behind code."""
    alone: dict[int, str] = {}
    behind: dict[int, str] = {}
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        said = token.string.lstrip("#: ").strip()
        if token.type != tokenize.COMMENT or said.split(":")[0] in ("fmt", "noqa", "type") or not said:
            continue
        row, column = token.start
        (alone if not lines[row - 1][:column].strip() else behind)[row] = said
    return alone, behind


def members(python: Any) -> dict[str, str]:
    """Return what the source of a class says behind each member, unit and meaning; nothing where there is no source."""
    said: dict[str, str] = {}
    for one in reversed(inspect.getmro(python) if isinstance(python, type) else ()):
        try:
            text = textwrap.dedent(inspect.getsource(one))
            tree = ast.parse(text).body[0]
        except (OSError, TypeError, SyntaxError, IndexError):
            continue
        _, behind = comments(text)
        for node in getattr(tree, "body", ()):
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.end_lineno in behind:
                said[node.target.id] = behind[node.end_lineno]
    return said


@functools.cache
def constants_said(module: Any) -> dict[str, str]:
    """Return what a module says of its constants, behind or above them."""
    try:
        text = inspect.getsource(module)
    except (OSError, TypeError):
        return {}
    alone, behind = comments(text)
    said = {}
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name) and node.end_lineno is not None:
                    above: list[str] = []
                    row = node.lineno - 1
                    while row in alone:
                        above.insert(0, alone[row])
                        row -= 1
                    text_ = behind.get(node.end_lineno) or (" ".join(above) if len(above) <= 3 else "")
                    if text_:
                        said[name.id] = text_
    return said


def fits(text: str, indent: str, width: int = 128) -> list[str]:
    """Return a comment as lines of C."""
    text = text.replace("*/", "* /").replace("/*", "/ *")
    lines = [piece for line in text.splitlines() for piece in (textwrap.wrap(line, width - len(indent) - 6) or [""])]
    if len(lines) < 2:
        return [f"{indent}/* {lines[0]} */"] if lines else []
    return [f"{indent}/* {lines[0]}", *(f"{indent} * {line}".rstrip() for line in lines[1:-1]), f"{indent} * {lines[-1]} */"]
