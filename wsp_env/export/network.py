"""A policy's network from ONNX to C: one function of float arrays, the weights in tables, no allocation.

Sums run in the order of the weights, where a runtime that works on several numbers at once has another: results differ in the
last digits of a float.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.export.kinds import UntranslatableError
from wsp_env.parameters.quantity import ParameterError

_UNARY = {
    "Tanh": "tanhf({})", "Sigmoid": "1.0f / (1.0f + expf(-{}))", "Relu": "fmaxf({}, 0.0f)", "Exp": "expf({})",
    "Sqrt": "sqrtf({})", "Abs": "fabsf({})", "Neg": "-{}", "Not": "!{}", "Identity": "{}",
}  # fmt: skip
_BINARY = {"Add": "{} + {}", "Sub": "{} - {}", "Mul": "{} * {}", "Div": "{} / {}"}
_TESTS = {
    "Greater": "{} > {}",
    "Less": "{} < {}",
    "GreaterOrEqual": "{} >= {}",
    "LessOrEqual": "{} <= {}",
    "And": "{} && {}",
    "Or": "{} || {}",
}


def network_source(content: bytes, name: str, size: int, outputs: Sequence[str] = ("command",)) -> tuple[str, str]:
    """Return the tables and the function `name`(const float observation[size], float output[], ...) of a network.

    `UntranslatableError` for an operator that is not known here, or a network that remembers.
    """
    try:
        import onnx
        from onnx import numpy_helper
    except ImportError as error:
        raise ParameterError("exporting a policy needs onnx: pip install 'wsp-env[export]'") from error
    graph = onnx.load_from_string(content).graph
    given = [item.name for item in graph.input]
    if given != ["observation"]:
        raise UntranslatableError(f"a network with the inputs {', '.join(given)}: only one of the observation alone has a C")
    writer = _Writer({item.name: numpy_helper.to_array(item) for item in graph.initializer}, size)
    for node in graph.node:
        attributes = {item.name: onnx.helper.get_attribute_value(item) for item in node.attribute}
        writer.node(node.op_type, list(node.input), list(node.output), attributes)
    return writer.text(name, size, outputs)


class _Writer:
    """A network in the making: tensors of one row each."""

    def __init__(self, constants: Mapping[str, np.ndarray], size: int) -> None:
        self._constants = dict(constants)
        self._sizes = {"observation": size}
        self._names = {"observation": "observation"}
        self._bool: set[str] = set()
        self._tables: dict[str, str] = {}
        self._lines: list[str] = []

    def text(self, name: str, size: int, outputs: Sequence[str]) -> tuple[str, str]:
        """Return tables and function."""
        declared = ", ".join(f"float {kept}_out[{self._sizes[kept]}]" for kept in outputs)
        ends = [
            f"    for (int n = 0; n < {self._sizes[kept]}; n++) {{ {kept}_out[n] = {self._names[kept]}[n]; }}"
            for kept in outputs
        ]
        head = f"/* The policy's network. */\nstatic void {name}(const float observation[{size}], {declared})"
        return "\n\n".join(self._tables.values()), "\n".join([head, "{", *self._lines, *ends, "}"])

    def size(self, output: str) -> int:
        """Return the columns of a tensor."""
        return self._sizes[output]

    def node(self, kind: str, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        """Write one operator."""
        method: Callable[..., None] | None = getattr(self, f"_{kind.lower()}", None)
        if kind in _UNARY:
            self._each(outputs[0], inputs, _UNARY[kind], boolean=kind == "Not")
        elif kind in _BINARY:
            self._each(outputs[0], inputs, _BINARY[kind])
        elif kind in _TESTS:
            self._each(outputs[0], inputs, _TESTS[kind], boolean=True)
        elif kind == "Where":
            self._each(outputs[0], inputs, "{} ? {} : {}")
        elif kind in ("Max", "Min"):
            self._each(outputs[0], inputs[:2], f"f{kind.lower()}f({{}}, {{}})")
        elif kind == "Clip":
            self._clip(inputs, outputs[0])
        elif method is not None:
            method(inputs, outputs, attributes)
        else:
            raise UntranslatableError(f"the network's operator {kind} has no C here")

    def _declare(self, output: str, size: int, boolean: bool = False) -> str:
        own = f"t{len(self._names)}"
        self._names[output], self._sizes[output] = own, size
        if boolean:
            self._bool.add(output)
        self._lines.append(f"    {'bool' if boolean else 'float'} {own}[{size}];")
        return own

    def _columns(self, name: str) -> int:
        return self._sizes[name] if name in self._sizes else int(self._constants[name].size)

    def _at(self, name: str, index: str) -> str:
        """Return an element of a tensor, broadcast."""
        if name in self._names:
            return f"{self._names[name]}[{index if self._sizes[name] > 1 else '0'}]"
        values = self._constants[name].reshape(-1)
        return _literal(values[0]) if values.size == 1 else f"{self._table(name)}[{index}]"

    def _table(self, name: str) -> str:
        own = "W_" + "".join(sign if sign.isalnum() else "_" for sign in name).upper()
        if own not in self._tables:
            values = self._constants[name].astype(np.float32)
            rows = values.reshape(-1, values.shape[-1]) if values.ndim > 1 else values.reshape(1, -1)
            text = ",\n".join(_filled(", ".join(map(_literal, row))) for row in rows)
            self._tables[own] = f"static const float {own}[{values.size}] = {{\n{text}\n}};"
        return own

    def _each(self, output: str, inputs: list[str], form: str, boolean: bool = False) -> None:
        size = max(map(self._columns, inputs))
        own = self._declare(output, size, boolean)
        code = form.format(*(self._at(name, "n") for name in inputs))
        self._lines.append(f"    for (int n = 0; n < {size}; n++) {{ {own}[n] = {code}; }}")

    def _clip(self, inputs: list[str], output: str) -> None:
        form = "{}"
        if len(inputs) > 1 and inputs[1]:
            form = f"fmaxf({form}, {_literal(self._constants[inputs[1]].reshape(-1)[0])})"
        if len(inputs) > 2 and inputs[2]:
            form = f"fminf({form}, {_literal(self._constants[inputs[2]].reshape(-1)[0])})"
        self._each(output, inputs[:1], form)

    def _cast(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        if attributes["to"] != 1:
            raise UntranslatableError("the network casts to another type than float")
        self._each(outputs[0], inputs, "(float){}")

    def _gemm(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        weights = self._constants[inputs[1]]
        if attributes.get("transA", 0) or attributes.get("alpha", 1.0) != 1.0 or attributes.get("beta", 1.0) != 1.0:
            raise UntranslatableError("a Gemm of the network is of another form than x W + b")
        if not attributes.get("transB", 0):
            self._constants[inputs[1]] = weights = np.ascontiguousarray(weights.T)
        rows, columns = weights.shape
        table = self._table(inputs[1])
        own = self._declare(outputs[0], rows)
        bias = self._at(inputs[2], "n") if len(inputs) > 2 else "0.0f"
        one = f"{table}[n * {columns} + m] * {self._at(inputs[0], 'm')}"
        self._lines += [
            f"    for (int n = 0; n < {rows}; n++) {{",
            "        float sum = 0.0f;",
            f"        for (int m = 0; m < {columns}; m++) {{ sum += {one}; }}",
            f"        {own}[n] = sum + {bias};",
            "    }",
        ]

    def _split(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        start = 0
        for output, size in zip(outputs, self._constants[inputs[1]].reshape(-1), strict=True):
            self._part(inputs[0], output, start, int(size))
            start += int(size)

    def _slice(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        start, end, axis, step = (int(self._constants[name].reshape(-1)[0]) for name in (inputs[1:] + inputs[-1:])[:4])
        if axis != 1 or step != 1:
            raise UntranslatableError("a Slice of the network is along another axis than the columns")
        size = self._columns(inputs[0])
        start, end = (max(place + size, 0) if place < 0 else min(place, size) for place in (start, end))
        self._part(inputs[0], outputs[0], start, end - start)

    def _part(self, whole: str, output: str, start: int, size: int) -> None:
        """Give columns of a tensor a name of their own."""
        self._names[output] = f"({self._names[whole]} + {start})" if start else self._names[whole]
        self._sizes[output] = size

    def _argmax(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        """Of a table (axles, 3), as `Reshape` has made it."""
        groups = 3
        size = self._columns(inputs[0]) // groups
        own = self._declare(outputs[0], size)
        self._lines += [
            f"    for (int n = 0; n < {size}; n++) {{",
            f"        const float *x = {self._names[inputs[0]]} + {groups} * n;",
            f"        {own}[n] = x[1] > x[0] ? (x[2] > x[1] ? 2.0f : 1.0f) : (x[2] > x[0] ? 2.0f : 0.0f);",
            "    }",
        ]

    def _reshape(self, inputs: list[str], outputs: list[str], attributes: Mapping[str, Any]) -> None:
        self._part(inputs[0], outputs[0], 0, self._columns(inputs[0]))


def _literal(value: Any) -> str:
    text = repr(float(np.float32(value)) if np.asarray(value).dtype == np.float32 else float(value))
    short = str(np.float32(value))
    text = short if np.float32(short) == np.float32(value) else text
    if "inf" in text or "nan" in text:
        return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(text, "NAN")
    return (text if any(sign in text for sign in ".e") else text + ".0") + "f"


def _filled(text: str, width: int = 120) -> str:
    lines, line = [], "   "
    for piece in text.split(", "):
        if len(line) + len(piece) + 2 > width:
            lines.append(line)
            line = "   "
        line += f" {piece},"
    return "\n".join([*lines, line.rstrip(",")])
