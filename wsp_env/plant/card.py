"""The mechanism card: all that the house knows of one mechanism, written in the mechanism's own file.

The plant takes from it where the mechanism acts, the environment its parameters, the diagnosis what it leaves in recordings and
how it is said, the report its words. No other file names a mechanism.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

#: The balances of a recording in which a mechanism may show (see `wsp_env.plant.longitudinal.along`).
BALANCES = ("vehicle", "adhesion", "kinematics", "actuator")

#: What a mechanism may act on.
ACTS_ON = ("contact", "brake", "vehicle", "sensor")


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
    fitted: bool = True  # False: the diagnosis leaves this size to another mechanism, or size, with the same trace
    refit_step: float = 0.0  # of a shape: the step by which a refit moves it; 0: it stays where the search put it


class Said(NamedTuple):
    """How one size is said; {size} is the number with its unit, other fields are those of `Signature.words`."""

    parameter: str
    unit: str
    shown: Callable[[float], float]  # the number said, from the parameter; its sign goes into the words
    above: str  # said of a parameter above its null
    below: str = ""  # below it; none where the null is the lower bound


class Recorded(NamedTuple):
    """What the variants of a mechanism may depend on in a campaign."""

    axles: int
    places_m: np.ndarray  # (n,) where wheels slid, along the track [m]


def one_variant(recorded: Recorded) -> list[dict[str, float]]:
    """Return the only variant of a mechanism without axle, place or band."""
    return [{}]


def each_axle(recorded: Recorded) -> list[dict[str, float]]:
    """Return a variant for every axle."""
    return [{"axle": float(k + 1)} for k in range(recorded.axles)]


def no_words(values: Mapping[str, float]) -> dict[str, Any]:
    """Return no further fields for the sentences of `Said`."""
    return {}


class Signature(NamedTuple):
    """What a mechanism leaves in recordings when a simulation lacks it, and how the diagnosis speaks of it."""

    balances: frozenset[str]  # in which it shows, of `BALANCES`
    trace: str  # the same in words, for people
    acts_on: str  # of `ACTS_ON`
    next_test: str = ""  # the test that would confirm it
    said: tuple[Said, ...] = ()  # its sizes in words
    over: str = "slip"  # what its curve is drawn over
    exact: bool = False  # it has one form only, so that next to nothing of it is left once it was fitted
    least_axles: int = 1  # that a vehicle must have to show it
    normal: Mapping[str, float] = {}  # size -> change from its null that sound vehicles vary by
    variants: Callable[[Recorded], list[dict[str, float]]] = one_variant  # its shapes and axles to try
    words: Callable[[Mapping[str, float]], dict[str, Any]] = no_words  # further fields for `said`, from the parameters
    friction_pattern: Callable[..., np.ndarray] | None = None  # (parameters, places) -> share of log mu_cd that a unit moves


class Passage(NamedTuple):
    """What one axle did in a substep, for mechanisms that remember."""

    before_m: float  # place of the wheel at its start [m]
    after_m: float  # and at its end [m]
    energy_j: float  # friction work of one wheel [J]
    braking_j: float  # work of the axle's brake [J]
    duration_s: float
    torque_nm: float  # of the brake, believed [N m]
    full_torque_nm: float  # the same at full pressure [N m]


class Card(NamedTuple):
    """A mechanism.

    `acts` maps the slots of `wsp_env.plant.slots` to the functions that act there. Compiled ones are marked `@inlined` and take
    the mechanism's record first, then what `derive` made of the vehicle and what `memory` made (if the card has them), then the
    arguments of the slot.
    """

    name: str
    summary: str
    parameters: tuple[Parameter, ...]
    record: Callable[..., Any]  # the NamedTuple of floats that the functions take
    acts: Mapping[str, Callable[..., Any]]
    signature: Signature
    derive: Callable[[Any], Any] | None = None  # Vehicle -> NamedTuple of constants
    memory: Callable[[int, Sequence[float]], Any] | None = None  # n, axle positions (A,) [m] -> NamedTuple of arrays (n, ...)

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """The parameters whose null makes it vanish."""
        return tuple(parameter for parameter in self.parameters if parameter.kind == "size")

    def __hash__(self) -> int:
        """Cards are told apart by name."""
        return hash(self.name)
