"""Operators, comparisons and conversions, from Python to C, with as few parentheses as C and its compilers ask for."""

import ast
from typing import Any

from wsp_env.export import arrays, kinds, library
from wsp_env.export.kinds import BOOL, INT, REAL, SINGLE, WORD, Array, Known, Scalar, Type, UntranslatableError, Value, known
from wsp_env.export.writer import Writer

#: How tightly an operator binds: a smaller number binds tighter.
_ARITHMETIC: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", 4), ast.Sub: ("-", 4), ast.Mult: ("*", 3), ast.Div: ("/", 3),
    ast.LShift: ("<<", 5), ast.RShift: (">>", 5), ast.BitAnd: ("&", 8), ast.BitXor: ("^", 9), ast.BitOr: ("|", 10),
}  # fmt: skip
_COMPARED: dict[type[ast.cmpop], tuple[str, int]] = {
    ast.Lt: ("<", 6), ast.LtE: ("<=", 6), ast.Gt: (">", 6), ast.GtE: (">=", 6), ast.Eq: ("==", 7), ast.NotEq: ("!=", 7),
}  # fmt: skip
AND, OR, CHOICE = 11, 12, 13


class Operators(Writer):
    """What `Expressions` knows of operators."""

    def truth(self, node: ast.expr) -> Value:
        """Translate a condition."""
        value = self.expression(node)
        if isinstance(value.type, Array) and not value.type.sizes and value.element is not None:
            return value.element(())
        return value

    def number(self, value: float) -> Value:
        """Return a number as a literal."""
        text = kinds.literal(value)
        return Value(REAL, text, 2 if text.startswith("-") else 0, number=value)

    def _binop(self, node: ast.BinOp) -> Value:
        left, right = self.expression(node.left), self.expression(node.right)
        return self.binary(node.op, left, right)

    def binary(self, op: ast.operator, left: Value, right: Value) -> Value:
        """Return what an operator makes of two values."""
        if isinstance(left.type, Array) or isinstance(right.type, Array):
            return arrays.elementwise(lambda a, b: self.binary(op, a, b), left, right)
        if isinstance(left.type, Known) and isinstance(right.type, Known) and not isinstance(op, ast.Div):
            return known(_settled(op, left.known, right.known))
        left, right = self.as_number(left), self.as_number(right)
        if isinstance(op, ast.Pow):
            return self.power(left, right)
        if left.type is BOOL and right.type is BOOL and isinstance(op, ast.BitAnd | ast.BitOr):
            return self.both(left, right) if isinstance(op, ast.BitAnd) else self.either(left, right)
        if isinstance(op, ast.Mod):
            return library.remainder(self, left, right)
        if type(op) not in _ARITHMETIC:
            raise UntranslatableError(f"the operator {type(op).__name__} has no C")
        if isinstance(op, ast.Div):
            left, right = self.converted(left, REAL), self.converted(right, REAL)
        sign, level = _ARITHMETIC[type(op)]
        t = _common(left.type, right.type)
        close = level if level < 5 else 2  # compilers warn of others without parentheses
        return Value(t, f"{shut(left, close)} {sign} {shut(right, min(level - 1, close))}", level)

    def power(self, base: Value, exponent: Value) -> Value:
        """Return a power; a whole known exponent is multiplied out as numba does."""
        whole = exponent.number if exponent.number is not None else None
        if exponent.type is INT and whole is None and exponent.code.isdigit():
            whole = int(exponent.code)
        if exponent.type is INT and whole in (2, 3, 4):
            self.translator.helpers.add(f"power_{whole}")
            return Value(REAL, f"wsp_power_{whole}({self.converted(base, REAL).code})")
        return Value(REAL, f"pow({self.converted(base, REAL).code}, {self.converted(exponent, REAL).code})")

    def both(self, left: Value, right: Value) -> Value:
        """Return a and b."""
        for one, other in ((left, right), (right, left)):
            if isinstance(one.type, Known):
                return other if one.known else known(False)
        return Value(BOOL, f"{shut(left, AND)} && {shut(right, 10)}", AND)

    def either(self, left: Value, right: Value) -> Value:
        """Return a or b."""
        for one, other in ((left, right), (right, left)):
            if isinstance(one.type, Known):
                return known(True) if one.known else other
        return Value(BOOL, f"{shut(left, 10 if left.level != OR else OR)} || {shut(right, 10)}", OR)

    def _boolop(self, node: ast.BoolOp) -> Value:
        values = [self.truth(one) for one in node.values]
        found = values[0]
        for value in values[1:]:
            found = self.both(found, value) if isinstance(node.op, ast.And) else self.either(found, value)
        return found

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        return self.unary(node.op, self.expression(node.operand))

    def unary(self, op: ast.unaryop, value: Value) -> Value:
        """Return what an operator makes of a value."""
        if isinstance(value.type, Array):
            return arrays.elementwise(lambda a: self.unary(op, a), value)
        if isinstance(op, ast.Not | ast.Invert) and (value.type is BOOL or isinstance(value.type, Known)):
            return known(not value.known) if isinstance(value.type, Known) else Value(BOOL, f"!{shut(value, 2)}", 2)
        if isinstance(op, ast.USub):
            if isinstance(value.type, Known):
                return known(-value.known)
            text = shut(value, 2)
            return Value(
                value.type,
                f"-{text}" if not text.startswith("-") else f"-({text})",
                2,
                number=None if value.number is None else -value.number,
            )
        if isinstance(op, ast.UAdd):
            return value
        raise UntranslatableError(f"the operator {type(op).__name__} has no C for {value.code}")

    def _compare(self, node: ast.Compare) -> Value:
        values = [self.expression(one) for one in [node.left, *node.comparators]]
        found = self.compared(node.ops[0], values[0], values[1])
        for op, left, right in zip(node.ops[1:], values[1:], values[2:], strict=False):
            found = self.both(found, self.compared(op, left, right))
        return found

    def compared(self, op: ast.cmpop, left: Value, right: Value) -> Value:
        """Return a comparison."""
        if isinstance(left.type, Array) or isinstance(right.type, Array):
            return arrays.elementwise(lambda a, b: self.compared(op, a, b), left, right)
        if isinstance(op, ast.Is | ast.IsNot):
            nothing = isinstance(left.type, Known) and left.type.value is None
            return known(nothing == isinstance(op, ast.Is))
        if isinstance(left.type, Known) and isinstance(right.type, Known):
            compare: Any = {
                ast.Lt: "__lt__",
                ast.LtE: "__le__",
                ast.Gt: "__gt__",
                ast.GtE: "__ge__",
                ast.Eq: "__eq__",
                ast.NotEq: "__ne__",
            }
            return known(bool(getattr(left.known, compare[type(op)])(right.known)))
        left, right = self.as_number(left), self.as_number(right)
        sign, level = _COMPARED[type(op)]
        return Value(BOOL, f"{shut(left, 4)} {sign} {shut(right, 4)}", level)

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = self.truth(node.test)
        if isinstance(test.type, Known):
            return self.expression(node.body if test.type.value else node.orelse)
        return self.choice(test, self.expression(node.body), self.expression(node.orelse))

    def choice(self, test: Value, yes: Value, no: Value) -> Value:
        """Return one of two values."""
        if isinstance(test.type, Known):
            return yes if test.type.value else no
        yes, no = self.as_number(yes), self.as_number(no)
        t = _common(yes.type, no.type)
        return Value(t, f"{shut(test, OR)} ? {shut(self.converted(yes, t), OR)} : {shut(self.converted(no, t), OR)}", CHOICE)

    def as_number(self, value: Value) -> Value:
        """Return a known number or truth as one of C."""
        if isinstance(value.type, Known) and isinstance(value.type.value, bool):
            return Value(BOOL, value.code)
        if isinstance(value.type, Known) and isinstance(value.type.value, int):
            return Value(INT, value.code, value.level, number=value.type.value)
        if isinstance(value.type, Array) and not value.type.sizes and value.element is not None and value.code:
            return value
        return value

    def converted(self, value: Value, t: Type) -> Value:
        """Return a number as another kind of number; C converts most by itself."""
        value = self.as_number(value)
        if isinstance(value.type, Array) and not value.type.sizes and value.element is not None:
            value = value.element(())
        if value.type == t or not isinstance(t, Scalar):
            return value
        if t is REAL and value.type is INT:
            if value.number is not None and value.code.lstrip("-").isdigit():
                return self.number(float(value.number))
            return Value(REAL, f"(double){shut(value, 2)}", 2)
        if t is SINGLE and value.type is REAL:
            return Value(SINGLE, f"(float){shut(value, 2)}", 2)
        if t in (INT, WORD) and value.type is REAL:
            raise UntranslatableError(f"{value.code} becomes a whole number without being told to")
        return value


def shut(value: Value, level: int) -> str:
    """Return an expression, in parentheses where it binds less tightly than `level`."""
    return f"({value.code})" if value.level > level else value.code


def _common(a: Type, b: Type) -> Type:
    for t in (REAL, SINGLE, WORD, INT, BOOL):
        if t in (a, b):
            return t
    if a == b:
        return a
    raise UntranslatableError(f"{a} and {b} go not together")


def _settled(op: ast.operator, left: Any, right: Any) -> Any:
    done: Any = {
        ast.Add: "__add__", ast.Sub: "__sub__", ast.Mult: "__mul__", ast.Pow: "__pow__", ast.FloorDiv: "__floordiv__",
        ast.Mod: "__mod__", ast.BitAnd: "__and__", ast.BitOr: "__or__", ast.LShift: "__lshift__",
    }  # fmt: skip
    return getattr(left, done[type(op)])(right)
