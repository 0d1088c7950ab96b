"""The mechanism card: all that the house knows of one mechanism, written in the mechanism's own file.

The plant takes from it where the mechanism acts, the environment its parameters, the diagnosis what it leaves in recordings and
how it is said, the report its words. No other file of the plant, the diagnosis or the report names a mechanism.
"""

import math
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, Literal, NamedTuple

import numpy as np

from wsp_env.compiled import generated, inlined
from wsp_env.parameters.quantity import ParameterError

#: The balances of a recording in which a mechanism may show (see `wsp_env.plant.longitudinal.along`).
BALANCES = ("vehicle", "adhesion", "kinematics", "actuator")

#: What a mechanism may act on.
ACTS_ON = ("contact", "brake", "vehicle", "sensor")

#: Share of the largest torque of one axle from which on its brake counts as applied (assumption).
APPLIED_SHARE = 0.05

#: Circumferential speed [m/s] below which a wheel counts as locked (assumption): its brake torque is a reaction.
LOCKED_MPS = 0.5

#: What the curve of a mechanism may be drawn over.
Over = Literal["slip", "work", "place", "time", "speed", "axle", "deceleration"]


#: The slots in which a mechanism may act, with the arguments that its function there takes after its own (record, what `derive`
#: and `memory` made). Those of the first six are called once a stop and return the true value in place of the believed one;
#: `wsp_env.plant.slots` says what each of the others returns.
SLOTS = {
    "mass": "believed_kg",
    "gradient": "believed",
    "radii": "believed_m",
    "inertia": "believed_kgm2",
    "law": "believed",
    "tau": "believed_m_per_j",
    "before_contact": "i, k, doing",
    "contaminated_friction": "place",
    "friction": "speed",
    "recovered_friction": "speed",
    "layer": "i, k, place, rolled, layer, held",
    "axle_friction": "i, k",
    "recovery": "i, k, tau",
    "contact": "adhesion, slip, speed, load",
    "wheel_load": "i, k, load, mass, deceleration",
    "force": "i, speed, believed, moment",
    "torque_factor": "i, k, wheel_mps, pressure",
    "torque": "i, k, torque, doing",
    "reading": "now, before, last, duration",
    "wheel_speed": "wheel, rate",
    "reading_factor": "k, wheel_mps, time",
    "recorded_speed": "speed, acceleration, time",
    "true_speed": "speed, acceleration, time",
    "after_contact": "i, k, rolled, kept",
    "after_passage": "i, k, passage",
}


class Parameter(NamedTuple):
    """One parameter of a mechanism.

    `kind` is "size" (with all sizes at their null the mechanism vanishes exactly), "shape" (where or how a size acts; means
    nothing while the sizes are null), "axle" (a whole number: the wheelset concerned, from 1) or "stop" (a whole number: how
    many stops came before on the same rail; along a campaign every recording has its own).
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
    rolled: bool = False  # a size: a distance that is rolled, as good as a time
    refit_step: float = 0.0  # of a shape: the step by which a refit moves it; 0: it stays where the search put it
    refit_low: float = -math.inf  # of a shape: the lowest value that a refit tries, where recordings do not show lower ones

    @property
    def whole(self) -> bool:
        """Whether it is a whole number."""
        return self.kind in ("axle", "stop")


class Said(NamedTuple):
    """How one size is said; {size} is the number with its unit, other fields are the parameters and `Signature.words`."""

    parameter: str
    unit: str
    shown: Callable[[float], float]  # the number said, from the parameter; its sign goes into the words
    above: str  # said of a parameter above its null
    below: str = ""  # below it; none where the null is the lower bound


def itself(value: float) -> float:
    """Return the number as it is, for `Said.shown`."""
    return value


def percent(value: float) -> float:
    """Return a share in percent, for `Said.shown`."""
    return 100.0 * value


class Recorded(NamedTuple):
    """What the variants of a mechanism may depend on in a campaign."""

    axles: int
    places_m: np.ndarray  # (n,) where wheels slid, along the track [m]
    swings_hz: tuple[float, ...] = (0.3,)  # at which the vehicle seems to swing


def one_variant(recorded: Recorded) -> list[dict[str, float]]:
    """Return the only variant of a mechanism without axle, place or band."""
    return [{}]


def each_axle(recorded: Recorded) -> list[dict[str, float]]:
    """Return a variant for every axle."""
    return [{"axle": float(k + 1)} for k in range(recorded.axles)]


def all_or_each_axle(recorded: Recorded) -> list[dict[str, float]]:
    """Return a variant for all axles together, 0, and one for every axle."""
    return [{"axle": 0.0}, *(each_axle(recorded) if recorded.axles > 1 else [])]


@inlined
def concerns(axle: float, k: int) -> bool:
    """Whether a parameter `axle`, from 1 or 0 for all, concerns the axle with index k, from 0."""
    return axle == 0.0 or axle == k + 1.0


def which_friction(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return what a mechanism with a share `recovered` changes, for the sentences of `Said`."""
    return {"which": "friction" if values.get("recovered", 1.0) >= 0.5 else "the contaminant layer's friction"}


def whose(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the axle in words, for the sentences of `Said`; 0 stands for all."""
    return {"whose": f"axle {values['axle']:.0f}'s" if values["axle"] else "every axle's"}


def no_words(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return no further fields for the sentences of `Said`."""
    return {}


class RollsFreely(NamedTuple):
    """A size that free rolling measures by itself: the relative change of one wheelset's radius."""

    size: str
    least: float  # [-] from which on it is no normal variation


class OnCreepCurve(NamedTuple):
    """How a mechanism shows in a steady creep curve of one wheel, where a mechanism of the contact may."""

    least_speeds: int = 1  # that the points must have: with fewer it is part of the friction level
    null_at_constant_friction: Mapping[str, float] = {}  # size -> its null where friction is believed constant
    test_if_named: str = ""  # the measurement that would tell more of it; {lowest} and {highest} are creepages measured [-]
    test_if_open: str = ""  # the same where the points leave one of its sizes open
    moved_by_radius: str = ""  # the size that an error of the wheel radius would move


class Signature(NamedTuple):
    """What a mechanism leaves in recordings when a simulation lacks it, and how the diagnosis speaks of it."""

    balances: frozenset[str]  # in which it shows, of `BALANCES`
    trace: str  # the same in words, for people
    acts_on: str  # of `ACTS_ON`
    next_test: str  # the test that would confirm it
    said: tuple[Said, ...]  # its fitted sizes in words
    over: Over = "slip"  # what its curve is drawn over
    swings: bool = False  # it pushes and pulls in turn: it has no mean, so that its largest push matters
    exact: bool = False  # it has one form only: the interval of its size needs no more than noise and nuisances give
    beside_calipers: bool = False  # of a brake: a torque measured at the calipers does not contain it
    least_axles: int = 1  # that a vehicle must have to show it
    least_stops: int = 1  # that a campaign must have to show it
    normal: Mapping[str, float] = {}  # size -> change from its null up to which it is normal variation of sound vehicles
    variants: Callable[[Recorded], list[dict[str, float]]] = one_variant  # its shapes and axles to try
    words: Callable[[Mapping[str, float]], Mapping[str, Any]] = no_words  # further fields for `said`, from the parameters
    # Of one whose only size scales mu_cd by place: (its shapes, places (n,) [m]) -> share of log mu_cd (n,) that it moves.
    friction_pattern: Callable[[Mapping[str, float], np.ndarray], np.ndarray] | None = None
    rolls_freely: RollsFreely | None = None
    creep_curve: OnCreepCurve | None = None  # None: it shows in no steady creep curve


class Passage(NamedTuple):
    """What one axle did in a substep, for mechanisms that remember."""

    before_m: float  # place of the wheel at its start [m]
    after_m: float  # and at its end [m]
    energy_j: float  # friction work of one wheel [J]
    braking_j: float  # work of the axle's brake [J]
    duration_s: float
    torque_nm: float  # of the brake, believed [N m]
    full_torque_nm: float  # the same at full pressure [N m]
    slip_mps: float  # v - r w, mean [m/s]
    force_n: float  # T of the wheelset against the motion [N]; along a recording that at the end, as the next
    turning_nm: float  # J dw/dt [N m]


@inlined
def brakes(passage: Passage) -> bool:
    """Whether the axle's brake was applied."""
    return passage.torque_nm > APPLIED_SHARE * passage.full_torque_nm


class Doing(NamedTuple):
    """What one axle is doing at a moment; causal, from the last substep and the present speeds.

    Slot "before_contact" is told at every sample, with the time since the last one as `duration_s`: what mechanisms remember is
    brought up to date there, or in the slots `after_contact` and `after_passage`. Slot "torque" remembers nothing: the plant's
    step asks it at the start of a substep (`duration_s` 0) and for its end (`duration_s` the substep), with the speeds as at
    its start; along a recording at the sample alone (`duration_s` 0).
    """

    time_s: float  # since the start of the stop
    duration_s: float  # since what mechanisms remember was brought up to date
    speed: float  # of the vehicle [m/s]
    deceleration: float  # of the vehicle [m/s2]
    wheel: float  # speed of the wheelset [rad/s]
    wheel_rate: float  # its rate of change, in the plant that of the last substep [rad/s2]
    slip: float  # v - r w [m/s]
    slip_rate: float  # its rate of change [m/s2]
    place_m: float  # of the axle along the track
    angle_rad: float  # turned by the wheel since the start
    radius_m: float
    axles: float  # number of wheelsets
    mean_wheel: float  # mean speed of all wheelsets [rad/s]
    believed_torque: float  # of the axle's brake [N m]
    full_torque: float  # the same at full pressure [N m]
    contact_work: float  # heat in both contacts of the wheelset so far [J]
    mean_s: float  # time over which a recording's values are means; 0 in the plant [s]


def _doings() -> tuple[Callable[..., None], Callable[..., Doing]]:
    """Return the kernels (doing, rows, j, k), which notes a `Doing` in rows (fields, T, A), and its reverse.

    The reverse, (rows, j, k, duration_s), takes the duration given.
    """
    fields = Doing._fields
    noted = "".join(f"    rows[{n}, j, k] = doing.{name}\n" for n, name in enumerate(fields))
    taken = ", ".join("duration" if name == "duration_s" else f"rows[{n}, j, k]" for n, name in enumerate(fields))
    return (
        generated("note_doing", f"def note_doing(doing, rows, j, k):\n{noted}", {}),
        generated("doing_at", f"def doing_at(rows, j, k, duration):\n    return Doing({taken})\n", {"Doing": Doing}),
    )


note_doing, doing_at = _doings()


class Moment(NamedTuple):
    """When and where a force acts on the vehicle, and whether it brakes."""

    time_s: float  # since the start of the stop
    place_m: float  # of the leading axle along the track
    deceleration: float  # [m/s2]
    braking: float  # believed brake torque over that at full pressure, mean over the axles [-]


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
    study: Mapping[str, float] = {}  # the size at which agents are studied (assumption: a railway may meet it); {}: the typical
    named: bool = True  # False: stands for physics without a name, which the diagnosis finds in another way than by trying it
    longest_step_m: float = math.inf  # between samples of a recording, for one that remembers the rail
    # Whether it asks for the contacts' work so far, with a record that is not null; None: if its slots are told of it.
    recalls: Callable[[Any], bool] | None = None
    acting: Callable[[Any], Set[str]] | None = None  # the slots in which it acts with a record that is not null; None: all

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """The parameters whose null makes it vanish."""
        return tuple(parameter for parameter in self.parameters if parameter.kind == "size")

    def __hash__(self) -> int:
        """Cards are told apart by name."""
        return hash(self.name)


#: Slots that are told of contacts' work.
_TOLD = frozenset({"torque", "before_contact", "after_contact", "after_passage"})


def never(record: Any) -> bool:
    """Return False: for `Card.recalls` of a mechanism that is told of contacts' work, and does not ask for it."""
    return False


def recalls(card: Card, record: Any) -> bool:
    """Whether a mechanism that is on asks for the contacts' work so far."""
    return not _TOLD.isdisjoint(card.acts) if card.recalls is None else card.recalls(record)


def check_card(card: Card, where: str) -> None:
    """Raise `ParameterError` for a card that names a slot, balance or subject that does not exist."""
    wrong = [
        *(set(card.acts) - set(SLOTS)),
        *(card.signature.balances - set(BALANCES)),
        *({card.signature.acts_on} - set(ACTS_ON)),
    ]
    if wrong:
        valid = f"slots: {', '.join(SLOTS)}; balances: {', '.join(BALANCES)}; acts on: {', '.join(ACTS_ON)}"
        raise ParameterError(f"{where}: card {card.name} names {', '.join(sorted(wrong))}, which is none; {valid}")
