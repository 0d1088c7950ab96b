"""The names, variables and assignments of one function, from Python to C."""

import ast
import dataclasses
import re
from typing import Any

from wsp_env.export import arrays, kinds
from wsp_env.export.expressions import Expressions
from wsp_env.export.kinds import BOOL, Array, Known, Record, Scalar, Several, Type, UntranslatableError, Value
from wsp_env.export.source import Source
from wsp_env.export.writer import CFile


class Assignments(Expressions):
    """What `Body` knows of names and lines.

    Parameters
    ----------
    translator : what the file is made of
    source : the function

    """

    def __init__(self, translator: CFile, source: Source) -> None:
        self.translator = translator
        self.source = source
        self.names: dict[str, Value] = {}
        self.lines: list[str] = []
        self.returns: Type | None = None
        self._depth = 1
        self._counter = 0
        self._noted: set[int] = set()
        self._stores = [n.id for n in ast.walk(source.tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        self._blocks: list[ast.AST] = [source.tree]

    # --- text ----------------------------------------------------------------------------------------------------------

    def emit(self, line: str) -> None:
        """Write a line."""
        self.lines.append("    " * self._depth + line)

    def fresh(self, name: str) -> str:
        """Return a name that nothing has yet."""
        self._counter += 1
        return f"{name}_{self._counter}"

    def temporary(self, t: Array, name: str) -> Value:
        """Declare a variable of the function's own for an array."""
        own = self.fresh(kinds.safe(name))
        t = dataclasses.replace(t, const=False)
        self.emit(f"{t.declared(own)};")
        return kinds.variable(t, own)

    def kept(self, value: Value, name: str) -> Value:
        """Write an array expression out into a variable."""
        assert isinstance(value.type, Array)
        place = self.temporary(value.type, name)
        arrays.fill(self, place, value)
        return place

    def loop(self, size: int) -> str:
        """Begin a loop over one dimension; return its index."""
        index = self.fresh("n")
        self.emit(f"for (int64_t {index} = 0; {index} < {size}; {index}++) {{")
        self._depth += 1
        return index

    def end(self, loops: int = 1) -> None:
        """End so many blocks."""
        for _ in range(loops):
            self._depth -= 1
            self.emit("}")

    # --- assignments ---------------------------------------------------------------------------------------------------

    def _annassign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._assign(ast.Assign([statement.target], statement.value, lineno=statement.lineno))

    def _assign(self, statement: ast.Assign) -> None:
        if isinstance(statement.targets[0], ast.Tuple) and len(statement.targets) == 1:
            self._unpack(statement.targets[0], statement.value)
            return
        value = self.expression(statement.value)
        for target in reversed(statement.targets):
            self._store(target, value)

    def _unpack(self, target: ast.Tuple, given: ast.expr) -> None:
        if isinstance(given, ast.Tuple):
            values = [self.expression(one) for one in given.elts]
            texts = [self._target_text(one) for one in target.elts]
            if any(text and text in value.code for n, value in enumerate(values) for text in texts[:n]):
                values = [self._copied(value) for value in values]
            for one, value in zip(target.elts, values, strict=True):
                self._store(one, value)
            return
        value = self.expression(given)
        for one, part in zip(target.elts, self._parts(value, len(target.elts)), strict=True):
            if not (isinstance(one, ast.Name) and one.id.strip("_") == ""):
                self._store(one, part)

    def _parts(self, value: Value, count: int) -> list[Value]:
        if isinstance(value.type, Known) and isinstance(value.type.value, tuple):
            return [kinds.known(one) if not isinstance(one, float) else self.number(one) for one in value.type.value]
        if isinstance(value.type, Record):
            return [value.member(name) for name, _ in value.type.fields]
        if isinstance(value.type, Several) and len(value.type.items) == count:
            own = self.fresh("found")
            self.emit(f"const {self.translator.several(value.type.items)} {own} = {value.code};")
            return [Value(t) if kinds.erased(t) else kinds.variable(t, f"{own}.v{n}") for n, t in enumerate(value.type.items)]
        raise UntranslatableError(f"{value.code} is not {count} values")

    def _copied(self, value: Value) -> Value:
        if not isinstance(value.type, Scalar):
            return value
        own = self.fresh("before")
        self.emit(f"const {value.type.value} {own} = {value.code};")
        return Value(value.type, own)

    def _target_text(self, target: ast.expr) -> str:
        if isinstance(target, ast.Name) and target.id not in self.names:
            return ""
        return self.expression(_loaded(target)).code

    def _store(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._store_name(target.id, value)
            return
        if isinstance(target, ast.Subscript):
            array = self.expression(target.value)
            if arrays.by_mask(self, array, target.slice, value):
                return
        place = self.expression(_loaded(target))
        if isinstance(place.type, Array):
            arrays.fill(self, place, value)
            return
        if not isinstance(place.type, Scalar):
            raise UntranslatableError(f"{ast.unparse(target)} cannot be assigned")
        self.emit(f"{place.code} = {self.converted(value, place.type).code};")

    def _store_name(self, name: str, value: Value) -> None:
        once = self._stores.count(name) == 1
        if isinstance(value.type, Record) and value.type.empty:
            self.names[name] = value
            return
        if once and (isinstance(value.type, Known) and not isinstance(value.type.value, int | float)):
            self.names[name] = value
            return
        if once and isinstance(value.type, Known) and not isinstance(value.type.value, bool):
            self.names[name] = value  # a whole number that is known
            return
        lasting = kinds.stored(value.type) or (isinstance(value.type, Record) and "(" not in value.code)
        if once and lasting:  # another name of something that stays
            self.names[name] = value
            return
        if isinstance(value.type, Array) and once and value.code and "self" not in self.names:  # a kernel binds no array anew
            self.names[name] = value
            return
        if isinstance(value.type, Array):
            known = self.names.get(name)
            if known is None:
                own = kinds.safe(name)
                t = dataclasses.replace(value.type, const=False)
                if not t.sizes and self._at_top(name):
                    assert value.element is not None
                    self.emit(f"{t.declared(own)} = {self.converted(value.element(()), t.kind).code};")
                    self.names[name] = kinds.variable(t, own)
                    return
                self._declare(name, own, t.declared(own))
                known = self.names[name] = kinds.variable(t, own)
            elif not isinstance(known.type, Array) or known.type.shape != value.type.shape:
                raise UntranslatableError(f"{name} changes its shape")
            arrays.fill(self, known, value)
            return
        value = self.as_number(value)
        own = kinds.safe(name)
        if name in self.names:
            self.emit(f"{self.names[name].code} = {self.converted(value, self.names[name].type).code};")
            return
        if self._loaded_nowhere(name):
            self.emit(f"(void)({value.code});")
            return
        declared = f"{self.translator.c_type(value.type)} {own}"
        if self._at_top(name):
            self.emit(f"{declared} = {value.code};")
        else:
            self._declare(name, own, declared)
            self.emit(f"{own} = {value.code};")
        self.names[name] = kinds.variable(value.type, own)

    def without_unused(self) -> None:
        """Drop variables that nothing reads, as what read them was settled before."""
        for n in range(len(self.lines) - 1, -1, -1):
            found = re.fullmatch(r"\s*(?:const )?\w+ (\w+) = (.*);", self.lines[n])
            if found is None or found[1] in ("return",):
                continue
            if not any(re.search(rf"\b{found[1]}\b", line) for m, line in enumerate(self.lines) if m != n):
                if found[2].startswith("(wsp_") or "(" not in found[2]:
                    del self.lines[n]
                else:
                    indent = self.lines[n][: len(self.lines[n]) - len(self.lines[n].lstrip())]
                    self.lines[n] = f"{indent}(void)({found[2]});"

    def _loaded_nowhere(self, name: str) -> bool:
        return not any(
            isinstance(n, ast.Name) and n.id == name and isinstance(n.ctx, ast.Load) for n in ast.walk(self.source.tree)
        )

    def _at_top(self, name: str) -> bool:
        """Whether all of a name's uses lie in the block at hand."""
        inside = sum(isinstance(n, ast.Name) and n.id == name for n in ast.walk(self._blocks[-1]))
        return inside == sum(isinstance(n, ast.Name) and n.id == name for n in ast.walk(self.source.tree))

    def _declare(self, name: str, own: str, declared: str) -> None:
        if self._at_top(name):
            self.emit(f"{declared};")
        else:
            self.lines.insert(0, f"    {declared};")

    def _augassign(self, statement: ast.AugAssign) -> None:
        target = _loaded(statement.target)
        place = self.expression(target)
        value = self.expression(ast.BinOp(target, statement.op, statement.value))
        if isinstance(place.type, Array):
            arrays.fill(self, place, value)
            return
        if isinstance(place.type, Known):
            raise UntranslatableError(f"{ast.unparse(target)} is known when the C is written, and changes")
        right = self.expression(statement.value)
        sign = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}.get(type(statement.op))
        if sign and isinstance(right.type, Scalar | Known) and place.type is not BOOL:
            self.emit(f"{place.code} {sign}= {self.converted(right, place.type).code};")
            return
        self.emit(f"{place.code} = {value.code};")


def _loaded(target: ast.expr) -> Any:
    """Return a target as what it holds."""
    if isinstance(target, ast.Name):
        return ast.Name(target.id, ast.Load())
    if isinstance(target, ast.Attribute):
        return ast.Attribute(target.value, target.attr, ast.Load())
    if isinstance(target, ast.Subscript):
        return ast.Subscript(target.value, target.slice, ast.Load())
    raise UntranslatableError(f"{ast.unparse(target)} cannot be assigned")
