"""What every mechanism says of itself."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Parameter(NamedTuple):
    """One parameter of a mechanism."""

    name: str
    unit: str
    null: float  # the value at which the mechanism vanishes exactly
    typical: float  # taken when the mechanism is switched on without a value
    low: float
    high: float
    source: str


class Mechanism(NamedTuple):
    """A mechanism: its name, its parameters and the trace it leaves in recordings when a simulation lacks it."""

    name: str
    summary: str
    parameters: tuple[Parameter, ...]
    record: Callable[..., Any]  # the NamedTuple that the compiled slot takes
    trace: str  # which residual shows it, and how
