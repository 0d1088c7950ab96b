"""What the parts of the translator ask of a function in the making, and of the file that it stands in."""

import ast
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from wsp_env.export.kinds import Array, Record, Type, Value


class CFile(Protocol):
    """A file of C, see `wsp_env.export.translator.Translator`."""

    prefix: str
    helpers: set[str]

    def constant(self, name: str, value: Any, module: str) -> str:
        """Note a constant of a Python module; return its name in C."""

    def call(self, function: Any, given: Sequence[Value], body: "Writer | None", method_of: str = "") -> Value:
        """Translate a function for these arguments; return its call."""

    def record(self, python: Any, values: Mapping[str, Value]) -> Record:
        """Return the type of a record that a function makes of these values."""

    def several(self, items: tuple[Type, ...]) -> str:
        """Return the struct of a function's several values."""

    def c_type(self, t: Type) -> str:
        """Return the C type of a value that is passed by value."""


class Writer:
    """A function in the making, see `wsp_env.export.body.Body`."""

    translator: CFile

    def emit(self, line: str) -> None:
        """Write a line."""
        raise NotImplementedError

    def fresh(self, name: str) -> str:
        """Return a name that nothing has yet."""
        raise NotImplementedError

    def temporary(self, t: Array, name: str) -> Value:
        """Declare a variable of the function's own for an array."""
        raise NotImplementedError

    def kept(self, value: Value, name: str) -> Value:
        """Write an array expression out into a variable."""
        raise NotImplementedError

    def loop(self, size: int) -> str:
        """Begin a loop over one dimension; return its index."""
        raise NotImplementedError

    def end(self, loops: int = 1) -> None:
        """End so many blocks."""
        raise NotImplementedError

    def expression(self, node: ast.expr) -> Value:
        """Translate an expression."""
        raise NotImplementedError

    def number(self, value: float) -> Value:
        """Return a number as a literal."""
        raise NotImplementedError

    def as_number(self, value: Value) -> Value:
        """Return a known number or truth as one of C."""
        raise NotImplementedError

    def converted(self, value: Value, t: Type) -> Value:
        """Return a number as another kind of number."""
        raise NotImplementedError

    def choice(self, test: Value, yes: Value, no: Value) -> Value:
        """Return one of two values."""
        raise NotImplementedError
