"""From compiled Python functions to C99: the functions, records and constants that one file of C needs.

A function is translated for the types of its arguments, what it calls before it. What is known when the C is written (number of
axles, which mechanisms act, whether there are sensors) is settled then. The order of every operation stays as it is in Python,
so that a compiler without fast-math and contraction computes the same bits.
"""

import ast
import dataclasses
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_type_hints

from wsp_env.export import kinds
from wsp_env.export.body import Body
from wsp_env.export.kinds import BOOL, INT, REAL, Array, Known, Record, Scalar, Several, Type, UntranslatableError, Value, known
from wsp_env.export.source import constants_said, fits, plain_function, read
from wsp_env.export.texts import first_paragraphs, listed, snake
from wsp_env.export.writer import Writer


@dataclasses.dataclass(frozen=True)
class Signature:
    """A translated function."""

    name: str
    returns: Type | None
    by_pointer: frozenset[str]  # arguments without dimensions that it changes


@dataclasses.dataclass(frozen=True)
class Direct:
    """What stands in the place of a function: makes its value by itself."""

    make: Callable[[Sequence[Value], Writer | None], Value]


class Translator:
    """What one file of C is made of.

    Parameters
    ----------
    prefix : of all struct names
    replaced : functions, compiled or not, by those that stand in their place

    """

    def __init__(self, prefix: str, replaced: Mapping[Any, Any] | None = None) -> None:
        self.prefix = prefix
        self.functions: list[str] = []
        self.structs: dict[str, Record] = {}
        self.constants: dict[str, str] = {}
        self.helpers: set[str] = set()
        self.several_structs: dict[tuple[Type, ...], str] = {}
        self._signatures: dict[Any, Signature] = {}
        self._taken: dict[str, Any] = dict.fromkeys((f"{prefix}_{group}" for group in ("parameters", "input", "output")), self)
        self._replaced = {id(plain_function(key)): value for key, value in (replaced or {}).items()}
        self._kept = list(replaced or {})

    # --- types ---------------------------------------------------------------------------------------------------------

    def struct_name(self, python: type) -> str:
        """Return the name of a class's struct."""
        name = f"{self.prefix}_{snake(python.__name__)}"
        if self._taken.setdefault(name, python) is not python:
            name = f"{self.prefix}_{python.__module__.rpartition('.')[2]}_{snake(python.__name__)}"
            self._taken.setdefault(name, python)
        return name

    def type_of(self, example: Any) -> Type:
        """Return the type of an example, its records noted."""
        found = kinds.of_example(example, self.struct_name)
        self._note(found)
        return found

    def _note(self, found: Type) -> None:
        if isinstance(found, Record) and not found.empty and found.name not in self.structs:
            for _, inner in found.fields:
                self._note(inner)
            self.structs[found.name] = dataclasses.replace(found, const=False)

    def record(self, python: Any, values: Mapping[str, Value]) -> Record:
        """Return the type of a record that a function makes of these values."""
        hints = get_type_hints(python)
        fields = tuple((name, _field(hints.get(name), value)) for name, value in values.items())
        view = any(isinstance(t, Array) or (isinstance(t, Record) and (t.stored or t.view)) for _, t in fields)
        found = Record(self.struct_name(python), fields, python, view=view)
        self._note(found)
        if dataclasses.replace(self.structs.get(found.name, found), const=False).fields != found.fields:
            raise UntranslatableError(f"{python.__name__} is made of different types in different places")
        return found

    def several(self, items: tuple[Type, ...]) -> str:
        """Return the struct of a function's several values."""
        if items not in self.several_structs:
            words = "_".join(item.name.lower() if isinstance(item, Scalar) else "record" for item in items)
            self.several_structs[items] = f"{self.prefix}_{words}"
        return self.several_structs[items]

    def c_type(self, t: Type) -> str:
        """Return the C type of a value that is passed by value."""
        if isinstance(t, Scalar):
            return t.value
        if isinstance(t, Array) and not t.sizes:
            return t.kind.value
        if isinstance(t, Record):
            return t.name
        if isinstance(t, Several):
            return self.several(t.items)
        raise UntranslatableError(f"{t} is no value")

    def parameter(self, t: Type, name: str, by_pointer: bool = False) -> str:
        """Return the declaration of a function's argument."""
        const = "const " if getattr(t, "const", False) else ""
        if isinstance(t, Array) and t.sizes:
            return f"{const if len(t.sizes) == 1 else ''}{t.declared(name)}"
        if kinds.stored(t):
            assert isinstance(t, Record)
            return f"{const}{t.name} *{name}"
        return f"{self.c_type(t)} {'*' if by_pointer else ''}{name}"

    # --- constants -----------------------------------------------------------------------------------------------------

    def constant(self, name: str, value: Any, module: str) -> str:
        """Note a constant of a Python module; return its name in C."""
        own = f"{module.rpartition('.')[2]}_{name.lstrip('_')}".upper()
        said = constants_said(sys.modules[module]).get(name, "") if module in sys.modules else ""
        if isinstance(value, tuple):
            text = f"static const double {own}[{len(value)}] = {{{', '.join(map(kinds.literal, value))}}};"
        else:
            shown = kinds.literal(value) if isinstance(value, float) else str(int(value))
            text = f"#define {own} {f'({shown})' if shown.startswith('-') else shown}"
        self.constants[own] = "\n".join([*(fits(said, "") if said else []), text])
        return own

    # --- functions -----------------------------------------------------------------------------------------------------

    def call(self, function: Any, given: Sequence[Value], body: Writer | None, method_of: str = "") -> Value:
        """Translate a function for these arguments; return its call."""
        function = self._replaced.get(id(plain_function(function)), function)
        if isinstance(function, Direct):
            return function.make(given, body)
        source = read(function)
        names = [argument.arg for argument in source.tree.args.args]
        defaults = source.tree.args.defaults
        if len(given) < len(names) - len(defaults) or len(given) > len(names):
            raise UntranslatableError(f"{source.tree.name} is called with {len(given)} arguments")
        if len(given) < len(names):
            raise UntranslatableError(f"{source.tree.name} is called without {names[len(given) :]}")
        given = [_as_argument(v, a.annotation) for v, a in zip(given, source.tree.args.args, strict=True)]
        only = source.body[0] if len(source.body) == 1 else None
        if isinstance(only, ast.Return) and (only.value is None or isinstance(only.value, ast.Constant)):
            value = only.value.value if isinstance(only.value, ast.Constant) else None
            if value is None or isinstance(value, bool):  # settled here
                return known(value)
        key = (id(source.function), tuple(value.type for value in given))
        if key not in self._signatures:
            self._signatures[key] = self._translate(source, names, given, method_of)
        return self._called(self._signatures[key], names, given, body)

    def _translate(
        self, source: Any, names: Sequence[str], given: Sequence[Value], method_of: str, passed_on: frozenset[str] = frozenset()
    ) -> Signature:
        stored_to = _subscripted(source.tree) | passed_on
        by_pointer = frozenset(
            name
            for name, v in zip(names, given, strict=True)
            if isinstance(v.type, Array) and not v.type.sizes and name in stored_to
        )
        module = method_of or source.function.__globals__.get("__name__", "slot").rpartition(".")[2]
        name = self._free_name(f"{module}_{source.tree.name.lstrip('_')}".replace("__", "_"))
        body = Body(self, source)
        parameters = []
        for argument, value in zip(names, given, strict=True):
            own = "self" if argument == "self" else kinds.safe(argument)
            pointed = argument in by_pointer
            if kinds.erased(value.type):
                body.names[argument] = value
                continue
            parameters.append((own, self.parameter(value.type, own, pointed)))
            code = f"(*{own})" if pointed else own
            body.names[argument] = kinds.variable(value.type, code, pointer=kinds.stored(value.type))
        try:
            body.statements(source.body)
        except UntranslatableError as error:
            raise UntranslatableError(f"{source.tree.name}: {error}") from None
        body.without_unused()
        # What a function that it calls changes it changes too.
        text = "\n".join(body.lines)
        given_on = {a for a in names if a not in by_pointer and re.search(rf"&{re.escape(kinds.safe(a))}\b(?!->)", text)}
        if further := frozenset(
            a for a, v in zip(names, given, strict=True)
            if a in given_on and isinstance(v.type, Array) and not v.type.sizes
        ):  # fmt: skip
            return self._translate(source, names, given, method_of, passed_on | further)
        returns = body.returns
        if isinstance(returns, Array) and returns.sizes:
            parameters.append(("result", returns.declared("result")))
        text = "\n".join(body.lines)
        unused = [f"    (void){own};" for own, _ in parameters if not re.search(rf"\b{re.escape(own)}\b", text)]
        by_value = returns is None or (isinstance(returns, Array) and returns.sizes) or isinstance(returns, Known)
        head = f"static {'void' if by_value else self.c_type(returns)} {name}("  # type: ignore[arg-type]  # None: by_value
        said = fits(first_paragraphs(source.docstring), "") if source.docstring else []
        declared = listed(head, [one for _, one in parameters] or ["void"], ")")
        self.functions.append("\n".join([*said, declared, "{", *unused, *body.lines, "}"]))
        return Signature(name, returns, by_pointer)

    def _called(self, found: Signature, names: Sequence[str], given: Sequence[Value], body: Writer | None) -> Value:
        texts = []
        for name, value in zip(names, given, strict=True):
            if kinds.erased(value.type):
                continue
            if body is not None and isinstance(value.type, Array) and value.type.sizes and not value.code:
                value = body.kept(value, name)
            texts.append(argument(value, name in found.by_pointer))
        returns = found.returns
        if returns is None or isinstance(returns, Known):
            return Value(returns or Known(None), f"{found.name}({', '.join(texts)})")
        if isinstance(returns, Array) and returns.sizes:
            if body is None:  # whoever writes the call has an array `result`
                return Value(returns, f"{found.name}({', '.join([*texts, 'result'])})")
            place = body.temporary(returns, found.name.rpartition("_")[2])
            body.emit(f"{found.name}({', '.join([*texts, place.code])});")
            return place
        code = f"{found.name}({', '.join(texts)})"
        if isinstance(returns, Array):
            kind = returns.kind
            assert body is not None
            own = body.fresh(found.name.rpartition("_")[2])
            body.emit(f"const {kind.value} {own} = {code};")
            return kinds.variable(Array(kind, returns.shape), own)
        return Value(returns, code)

    def _free_name(self, name: str) -> str:
        taken = {signature.name for signature in self._signatures.values()}
        free, count = name, 1
        while free in taken or f" {free}(" in "".join(self.functions):
            count += 1
            free = f"{name}_{count}"
        return free


def argument(value: Value, by_pointer: bool = False) -> str:
    """Return a value as a call's argument."""
    if by_pointer:
        return f"&{value.code}" if not value.code.startswith("(*") else value.code[2:-1]
    if isinstance(value.type, Array) and not value.type.sizes:
        assert value.element is not None
        return value.element(()).code
    if kinds.stored(value.type):
        return value.code if value.pointer else f"&{value.code}"
    return value.code


def _as_argument(value: Value, annotation: ast.expr | None) -> Value:
    """Let a number that is known be any number to the function, of the kind that it is annotated with."""
    said = ast.unparse(annotation) if annotation else ""
    if isinstance(value.type, Known) and isinstance(value.type.value, int) and not isinstance(value.type.value, bool):
        return (
            Value(REAL, kinds.literal(float(value.type.value)), number=float(value.type.value))
            if said == "float"
            else Value(INT, value.code, value.level)
        )
    if isinstance(value.type, Known) and isinstance(value.type.value, bool):
        return Value(BOOL, value.code)
    if value.type is INT and said == "float":
        return Value(REAL, f"(double){value.code}" if value.level == 0 else f"(double)({value.code})", 2)
    return value


def _field(hint: Any, value: Value) -> Type:
    t = value.type
    if hint is float and (t is INT or (isinstance(t, Known) and isinstance(t.value, int))):
        return REAL
    if isinstance(t, Known) and isinstance(t.value, bool):
        return BOOL
    return t


def _subscripted(tree: ast.FunctionDef) -> set[str]:
    """Return the names whose elements a function sets."""
    return {
        node.value.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name)
    }
