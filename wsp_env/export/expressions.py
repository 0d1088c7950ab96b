"""The expressions of a function, from Python to C: names, elements, calls; operators are in `operators`."""

import ast
import inspect
import math
from types import ModuleType
from typing import Any

import numpy as np

from wsp_env.export import arrays, kinds, library
from wsp_env.export.kinds import REAL, WORD, Array, Known, Record, Several, UntranslatableError, Value, known
from wsp_env.export.operators import Operators
from wsp_env.export.source import Source, plain_function


class Expressions(Operators):
    """What `Body` knows of expressions."""

    source: Source
    names: dict[str, Value]

    def expression(self, node: ast.expr) -> Value:
        """Translate an expression."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise UntranslatableError(f"{ast.unparse(node)}: an expression that C is not written for")
        found: Value = method(node)
        return found

    # --- names and numbers ---------------------------------------------------------------------------------------------

    def _constant(self, node: ast.Constant) -> Value:
        return self.number(node.value) if isinstance(node.value, float) else known(node.value)

    def _name(self, node: ast.Name) -> Value:
        if node.id in self.names:
            return self.names[node.id]
        if node.id in self.source.names:
            return self.found(node.id, self.source.names[node.id], self.source.function.__globals__.get("__name__", ""))
        builtin = __builtins__[node.id] if isinstance(__builtins__, dict) else getattr(__builtins__, node.id, None)
        if builtin is None:
            raise UntranslatableError(f"{node.id} has no value yet")
        return known(builtin)

    def found(self, name: str, value: Any, module: str) -> Value:
        """Return what a module has under a name."""
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | tuple):
            if isinstance(value, np.uint64):
                return Value(WORD, f"UINT64_C(0x{int(value):016X})")
            return known(value)
        if isinstance(value, float):
            if not math.isfinite(value):
                return self.number(value)
            return Value(REAL, self.translator.constant(name, value, module), number=value)
        if isinstance(value, tuple):
            return Value(Known(value), f"{module}:{name}")  # written out when an element is asked for
        return Value(Known(value), self.translator.constant(name, value, module))

    def _attribute(self, node: ast.Attribute) -> Value:
        value = self.expression(node.value)
        if isinstance(value.type, Record):
            if node.attr in {name for name, _ in value.type.fields}:
                return value.member(node.attr)
            return self._class_attribute(value, node.attr)
        if isinstance(value.type, Array):
            if node.attr == "shape":
                return Value(Known(value.type.shape))
            if node.attr == "size":
                return known(math.prod(1 if size == kinds.BATCH else int(size) for size in value.type.shape))
            raise UntranslatableError(f"{ast.unparse(node)}: arrays have no such thing in C")
        held = value.known
        if isinstance(held, ModuleType):
            return self.found(node.attr, getattr(held, node.attr), held.__name__)
        return self.found(node.attr, getattr(held, node.attr), self.source.function.__globals__.get("__name__", ""))

    def _class_attribute(self, value: Value, name: str) -> Value:
        assert isinstance(value.type, Record)
        found = inspect.getattr_static(value.type.python, name, None)
        if callable(found):
            return Value(Known((value, found)))  # a method
        if isinstance(found, int | float):
            return self.found(name, found, value.type.python.__module__)
        raise UntranslatableError(f"{value.type.name} has no {name}")

    # --- elements and calls --------------------------------------------------------------------------------------------

    def _subscript(self, node: ast.Subscript) -> Value:
        value = self.expression(node.value)
        if isinstance(value.type, Array):
            return arrays.subscript(self, value, node.slice)
        index = self.expression(node.slice)
        if isinstance(value.type, Record):
            return value.member(value.type.fields[index.known][0])
        held = value.known
        if isinstance(index.type, Known):
            one = held[index.type.value]
            return self.number(one) if isinstance(one, float) else known(one)
        module, _, name = value.code.partition(":")
        return Value(REAL, f"{self.translator.constant(name, held, module)}[{index.code}]")

    def _tuple(self, node: ast.Tuple) -> Value:
        values = [self.as_number(self.expression(one)) for one in node.elts]
        if all(isinstance(value.type, Known) for value in values):
            return Value(Known(tuple(value.type.value for value in values)))  # type: ignore[union-attr]  # all are known
        texts = [value.code for value in values if not kinds.erased(value.type)]
        return Value(Several(tuple(value.type for value in values)), f"{{{', '.join(texts)}}}")

    def _call(self, node: ast.Call) -> Value:
        function = self.expression(node.func) if not _is_method(node) else self._method(node)
        if function is None or not isinstance(function.type, Known):
            raise UntranslatableError(f"{ast.unparse(node.func)} cannot be called in C")
        held = function.known
        named = {keyword.arg or "": self.expression(keyword.value) for keyword in node.keywords}
        given = [self.expression(one) for one in node.args]
        if isinstance(held, tuple) and isinstance(held[0], str):  # of an array
            return arrays.method(self, held[1], held[0], given, named)
        if isinstance(held, tuple):
            value, method = held
            assert isinstance(value.type, Record)
            owner = value.type.name.removeprefix(f"{self.translator.prefix}_")
            return self.translator.call(method, [value, *given], self, owner)
        if (done := library.call(self, held, given, named)) is not None:
            return done
        if isinstance(held, type) and hasattr(held, "_fields"):
            return self._made(held, given, named)
        if named:
            order = list(inspect.signature(plain_function(held)).parameters)[len(given) :]
            given += [named[name] for name in order if name in named]
        return self.translator.call(held, given, self)

    def _method(self, node: ast.Call) -> Value | None:
        assert isinstance(node.func, ast.Attribute)
        value = self.expression(node.func.value)
        if isinstance(value.type, Array) and node.func.attr not in ("shape", "size"):
            return Value(Known((node.func.attr, value)))
        return self.expression(node.func)

    def _made(self, python: Any, given: list[Value], named: dict[str, Value]) -> Value:
        """Return a record that a function makes."""
        values = dict(zip(python._fields, given, strict=False)) | named
        for name, default in python._field_defaults.items():
            values.setdefault(name, self._constant(ast.Constant(default)))
        values = {name: values[name] for name in python._fields}
        t = self.translator.record(python, values)
        texts = []
        for name, field in t.fields:
            value = values[name]
            if kinds.erased(field):
                continue
            if isinstance(field, Array) and not field.sizes:
                texts.append(f"&{value.code}")
            elif kinds.stored(field):
                texts.append(value.code if value.pointer else f"&{value.code}")
            else:
                texts.append(self.converted(value, field).code)
        return Value(t, f"({t.name}){{{', '.join(texts)}}}")


def _is_method(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Attribute)
