"""The types and values that the translator knows: what a Python expression is in C.

Everything has its size when the C is written: the axles of the vehicle, the nodes of the track. A batch of N vehicles becomes
one vehicle: the dimension N and the index of the vehicle vanish.
"""

import dataclasses
import enum
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

#: The dimension of the vehicles of a batch, and the size that examples of arrays have there.
BATCH = "N"
SENTINEL = 97


class UntranslatableError(Exception):
    """Python that the translator does not know; the message says what and where."""


class Scalar(enum.Enum):
    """A number; the value is its type in C."""

    REAL = "double"
    SINGLE = "float"
    INT = "int64_t"
    WORD = "uint64_t"
    BOOL = "bool"


REAL, SINGLE, INT, WORD, BOOL = Scalar.REAL, Scalar.SINGLE, Scalar.INT, Scalar.WORD, Scalar.BOOL
_OF_DTYPE = {"f8": REAL, "f4": SINGLE, "i8": INT, "u8": WORD, "b1": BOOL}


@dataclasses.dataclass(frozen=True)
class Array:
    """An array; dimensions are numbers or `BATCH`, which C does not have."""

    kind: Scalar
    shape: tuple[int | str, ...]
    const: bool = False

    @property
    def sizes(self) -> tuple[int, ...]:
        """The dimensions that it has in C."""
        return tuple(size for size in self.shape if isinstance(size, int))

    def declared(self, name: str) -> str:
        """Return its declaration as a variable or a member."""
        return f"{self.kind.value} {name}" + "".join(f"[{size}]" for size in self.sizes)


@dataclasses.dataclass(frozen=True)
class Record:
    """A NamedTuple, dataclass or object. Records of numbers are passed by value, others by pointer.

    `view` marks one made inside a function: its members that hold arrays are pointers.
    """

    name: str  # of the struct
    fields: tuple[tuple[str, "Type"], ...]
    python: Any = dataclasses.field(compare=False)
    const: bool = False
    view: bool = False

    @property
    def stored(self) -> bool:
        """Whether it is passed by pointer: it holds arrays or is changed in place."""
        return not self.view and (self.mutable or any(isinstance(t, Array) or stored(t) for _, t in self.fields))

    @property
    def mutable(self) -> bool:
        """Whether it is an object with attributes that methods change."""
        return not (isinstance(self.python, type) and issubclass(self.python, tuple)) and not dataclasses.is_dataclass(
            self.python
        )

    @property
    def empty(self) -> bool:
        """Whether nothing is in it, so that C does without."""
        return all(erased(t) for _, t in self.fields)


@dataclasses.dataclass(frozen=True)
class Several:
    """What a function returns that returns several values."""

    items: tuple["Type", ...]


@dataclasses.dataclass(frozen=True)
class Known:
    """Something of Python's that is known when the C is written: a module, a function, a whole number."""

    value: Any = dataclasses.field(hash=False)

    def __hash__(self) -> int:
        """By kind: equality tells the rest."""
        return hash(type(self.value))


class Vehicle:
    """The type of the index of the vehicle in the batch."""


VEHICLE = Known(Vehicle)
Type: TypeAlias = Scalar | Array | Record | Several | Known


def erased(t: "Type") -> bool:
    """Whether nothing of it is left in C."""
    return isinstance(t, Known) or (isinstance(t, Record) and t.empty) or (isinstance(t, Array) and 0 in t.shape)


def stored(t: "Type") -> bool:
    """Whether it is a record passed by pointer."""
    return isinstance(t, Record) and t.stored


#: An element of an array from the indices of the dimensions that C has.
Element = Callable[[tuple[str, ...]], "Value"]


@dataclasses.dataclass(frozen=True)
class Value:
    """An expression: its type, its text in C, how tightly that binds, whether it is a pointer; an array: its elements."""

    type: Type
    code: str = ""
    level: int = 0  # 0: needs no parentheses; see `expressions.LEVELS`
    pointer: bool = False
    element: Element | None = None
    number: float | int | None = None  # of a literal or named constant

    @property
    def known(self) -> Any:
        """What of Python's it is; `UntranslatableError` where that is not known."""
        if not isinstance(self.type, Known):
            raise UntranslatableError(f"{self.code} is not known when the C is written")
        return self.type.value

    def member(self, name: str) -> "Value":
        """Return a member of a record."""
        assert isinstance(self.type, Record)
        for field, t in self.type.fields:
            if field == name:
                if self.type.const and isinstance(t, Array | Record):
                    t = dataclasses.replace(t, const=True)
                code = f"{self.code}{'->' if self.pointer else '.'}{safe(name)}"
                return variable(t, code, pointer=self.type.view and stored(t))
        raise UntranslatableError(f"{self.type.name} has no {name}")


def variable(t: Type, code: str, pointer: bool = False) -> Value:
    """Return the value of a variable or member."""
    if isinstance(t, Array):
        kind = t.kind
        return Value(t, code, element=lambda at: Value(kind, code + "".join(f"[{i}]" for i in at)))
    if isinstance(t, Record) and t.view and not pointer:
        return Value(t, code)
    return Value(t, code, pointer=pointer)


def known(value: Any) -> Value:
    """Return something of Python's; whole numbers and truths also have a text in C."""
    if isinstance(value, bool | np.bool_):
        return Value(Known(bool(value)), "true" if value else "false")
    if isinstance(value, int | np.integer):
        return Value(Known(int(value)), str(int(value)), 0 if value >= 0 else 2)
    return Value(Known(value))


def literal(value: float) -> str:
    """Return the text of a number in C, exact."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = repr(float(value))
    return text if any(sign in text for sign in ".en") else text + ".0"


#: Names that C, or what the files include, has taken.
_RESERVED = frozenset(
    {
        "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
        "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof", "static",
        "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool", "true", "false", "exp", "log",
        "floor", "round",
    }
)  # fmt: skip


def safe(name: str) -> str:
    """Return a Python name as a name in C."""
    name = name.lstrip("_") or "unused"
    return name + "_" if name in _RESERVED else name


def of_example(value: Any, name: Callable[[type], str]) -> Type:
    """Return the type of an example: a number, an array (N of them `SENTINEL`), or a record of such things.

    `name` gives the struct of a class its name.
    """
    if isinstance(value, np.ndarray):
        kind = _OF_DTYPE[value.dtype.str[1:]]
        return Array(kind, tuple(BATCH if size == SENTINEL else size for size in value.shape))
    if isinstance(value, bool | np.bool_):
        return BOOL
    if isinstance(value, int | np.integer):
        return INT
    if isinstance(value, float):
        return REAL
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        own = [(field, of_example(getattr(value, field), name)) for field in value._fields]
        return Record(name(type(value)), tuple(own), type(value))
    if dataclasses.is_dataclass(value) or hasattr(value, "__dict__"):
        listed = (
            {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            if dataclasses.is_dataclass(value)
            else vars(value)
        )
        own = [(field, of_example(item, name)) for field, item in listed.items()]
        return Record(name(type(value)), tuple(own), type(value))
    return Known(value)
