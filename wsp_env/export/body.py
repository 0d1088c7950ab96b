"""The statements of one function, from Python to C."""

import ast
import dataclasses
from collections.abc import Sequence

from wsp_env.export import arrays, kinds
from wsp_env.export.assignments import Assignments
from wsp_env.export.kinds import INT, REAL, Array, Known, Several, Type, UntranslatableError, Value
from wsp_env.export.source import fits


class Body(Assignments):
    """A function in the making: names it knows so far and lines of C."""

    def statements(self, body: Sequence[ast.stmt]) -> None:
        """Translate statements one after another, with their comments."""
        for statement in body:
            self._said(statement)
            method = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if method is None:
                raise UntranslatableError(f"{ast.unparse(statement)}: a statement that C is not written for")
            method(statement)

    def _said(self, statement: ast.stmt) -> None:
        row = statement.lineno - 1
        above: list[str] = []
        while row in self.source.alone and row not in self._noted:
            self._noted.add(row)
            above.insert(0, self.source.alone[row])
            row -= 1
        if statement.lineno in self.source.behind and statement.lineno not in self._noted:
            self._noted.add(statement.lineno)
            above.append(self.source.behind[statement.lineno])
        if above:
            self.lines += fits(" ".join(above), "    " * self._depth)

    def _pass(self, statement: ast.Pass) -> None:
        pass

    def _break(self, statement: ast.Break) -> None:
        self.emit("break;")

    def _continue(self, statement: ast.Continue) -> None:
        self.emit("continue;")

    def _expr(self, statement: ast.Expr) -> None:
        value = self.expression(statement.value)
        if value.code and not (isinstance(value.type, Known) and value.type.value is not None):
            self.emit(f"{value.code};")

    def _return(self, statement: ast.Return) -> None:
        if statement.value is None:
            self.emit("return;")
            return
        value = self.expression(statement.value)
        if isinstance(value.type, Known) and value.type.value is None:
            self.emit("return;")
            return
        value = self.as_number(value)
        if isinstance(value.type, Several):
            before = self.returns.items if isinstance(self.returns, Several) else value.type.items
            items = tuple(_wider(a, b) for a, b in zip(before, value.type.items, strict=True))
            value = dataclasses.replace(value, type=Several(items))
            name = self.translator.several(items)
            if value.code.startswith("{"):
                value = dataclasses.replace(value, code=f"({name}){value.code}")
        self.returns = value.type if not isinstance(value.type, Array) else dataclasses.replace(value.type, const=False)
        if isinstance(value.type, Array):
            assert value.element is not None
            if not value.type.sizes:
                self.emit(f"return {value.element(()).code};")
                return
            arrays.fill(self, kinds.variable(value.type, "result"), value)
            return
        self.emit(f"return {value.code};")

    def _if(self, statement: ast.If) -> None:
        test = self.truth(statement.test)
        if isinstance(test.type, Known):  # settled here
            self.statements(statement.body if test.type.value else statement.orelse)
            return
        self.emit(f"if ({test.code}) {{")
        self._block(statement.body, statement)
        if statement.orelse:
            self.emit("} else {")
            self._block(statement.orelse, statement)
        self.emit("}")

    def _block(self, body: Sequence[ast.stmt], whole: ast.AST) -> None:
        self._depth += 1
        self._blocks.append(ast.Module(list(body), []))
        self.statements(body)
        self._blocks.pop()
        self._depth -= 1

    def _for(self, statement: ast.For) -> None:
        call = statement.iter
        if not isinstance(call, ast.Call):
            self._for_each(statement, self.expression(call))
            return
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and isinstance(statement.target, ast.Name)):
            raise UntranslatableError(f"for ... in {ast.unparse(call)}: only range has a C")
        bounds = [self.expression(one) for one in call.args]
        if len(bounds) == 1 and isinstance(bounds[0].type, Known) and bounds[0].type.value == kinds.BATCH:
            self.names[statement.target.id] = Value(kinds.VEHICLE)  # one vehicle: a loop run once
            jumps = any(isinstance(node, ast.Continue | ast.Break) for node in ast.walk(statement))
            if jumps:
                self.emit("do {")
            self._depth += jumps
            self.statements(statement.body)
            self._depth -= jumps
            if jumps:
                self.emit("} while (0);")
            return
        step = bounds[2].known if len(bounds) == 3 else 1
        start, stop = (bounds[0].code, bounds[1].code) if len(bounds) > 1 else ("0", bounds[0].code)
        own = kinds.safe(statement.target.id) if statement.target.id != "_" else self.fresh("n")
        compare, change = (
            ("<", f"{own}++")
            if step == 1
            else ("<" if step > 0 else ">", f"{own} += {step}" if step > 0 else f"{own} -= {-step}")
        )
        self.emit(f"for (int64_t {own} = {start}; {own} {compare} {stop}; {change}) {{")
        self.names[statement.target.id] = Value(INT, own)
        self._block(statement.body, statement)
        self.emit("}")

    def _for_each(self, statement: ast.For, numbers: Value) -> None:
        """Loop over a tuple of numbers, a table in C."""
        held = numbers.type.value if isinstance(numbers.type, Known) else None
        if not isinstance(held, tuple) or not isinstance(statement.target, ast.Name) or ":" not in numbers.code:
            raise UntranslatableError(
                f"for ... in {ast.unparse(statement.iter)}: only range and named tuples of numbers have a C"
            )
        module, _, name = numbers.code.partition(":")
        index, own = self.fresh("n"), kinds.safe(statement.target.id)
        self.emit(f"for (int64_t {index} = 0; {index} < {len(held)}; {index}++) {{")
        self.emit(f"    const double {own} = {self.translator.constant(name, held, module)}[{index}];")
        self.names[statement.target.id] = Value(REAL, own)
        self._block(statement.body, statement)
        self.emit("}")

    def _while(self, statement: ast.While) -> None:
        self.emit(f"while ({self.truth(statement.test).code}) {{")
        self._block(statement.body, statement)
        self.emit("}")


def _wider(a: Type, b: Type) -> Type:
    if isinstance(a, Known) or isinstance(b, Known):
        numbers = [t for t in (a, b) if not isinstance(t, Known)]
        return numbers[0] if numbers else a
    return REAL if {a, b} == {INT, REAL} else b
