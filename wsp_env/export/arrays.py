"""numpy's array expressions in C: loops over the dimensions that C has, one for every statement."""

import ast
from collections.abc import Callable
from typing import Any

from wsp_env.export import kinds
from wsp_env.export.kinds import BATCH, BOOL, INT, REAL, Array, Known, Scalar, UntranslatableError, Value
from wsp_env.export.writer import Writer


def elementwise(function: Callable[..., Value], *values: Value) -> Value:
    """Return the array of what a function of numbers makes of arrays and numbers, broadcast as numpy does."""
    shapes = [value.type.shape for value in values if isinstance(value.type, Array)]
    shape = shapes[0]
    for other in shapes[1:]:
        shape = _broadcast(shape, other)

    def element(at: tuple[str, ...]) -> Value:
        return function(*(_element(value, shape, at) for value in values))

    example = element(tuple("0" for size in shape if size != BATCH))
    kind = example.type
    if isinstance(kind, Known):
        kind = BOOL if isinstance(kind.value, bool) else INT
    assert isinstance(kind, Scalar)
    return Value(Array(kind, shape), element=element)


def _broadcast(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    length = max(len(a), len(b))
    a, b = (1,) * (length - len(a)) + a, (1,) * (length - len(b)) + b
    if any(x != y and 1 not in (x, y) for x, y in zip(a, b, strict=True)):
        raise UntranslatableError(f"shapes {a} and {b} do not go together")
    return tuple(y if x == 1 else x for x, y in zip(a, b, strict=True))


def _element(value: Value, shape: tuple[Any, ...], at: tuple[str, ...]) -> Value:
    """Return the element of a value that is broadcast to `shape`."""
    if not isinstance(value.type, Array):
        return value
    assert value.element is not None
    indices = iter(at)
    given = [next(indices) if size != BATCH else "" for size in shape]
    own = given[len(shape) - len(value.type.shape) :]
    return value.element(tuple("0" if size == 1 else i for i, size in zip(own, value.type.shape, strict=True) if size != BATCH))


def fill(body: Writer, place: Value, value: Value) -> None:
    """Write an array expression, or a number, into an array."""
    assert isinstance(place.type, Array)
    assert place.element is not None
    shape = place.type.shape
    if isinstance(value.type, Array) and _broadcast(shape, value.type.shape) != shape:
        raise UntranslatableError(f"shape {value.type.shape} does not fit into {shape}")
    at = tuple(body.loop(size) for size in place.type.sizes)
    one = _element(value, shape, at)
    body.emit(f"{place.element(at).code} = {body.converted(one, place.type.kind).code};")
    body.end(len(at))


def by_mask(body: Writer, array: Value, index: ast.expr, value: Value) -> bool:
    """Set the elements where a mask says so; False where the index is no mask."""
    if not isinstance(array.type, Array) or isinstance(index, ast.Tuple | ast.Slice | ast.Constant):
        return False
    mask = body.expression(index)
    if not isinstance(mask.type, Array) or mask.type.kind is not BOOL or isinstance(value.type, Array):
        return False
    assert array.element is not None
    full = (*mask.type.shape, *(1,) * (len(array.type.shape) - len(mask.type.shape)))  # a mask of rows
    mask_element = mask.element
    assert mask_element is not None
    count = len(mask.type.sizes)
    wide = Value(Array(BOOL, full), element=lambda at: mask_element(at[:count]))
    at = tuple(body.loop(size) for size in array.type.sizes)
    body.emit(f"if ({_element(wide, array.type.shape, at).code}) {{")
    body.emit(f"    {array.element(at).code} = {body.converted(value, array.type.kind).code};")
    body.emit("}")
    body.end(len(at))
    return True


def subscript(body: Writer, value: Value, index: ast.expr) -> Value:
    """Return an element or a view of an array."""
    assert isinstance(value.type, Array)
    items = index.elts if isinstance(index, ast.Tuple) else [index]
    shape: list[int | str] = []
    sources: list[str | None] = []  # for every dimension that C has of the array: its index, None: a dimension that stays
    rest = list(value.type.shape)
    for item in items:
        if isinstance(item, ast.Constant) and item.value is None:
            shape.append(1)
            continue
        size = rest.pop(0)
        if isinstance(item, ast.Slice):
            if item.lower or item.upper or item.step:
                raise UntranslatableError(f"{ast.unparse(index)}: only whole dimensions")
            shape.append(size)
            if size != BATCH:
                sources.append(None)
            continue
        at = body.expression(item)
        if size == BATCH:
            if at.type != kinds.VEHICLE and not (isinstance(at.type, Known) and at.type.value == 0):
                raise UntranslatableError(f"{value.code}[{ast.unparse(item)}]: vehicles have no index in C")
            continue
        if isinstance(at.type, Array):
            raise UntranslatableError(f"{value.code}[{ast.unparse(item)}]: arrays are no indices in C")
        sources.append(str(at.type.value % int(size)) if isinstance(at.type, Known) else at.code)  # -1 is the last
    shape += rest
    sources += [None] * sum(size != BATCH for size in rest)
    element = value.element
    assert element is not None
    stays = (
        [size != 1 for size in shape if size != BATCH]
        if any(isinstance(i, ast.Constant) and i.value is None for i in items)
        else None
    )

    def picked(at: tuple[str, ...]) -> Value:
        kept = iter([i for i, stay in zip(at, stays, strict=True) if stay] if stays is not None else at)
        return element(tuple(next(kept) if source is None else source for source in sources))

    if not shape or (
        shape == [BATCH] and not any(isinstance(i, ast.Slice) for i in items) and len(items) == len(value.type.shape)
    ):
        return picked(())
    return Value(Array(value.type.kind, tuple(shape)), element=picked)


def method(body: Writer, array: Value, name: str, given: list[Value], named: dict[str, Value]) -> Value:
    """Return what a method of an array makes of it."""
    assert isinstance(array.type, Array)
    if name == "copy" or (name == "reshape" and len(array.type.shape) == 1):
        return array
    if name == "astype":
        kind = {float: REAL, int: INT, bool: BOOL}[given[0].known]
        return elementwise(lambda a: body.converted(a, kind), array)
    if name not in _STARTS and name not in ("argmax",):
        raise UntranslatableError(f"arrays have no {name} in C")
    axis = named.get("axis") or (given[0] if given else None)
    keep = "keepdims" in named and named["keepdims"].known
    return reduced(body, array, name, None if axis is None else axis.known, keep)


_STARTS = ("max", "min", "mean", "sum", "any", "all")


def reduced(body: Writer, array: Value, name: str, axis: int | None, keep: bool = False) -> Value:
    """Return the largest, smallest, mean, first largest ... along the last axis, or of all."""
    assert isinstance(array.type, Array)
    element = array.element
    assert element is not None
    if axis is None:  # one vehicle: over all that is left
        if not array.type.sizes:
            return element(())
        axis = len(array.type.shape) - 1
        shape: tuple[int | str, ...] = ()
    else:
        shape = array.type.shape[:-1]
    if axis not in (-1, len(array.type.shape) - 1) or len(array.type.sizes) != 1:
        raise UntranslatableError(f"{name} along axis {axis} of {array.type.shape}")
    size = array.type.sizes[0]
    kind = {"any": BOOL, "all": BOOL, "argmax": INT}.get(name, array.type.kind)
    own = body.fresh(name)
    first = element(("0",)).code
    body.emit(f"{kind.value} {own} = {'0' if name == 'argmax' else first};")
    at = body.fresh("n")
    body.emit(f"for (int64_t {at} = 1; {at} < {size}; {at}++) {{")
    one = element((at,))
    if name in ("max", "min"):
        helper = f"{name}imum"
        body.translator.helpers.add(helper)
        body.emit(f"    {own} = wsp_{helper}({own}, {one.code});")
    elif name == "argmax":
        best = element((own,))
        above = " > ".join(f"({value.code})" if value.level > 4 else value.code for value in (one, best))
        body.emit(f"    {own} = {above} ? {at} : {own};")
    elif name in ("any", "all"):
        code = f"({one.code})" if one.level > 10 else one.code
        body.emit(f"    {own} = {own} {'||' if name == 'any' else '&&'} {code};")
    else:
        body.emit(f"    {own} += {one.code};")
    body.emit("}")
    code = f"{own} / {size}.0" if name == "mean" else own
    found = Value(REAL if name == "mean" else kind, code, 3 if name == "mean" else 0)
    if not shape:
        return found
    made = (*shape, 1) if keep else shape
    return Value(Array(found.type, made), element=lambda at: found)  # type: ignore[arg-type]  # a scalar


def made(kind: Scalar, shape: tuple[Any, ...], code: str) -> Value:
    """Return an array of equal numbers."""
    return Value(Array(kind, shape), element=lambda at: Value(kind, code))
