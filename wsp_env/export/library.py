"""What the translator has for Python's, math's and numpy's functions of numbers."""

import builtins
from collections.abc import Callable
from typing import Any

import numpy as np

from wsp_env.export import arrays
from wsp_env.export.kinds import BATCH, BOOL, INT, REAL, SINGLE, WORD, Array, Known, Scalar, UntranslatableError, Value, known
from wsp_env.export.writer import Writer

#: Helpers in C. As numba has them: of equal or unordered numbers the first stays. numpy's pass nan on.
HELPERS = {
    "min": "static double wsp_min(double a, double b)\n{\n    return b < a ? b : a;\n}",
    "max": "static double wsp_max(double a, double b)\n{\n    return b > a ? b : a;\n}",
    "min_whole": "static int64_t wsp_min_whole(int64_t a, int64_t b)\n{\n    return b < a ? b : a;\n}",
    "max_whole": "static int64_t wsp_max_whole(int64_t a, int64_t b)\n{\n    return b > a ? b : a;\n}",
    "minimum": "static double wsp_minimum(double a, double b)\n{\n    return a <= b || isnan(a) ? a : b;\n}",
    "maximum": "static double wsp_maximum(double a, double b)\n{\n    return a >= b || isnan(a) ? a : b;\n}",
    "finite": (
        "static double wsp_finite(double a, double otherwise)\n{\n"
        "    return isnan(a) ? otherwise : (a > DBL_MAX ? DBL_MAX : (a < -DBL_MAX ? -DBL_MAX : a));\n}"
    ),
    "mod": (
        "static double wsp_mod(double a, double b)\n{\n    double rest = fmod(a, b);\n"
        "    if (rest != 0.0) {\n        return (b < 0.0) != (rest < 0.0) ? rest + b : rest;\n    }\n"
        "    return copysign(0.0, b);\n}"
    ),
    "mod_whole": (
        "static int64_t wsp_mod_whole(int64_t a, int64_t b)\n{\n    int64_t rest = a % b;\n"
        "    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;\n}"
    ),
    "power_2": "static double wsp_power_2(double x)\n{\n    return x * x;\n}",
    "power_3": "static double wsp_power_3(double x)\n{\n    return x * (x * x);\n}",
    "power_4": "static double wsp_power_4(double x)\n{\n    return (x * x) * (x * x);\n}",
}

#: Functions that C has under the same name; with an f behind it for floats.
MATH = frozenset(
    {
        "exp", "expm1", "log", "log1p", "log10", "sqrt", "atan", "atan2", "asin", "acos", "sin", "cos", "tan", "tanh", "sinh",
        "cosh", "hypot", "copysign", "fabs", "pow", "fmod",
    }
)  # fmt: skip
_TESTS = ("isnan", "isfinite", "isinf")
_DTYPES: dict[Any, Scalar] = {bool: BOOL, int: INT, float: REAL, np.float64: REAL, np.float32: SINGLE, np.int64: INT}


def call(body: Writer, held: Any, given: list[Value], named: dict[str, Value]) -> Value | None:
    """Return a call of a function of a library; None for a function that is to be translated."""
    module, name = getattr(held, "__module__", None), getattr(held, "__name__", "")
    if isinstance(held, np.ufunc) or held in (np.where, np.clip, np.nan_to_num):
        return _numpy(body, name, given, named)
    if module == "math":
        return _math(body, name, given)
    if held is np.uint64:
        code = given[0].code if given[0].level == 0 else f"({given[0].code})"
        return given[0] if given[0].type is WORD else Value(WORD, f"(uint64_t){code}", 2)
    if module == "numpy":
        return _array(body, name, given, named)
    if getattr(builtins, name, None) is held and name in _BUILTINS:
        return _BUILTINS[name](body, given)
    return None


def _each(body: Writer, function: Callable[..., Value], given: list[Value]) -> Value:
    if any(isinstance(value.type, Array) for value in given):
        return arrays.elementwise(function, *given)
    return function(*given)


def _math(body: Writer, name: str, given: list[Value]) -> Value:
    texts = [body.converted(value, REAL).code for value in given]
    if name in MATH:
        return Value(REAL, f"{name}({', '.join(texts)})")
    if name in _TESTS:
        return Value(BOOL, f"{name}({texts[0]})")
    if name in ("floor", "ceil"):
        return Value(INT, f"(int64_t){name}({texts[0]})", 2)
    raise UntranslatableError(f"math.{name} has no C here")


def _numpy(body: Writer, name: str, given: list[Value], named: dict[str, Value]) -> Value:
    if name == "where":
        return _each(body, body.choice, given)
    if name == "nan_to_num":
        otherwise = named.get("nan", body.number(0.0))
        return _each(body, lambda a: _helper(body, "finite", a, otherwise), given)
    if name == "clip":
        return _each(body, lambda a, low, high: _helper(body, "minimum", _helper(body, "maximum", a, low), high), given)
    if name in ("maximum", "minimum"):
        return _each(body, lambda a, b: _helper(body, name, a, b), given)
    if name in ("absolute", "abs"):
        return _each(body, lambda a: _absolute(body, [a]), given)
    if name in ("remainder", "mod"):
        return _each(body, lambda a, b: _helper(body, "mod", a, b), given)
    if name in ("arctan", "arctan2"):
        name = name.replace("arc", "a")
    return _each(body, lambda *a: _math(body, name, list(a)), given)


def _array(body: Writer, name: str, given: list[Value], named: dict[str, Value]) -> Value | None:
    dtype = named.get("dtype")
    kind = _DTYPES[dtype.known] if dtype is not None else REAL
    if name in ("zeros", "ones", "empty"):
        return arrays.made(kind, _shape(given[0]), _text(kind, name == "ones"))
    if name in ("zeros_like", "ones_like"):
        like = given[0].type
        assert isinstance(like, Array)
        return arrays.made(like.kind, like.shape, _text(like.kind, name == "ones_like"))
    if name == "full":
        value = body.as_number(given[1])
        assert isinstance(value.type, Scalar)
        return arrays.made(value.type, _shape(given[0]), value.code)
    if name == "arange":
        return Value(Array(INT, (int(given[0].known),)), element=lambda at: Value(INT, at[0]))
    if name == "asarray":  # of a parameter, which is a number in C
        return given[0] if isinstance(given[0].type, Array) else Value(Array(REAL, (BATCH,)), element=lambda at: given[0])
    if name == "any" and isinstance(given[0].type, Scalar):
        return _bool(body, given)
    if name in ("argmax", "any", "all", "max", "min", "mean", "sum", "amax", "amin"):
        return arrays.method(body, given[0], name.removeprefix("a") if name in ("amax", "amin") else name, given[1:], named)
    raise UntranslatableError(f"np.{name} has no C here")


def _text(kind: Scalar, one: bool) -> str:
    if kind is BOOL:
        return "true" if one else "false"
    return ("1" if one else "0") + ("" if kind is INT else ".0")


def _shape(value: Value) -> tuple[Any, ...]:
    shape = value.known
    return shape if isinstance(shape, tuple) else (BATCH if shape == BATCH else int(shape),)


def _helper(body: Writer, name: str, *values: Value) -> Value:
    body.translator.helpers.add(name)
    return Value(REAL, f"wsp_{name}({', '.join(body.converted(value, REAL).code for value in values)})")


def remainder(body: Any, a: Value, b: Value) -> Value:
    """Return a % b as Python and numpy have it: with the sign of b."""
    if REAL not in (a.type, b.type):
        body.translator.helpers.add("mod_whole")
        return Value(INT, f"wsp_mod_whole({a.code}, {b.code})")
    return _helper(body, "mod", a, b)


def _extreme(name: str) -> Callable[[Writer, list[Value]], Value]:
    def found(body: Writer, given: list[Value]) -> Value:
        if len(given) < 2:
            raise UntranslatableError(f"{name} of one argument has no C here")
        if all(isinstance(value.type, Known) for value in given):
            pick: Any = min if name == "min" else max
            return known(pick(value.known for value in given))
        best = given[0]
        for value in given[1:]:
            best = _pair(body, name, best, value)
        return best

    return found


def _pair(body: Writer, name: str, a: Value, b: Value) -> Value:
    a, b = body.as_number(a), body.as_number(b)
    if a.type is INT and b.type is INT:
        body.translator.helpers.add(f"{name}_whole")
        return Value(INT, f"wsp_{name}_whole({a.code}, {b.code})")
    return _helper(body, name, a, b)


def _absolute(body: Writer, given: list[Value]) -> Value:
    value = given[0]
    if isinstance(value.type, Known):
        return known(abs(value.known))
    return Value(REAL, f"fabs({body.converted(value, REAL).code})")


def _float(body: Writer, given: list[Value]) -> Value:
    value = body.as_number(given[0])
    return value if value.type is REAL else Value(REAL, f"(double){value.code if value.level == 0 else f'({value.code})'}", 2)


def _int(body: Writer, given: list[Value]) -> Value:
    value = body.as_number(given[0])
    return value if value.type is INT else Value(INT, f"(int64_t){value.code if value.level == 0 else f'({value.code})'}", 2)


def _round(body: Writer, given: list[Value]) -> Value:
    return Value(INT, f"(int64_t)rint({body.converted(given[0], REAL).code})", 2)


def _len(body: Writer, given: list[Value]) -> Value:
    t = given[0].type
    return known(t.shape[0] if isinstance(t, Array) else len(given[0].known))


def _bool(body: Writer, given: list[Value]) -> Value:
    value = given[0]
    return value if value.type is BOOL else Value(BOOL, f"{value.code} != 0", 7)


_BUILTINS: dict[str, Callable[[Writer, list[Value]], Value]] = {
    "abs": _absolute, "min": _extreme("min"), "max": _extreme("max"), "float": _float, "int": _int, "round": _round,
    "len": _len, "bool": _bool,
}  # fmt: skip
