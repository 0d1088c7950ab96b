"""What may stand in the network of a policy: looked at before onnxruntime does, whose native code nothing can interrupt.

Refused are data in other files (which would be read from this machine), graphs within graphs (loops, scans, branches),
functions, sequences, and operators of others. Format: `onnx.proto` of ONNX, as Protocol Buffers on the
wire: fields of a number, a wire type and a value.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from wsp_env.parameters.quantity import ParameterError

INPUT = "observation"

#: The same of a network that remembers.
MEMORY_INPUT = "memory"
MEMORY_OUTPUT = {
    "remembered": "(N, M), to be given as the input memory with the next observation; zeros at the start of a stop"
}

#: From observations (N, size) and memory (N, M), both float32, to commands (N, axles) and memory.
Infer = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

OPEN = -1  # columns that a network does not say
_LARGEST_MEMORY = 100_000  # columns of what a network remembers (assumption)
_DOMAINS = ("", "ai.onnx")
_REFUSED = ("Loop", "Scan", "If")  # and all of sequences and optional values
_LARGEST_BYTES = 100_000_000  # of a network; those of this project have some 100 thousand

Value = int | memoryview


def open_network(content: bytes, size: int, axles: int) -> tuple[Infer, int]:
    """Return what runs a network, and how many numbers it remembers; `ValueError` with a clause for one that does not fit.

    Parameters
    ----------
    size : numbers of an observation
    axles : of the vehicle, each with a command

    """
    try:
        import onnxruntime
    except ImportError as error:
        raise ParameterError("running a policy needs onnxruntime: pip install 'wsp-env[export]'") from error
    try:
        check_network(content)
    except ValueError as error:
        raise ValueError(f"is refused: {error}") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # so small a network is slower on more
    options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"], enable_fallback=0)
    except Exception as error:  # onnxruntime has no common base of its errors
        raise ValueError(f"cannot be loaded: {error}") from None
    given = {item.name: _columns(item) for item in session.get_inputs()}
    made = {item.name: _columns(item) for item in session.get_outputs()}
    memory = given.get(MEMORY_INPUT, 0)
    remembers = [MEMORY_INPUT] if MEMORY_INPUT in given else []
    wanted = ["command", *(MEMORY_OUTPUT if remembers else ())]
    fits = given == {INPUT: size} | dict.fromkeys(remembers, memory) and 0 <= memory <= _LARGEST_MEMORY
    fits &= made.get("command") in (axles, OPEN) and all(made.get(name) in (memory, OPEN) for name in wanted[1:])
    if not fits:
        raise ValueError(
            f"takes columns {given} and gives {made}, expected {INPUT} (N, {size}) and the output "
            f"{' and '.join(wanted)}: tables of floats"
        )

    def infer(observation: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not remembers:
            return session.run(wanted, {INPUT: observation})[0], memory
        command, remembered = session.run(wanted, {INPUT: observation, MEMORY_INPUT: memory})
        return command, remembered

    return infer, memory


def _columns(item: Any) -> int:
    """Return the columns of a network's input or output that is a table of floats, `OPEN` where they are; -2 for no table."""
    if item.type != "tensor(float)" or not isinstance(item.shape, list) or len(item.shape) != 2:
        return -2
    return item.shape[1] if isinstance(item.shape[1], int) else OPEN


def check_network(content: bytes) -> None:
    """Raise `ValueError` with a clause that says why a network is refused."""
    if len(content) > _LARGEST_BYTES:
        raise ValueError(f"it is larger than {_LARGEST_BYTES} bytes")
    graphs = 0
    for number, value in _fields(memoryview(content)):
        if number == 7 and isinstance(value, memoryview):  # ModelProto.graph
            graphs += 1
            _check_graph(value)
        if number == 25:  # .functions
            raise ValueError("it holds functions of its own")
    if graphs != 1:
        raise ValueError("it holds no graph")


def _check_graph(graph: memoryview) -> None:
    for number, value in _fields(graph):
        if not isinstance(value, memoryview):
            continue
        if number == 1:  # GraphProto.node
            _check_node(value)
        elif number == 5:  # .initializer
            _check_tensor(value)
        elif number == 15:  # .sparse_initializer
            raise ValueError("it holds sparse numbers")


def _check_node(node: memoryview) -> None:
    texts = {4: "", 7: ""}  # NodeProto.op_type, .domain
    for number, value in _fields(node):
        if not isinstance(value, memoryview):
            continue
        if number in texts:
            texts[number] = bytes(value).decode("utf-8", errors="replace")
        elif number == 5:  # .attribute
            for kind, held in _fields(value):
                if kind in (6, 11):  # AttributeProto.g, .graphs
                    raise ValueError("it holds a graph within a graph (a loop, a scan or a branch)")
                if kind in (5, 10) and isinstance(held, memoryview):  # .t, .tensors
                    _check_tensor(held)
                if kind in (22, 23):  # .sparse_tensor, .sparse_tensors
                    raise ValueError("it holds sparse numbers")
    operator, domain = texts[4], texts[7]
    if domain not in _DOMAINS:
        raise ValueError(f"it needs the operator {operator!r} of {domain!r}")
    if operator in _REFUSED or "Sequence" in operator or operator.startswith("Optional"):
        raise ValueError(f"it holds the operator {operator!r}")


def _check_tensor(tensor: memoryview) -> None:
    for number, value in _fields(tensor):
        if number == 13 or (number == 14 and value != 0):  # TensorProto.external_data, .data_location
            raise ValueError("it keeps numbers in other files")


def _fields(message: memoryview) -> Iterator[tuple[int, Value]]:
    """Iterate over the fields of a message: number and value; `ValueError` for a damaged one."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == 0:
            value, at = _varint(message, at)
            yield number, value
            continue
        if kind == 2:
            size, at = _varint(message, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise ValueError("it is damaged")
        if at + size > len(message):
            raise ValueError("it is damaged: it ends too early")
        yield number, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            break
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("it is damaged")
