"""What every mechanism says of itself."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Parameter(NamedTuple):
    """One parameter of a mechanism.

    `kind` is "size" (with all sizes at their null the mechanism vanishes exactly), "shape" (where or how a size acts; means
    nothing while the sizes are null) or "axle" (a whole number: the wheelset concerned, from 1).
    """

    name: str
    unit: str
    null: float  # of a size: the value at which it vanishes; of the others: taken while the mechanism is off
    typical: float  # taken when the mechanism is switched on without a value
    low: float
    high: float
    source: str
    kind: str = "size"


class Mechanism(NamedTuple):
    """A mechanism: its name, its parameters and the trace it leaves in recordings when a simulation lacks it."""

    name: str
    summary: str
    parameters: tuple[Parameter, ...]
    record: Callable[..., Any]  # the NamedTuple that the compiled slot takes
    trace: str  # which residual shows it, and how

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """The parameters whose null makes it vanish."""
        return tuple(parameter for parameter in self.parameters if parameter.kind == "size")
