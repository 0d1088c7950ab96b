"""Physics beyond the seed paper's model; each mechanism is one card in one file (see `wsp_env.plant.card`).

A mechanism declares its parameters (unit, bounds, null value, source), acts in slots of the plant, and states its effect on the
residuals of a recording. At its null value it vanishes exactly. To add a mechanism, write its file and add its name below.
Other packages name their module in an entry point of group "wsp_env.mechanisms".
"""

import importlib
import math
from collections import namedtuple
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from wsp_env.compiled import generated, third_party_mechanisms
from wsp_env.parameters.quantity import ParameterError, check, shown
from wsp_env.plant.card import Card, check_card
from wsp_env.plant.card import recalls as card_recalls

_FILES = (
    "leading_axle_cleaning",
    "contaminant_memory",
    "adhesion_patch",
    "speed_dependent_friction",
    "recovery_shape",
    "flash_temperature",
    "load_transfer",
    "pad_friction",
    "brake_gain_imbalance",
    "track_gradient",
    "aerodynamic_drag",
    "vehicle_mass",
    "non_adhesive_brake",
    "initial_slope",
    "falling_friction",
    "wheel_radius",
    "wheel_speed_lag",
    "clock_offset",
    "sanding",
    "coupler_force",
    "rail_drift",
    "wheelset_inertia",
    "brake_delay",
    "dragging_brake",
    "blended_brake",
    "discovered",
    "misread_speed",
    "misread_wheel",
)


def _cards() -> dict[str, Card]:
    found: dict[str, Card] = {}
    for module in [*(f"{__name__}.{file}" for file in _FILES), *third_party_mechanisms()]:
        try:
            card = importlib.import_module(module).CARD
        except (ImportError, AttributeError) as error:
            raise ParameterError(f"mechanism in {module}, an entry point of group wsp_env.mechanisms: {error}") from error
        check_card(card, module)
        if card.name in found:
            raise ParameterError(f"{module}: there is a mechanism {card.name} already; give its card another name")
        found[card.name] = card
    return found


#: The cards of all mechanisms by name.
ALL: dict[str, Card] = _cards()

#: The mechanisms of known physics, which a diagnosis may name.
LIBRARY: dict[str, Card] = {name: card for name, card in ALL.items() if card.named}

if TYPE_CHECKING:
    Mechanisms: TypeAlias = Any
    Derived: TypeAlias = Any
    Memory: TypeAlias = Any
else:
    #: The parameters of all mechanisms, one record each, for compiled code.
    Mechanisms = namedtuple("Mechanisms", ALL)
    #: The quantities that mechanisms derive from the vehicle, and their states.
    Derived = namedtuple("Derived", [name for name, card in ALL.items() if card.derive])
    Memory = namedtuple("Memory", [name for name, card in ALL.items() if card.memory])


class Active(NamedTuple):
    """The mechanisms of one vehicle, in the form that the slots use."""

    parameters: Mechanisms
    derived: Derived
    memory: Memory


def make(choice: Mapping[str, Mapping[str, float]] | None = None) -> Mechanisms:
    """Return the parameter records, with the mechanisms of `choice` on and all others at their null value.

    `choice` maps a mechanism to its parameters. Omitted parameters have their typical value: `{"load_transfer": {}}` switches
    load transfer on with the values from the literature. `ParameterError` names an unknown mechanism or parameter, and the
    valid names.
    """
    choice = dict(choice or {})
    unknown = sorted(set(choice) - set(ALL))
    if unknown:
        raise ParameterError(f"unknown mechanism {', '.join(unknown)}; valid: {', '.join(ALL)}")
    records: dict[str, Any] = {name: _record(ALL[name], given) for name, given in choice.items()}
    return NULL._replace(**records)


def _record(card: Card, given: Mapping[str, float]) -> tuple[float, ...]:
    names = [parameter.name for parameter in card.parameters]
    if not isinstance(given, Mapping):
        raise ParameterError(f"mechanism {card.name} = {shown(given)} must be a dictionary of any of {', '.join(names)}")
    wrong = sorted(set(given) - set(names))
    if wrong:
        raise ParameterError(f"mechanism {card.name} has no parameter {', '.join(wrong)}; valid: {', '.join(names)}")
    values = []
    for parameter in card.parameters:
        value = given.get(parameter.name, parameter.typical)
        metadata = {"low": parameter.low, "high": parameter.high, "unit": parameter.unit, "open_low": False}
        check(f"mechanism {card.name}: {parameter.name}", value, metadata)
        if parameter.whole and value != math.floor(value):
            least = f"{parameter.low:g}"
            raise ParameterError(f"mechanism {card.name}: {parameter.name} = {value:g} must be a whole number, from {least}")
        values.append(float(value))
    record: tuple[float, ...] = card.record(*values)
    return record


def at_stop(choice: Mapping[str, Mapping[str, float]], earlier: int) -> Mapping[str, Mapping[str, float]]:
    """Return `choice` after a number of earlier stops on the same rail; unchanged if no mechanism depends on this number."""
    counts = {name: [one.name for one in ALL[name].parameters if one.kind == "stop"] for name in choice}
    if not any(counts.values()):
        return choice
    return {name: {**given, **dict.fromkeys(counts[name], float(earlier))} for name, given in choice.items()}


def check_axles(mechanisms: Mechanisms, axles: int) -> None:
    """Raise `ParameterError` if a mechanism that is on concerns an axle that the vehicle does not have."""
    for card, record, null in zip(ALL.values(), mechanisms, NULL, strict=True):
        for parameter, value in zip(card.parameters, record, strict=True):
            if parameter.kind == "axle" and record != null and value > axles:
                raise ParameterError(f"mechanism {card.name}: axle = {value:g}, but the vehicle has {axles}")


#: All mechanisms off.
NULL: Mechanisms = Mechanisms(*(card.record(*(parameter.null for parameter in card.parameters)) for card in ALL.values()))

#: Length of a row, the number of parameters of all mechanisms.
ROW = sum(len(record) for record in NULL)


def row(mechanisms: Mechanisms) -> np.ndarray:
    """Return all parameters one after another (ROW,); a batch stores one row for each stop."""
    return np.array([value for record in mechanisms for value in record])


def _reader() -> Any:
    """Return the kernel (rows, i) -> `Mechanisms` from rows (N, ROW)."""
    column, records = 0, []
    for name, null in zip(ALL, NULL, strict=True):
        records.append(f"{name}({', '.join(f'rows[i, {column + j}]' for j in range(len(null)))})")
        column += len(null)
    source = f"def read(rows, i):\n    return Mechanisms({', '.join(records)})\n"
    return generated("read", source, {"Mechanisms": Mechanisms} | {name: card.record for name, card in ALL.items()})


#: Compiled: (rows (N, ROW), i) -> the `Mechanisms` of row i.
mechanisms_at = _reader()


def believed_to_true(slot: str, mechanisms: Mechanisms, believed: Any) -> Any:
    """Return a quantity that is constant in a stop, after all mechanisms that act on it.

    The slots are "mass", "gradient", "radii", "inertia", "law" and "tau". `ParameterError` if a mechanism that is on acts on a
    quantity that the vehicle's traction law does not have.
    """
    for name, card in ALL.items():
        record = getattr(mechanisms, name)
        if slot not in card.acts or record == getattr(NULL, name):
            continue
        try:
            believed = card.acts[slot](record, believed)
        except (AttributeError, TypeError, ValueError):  # the record has no such field
            if slot != "law":
                raise
            what = f"the traction law has nothing that it acts on ({type(believed).__name__}); take the degraded law"
            raise ParameterError(f"mechanism {name}: {what}") from None
    return believed


def recalls(mechanisms: Mechanisms) -> bool:
    """Whether a mechanism that is on depends on the contacts' friction work so far."""
    return any(card_recalls(card, record) for card, record in _on(mechanisms))


def work_moves(mechanisms: Mechanisms) -> bool:
    """Whether a mechanism that depends on this work changes brake torques or the force on the vehicle."""
    both = (card_recalls(card, record) and not _FORCES.isdisjoint(_slots(card, record)) for card, record in _on(mechanisms))
    return any(both)


def acting(mechanisms: Mechanisms) -> set[str]:
    """Return the slots in which the mechanisms that are on act."""
    return {slot for card, record in _on(mechanisms) for slot in _slots(card, record)}


def acting_in(slots: Set[str], mechanisms: Mechanisms) -> Mechanisms:
    """Return the mechanisms, with those switched off that act in none of the given slots."""
    off = {card.name: getattr(NULL, card.name) for card, one in _on(mechanisms) if slots.isdisjoint(_slots(card, one))}
    return mechanisms._replace(**off)


def beside_calipers(mechanisms: Mechanisms) -> Mechanisms:
    """Return the mechanisms, with those switched off that no torque beside the calipers comes from."""
    off = {card.name: getattr(NULL, card.name) for card, _ in _on(mechanisms) if not card.signature.beside_calipers}
    return mechanisms._replace(**off)


_FORCES = frozenset({"torque_factor", "torque", "force"})


def _slots(card: Card, record: Any) -> Iterable[str]:
    return card.acting(record) if card.acting else card.acts


def _on(mechanisms: Mechanisms) -> list[tuple[Card, Any]]:
    return [(card, one) for card, one, null in zip(ALL.values(), mechanisms, NULL, strict=True) if one != null]


def derive(vehicle: Any) -> Derived:
    """Return the quantities that mechanisms derive from a vehicle."""
    return Derived(*(card.derive(vehicle) for card in ALL.values() if card.derive))


def remember(n: int, axle_positions_m: Sequence[float]) -> Memory:
    """Return the states of the mechanisms for n vehicles, all zero."""
    return Memory(*(card.memory(n, axle_positions_m) for card in ALL.values() if card.memory))
