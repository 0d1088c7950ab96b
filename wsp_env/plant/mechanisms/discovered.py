"""Physics without a name: up to three terms that a diagnosis found where no mechanism of the library fits.

The card contains codes and coefficients instead of a formula, see `wsp_env.plant.mechanisms.terms`. Discovered terms act in the
plant, are evaluated along recordings and are fitted like any other mechanism. The diagnosis finds them by a separate search.
"""

import math
from collections import namedtuple
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from wsp_env.compiled import generated, inlined, loop
from wsp_env.parameters.quantity import ParameterError
from wsp_env.plant.card import Card, Doing, Moment, Parameter, Recorded, Said, Signature, itself
from wsp_env.plant.mechanisms.term_words import equation_of
from wsp_env.plant.mechanisms.terms import (
    UNBOUNDED,
    Feature,
    Past,
    Slot,
    Term,
    brought_up_to_date,
    concerns,
    feature_value,
    is_of_the_vehicle,
    of_the_vehicle,
)

#: Largest number of terms in a model.
TERMS = 3

#: Lower bound of the friction factor [-] (assumption: keeps the contact law's friction above zero).
LEAST_FRICTION = 0.1

#: Bound of the change of log tau (assumption: from no recovery to immediate recovery, without overflow).
_MOST_LOG = 20.0

_SOURCE = "assumption: a diagnosis finds it"

#: Slots of the plant in which terms act; errors of the recorded speed have a card of their own.
_SLOTS = {
    Slot.BRAKE_TORQUE: "torque", Slot.FRICTION: "axle_friction", Slot.RECOVERY: "recovery", Slot.VEHICLE_FORCE: "force",
}  # fmt: skip

# The codes as integers for compiled code.
_BRAKE_TORQUE, _FRICTION, _RECOVERY, _VEHICLE_FORCE = map(int, _SLOTS)


def _parameters_of_term(n: int) -> tuple[Parameter, ...]:
    first = n == 1
    last_slot, last_feature = float(max(_SLOTS)), float(max(Feature))
    return (
        Parameter(
            f"coefficient_{n}", "of slot / of feature", 0.0, 650.0 if first else 0.0, -1e7, 1e7,
            "assumption: a brake that drags with some 5 % of its full torque", fitted=False,
        ),
        Parameter(f"slot_{n}", "code", 0.0, 0.0, 0.0, last_slot, "terms.Slot", "shape"),
        Parameter(f"axles_{n}", "bit mask", 0.0, 1.0, 0.0, 2.0**52, "1, 2, 4 ... for axles 1, 2, 3 ...; 0: all", "shape"),
        Parameter(f"feature_{n}", "code", 0.0, 0.0, 0.0, last_feature, "terms.Feature", "shape"),
        Parameter(f"scale_{n}", "of feature", 1.0, 1.0, -1e6, 1e6, _SOURCE, "shape"),
        Parameter(f"second_scale_{n}", "of feature", 1.0, 1.0, -1e6, 1e6, _SOURCE, "shape"),
        Parameter(f"low_{n}", "of feature", -UNBOUNDED, -UNBOUNDED, -UNBOUNDED, UNBOUNDED, "range that was recorded", "shape"),
        Parameter(f"high_{n}", "of feature", UNBOUNDED, UNBOUNDED, -UNBOUNDED, UNBOUNDED, "range that was recorded", "shape"),
    )  # fmt: skip


_PARAMETERS = tuple(parameter for n in range(1, TERMS + 1) for parameter in _parameters_of_term(n))

if TYPE_CHECKING:
    Parameters: TypeAlias = Any
else:
    #: The fields of every `Term`, numbered from 1.
    Parameters = namedtuple("Parameters", [parameter.name for parameter in _PARAMETERS])


def _reader() -> Any:
    """Return the kernel (p, n) -> `Term` number n, from 0."""
    lines = []
    for n in range(TERMS):
        fields = ", ".join(f"p.{field}_{n + 1}" for field in Term._fields)
        lines.append(f"    if n == {n}:\n        return Term({fields})\n" if n < TERMS - 1 else f"    return Term({fields})\n")
    return generated("term_at", f"def term_at(p, n):\n{''.join(lines)}", {"Term": Term})


_term_at = _reader()


# State of an axle for each term: its feature at the last sample and the fields of `terms.Past`. With the first term also the
# factors on friction and tau by all terms.
_FEATURE, _PAST, _FRICTION_FACTOR, _TAU_FACTOR, _NOTED = 0, 1, 5, 6, 7


class Noticed(NamedTuple):
    """State of the terms for the A axles of N vehicles; a single array, because compiled code is faster with few arrays."""

    noted: np.ndarray  # (N, A, TERMS, _NOTED)


def memory(n: int, axle_positions_m: Sequence[float]) -> Noticed:
    """Return the state before the first sample."""
    return Noticed(np.zeros((n, len(axle_positions_m), TERMS, _NOTED)))


@inlined
def _is_off(p: Parameters) -> bool:
    return p.coefficient_1 == 0.0 and p.coefficient_2 == 0.0 and p.coefficient_3 == 0.0


@inlined
def _is_on(p: Parameters, slot: float) -> bool:
    return (
        (p.coefficient_1 != 0.0 and p.slot_1 == slot)
        or (p.coefficient_2 != 0.0 and p.slot_2 == slot)
        or (p.coefficient_3 != 0.0 and p.slot_3 == slot)
    )


@inlined
def _past(noticed: Noticed, i: int, k: int, n: int) -> Past:
    noted = noticed.noted
    return Past(noted[i, k, n, 1], noted[i, k, n, 2], noted[i, k, n, 3], noted[i, k, n, 4])


@loop
def _notice(p: Parameters, noticed: Noticed, i: int, k: int, doing: Doing) -> None:
    friction, log = 1.0, 0.0
    for n in range(TERMS):
        term = _term_at(p, n)
        if term.coefficient == 0.0:
            continue
        past = brought_up_to_date(term, _past(noticed, i, k, n), doing)
        value = feature_value(term, past, doing)
        noticed.noted[i, k, n, _FEATURE] = value
        for m, kept in enumerate(past):
            noticed.noted[i, k, n, _PAST + m] = kept
        if concerns(term.axles, k):
            if int(term.slot) == _FRICTION:
                friction += term.coefficient * value
            elif int(term.slot) == _RECOVERY:
                log += term.coefficient * value
    noticed.noted[i, k, 0, _FRICTION_FACTOR] = max(friction, LEAST_FRICTION)
    noticed.noted[i, k, 0, _TAU_FACTOR] = math.exp(min(max(log, -_MOST_LOG), _MOST_LOG)) if log != 0.0 else 1.0


@inlined
def notice(p: Parameters, noticed: Noticed, i: int, k: int, doing: Doing) -> None:
    """Compute the features of axle k, and update their states."""
    if not _is_off(p):
        _notice(p, noticed, i, k, doing)


@loop
def _torque(p: Parameters, noticed: Noticed, i: int, k: int, doing: Doing) -> float:
    added = 0.0
    for n in range(TERMS):
        term = _term_at(p, n)
        if int(term.slot) == _BRAKE_TORQUE and term.coefficient != 0.0 and concerns(term.axles, k):
            past = _past(noticed, i, k, n)
            if doing.duration_s > 0.0:
                past = brought_up_to_date(term, past, doing)
            added += term.coefficient * feature_value(term, past, doing)
    return added


@inlined
def torque(p: Parameters, noticed: Noticed, i: int, k: int, believed_nm: float, doing: Doing) -> float:
    """Brake torque of axle k [N m]."""
    return believed_nm + _torque(p, noticed, i, k, doing) if _is_on(p, _BRAKE_TORQUE) else believed_nm


@inlined
def friction(p: Parameters, noticed: Noticed, i: int, k: int) -> float:
    """Factor on both friction coefficients [-] under axle k."""
    return 1.0 if _is_off(p) else noticed.noted[i, k, 0, _FRICTION_FACTOR]


@inlined
def recovery(p: Parameters, noticed: Noticed, i: int, k: int, tau: float) -> float:
    """Recovery rate [m/J] under axle k."""
    return tau if _is_off(p) else tau * noticed.noted[i, k, 0, _TAU_FACTOR]


@loop
def _force(p: Parameters, noticed: Noticed, i: int, speed: float, moment: Moment) -> float:
    total = 0.0
    for n in range(TERMS):
        term = _term_at(p, n)
        if int(term.slot) != _VEHICLE_FORCE or term.coefficient == 0.0:
            continue
        if is_of_the_vehicle(term.feature):  # at the present time, which may lie between two samples
            total += term.coefficient * of_the_vehicle(term, moment.time_s, moment.place_m, speed, moment.deceleration)
            continue
        value, count = 0.0, 0.0
        for k in range(noticed.noted.shape[1]):
            if concerns(term.axles, k):
                value += noticed.noted[i, k, n, _FEATURE]
                count += 1.0
        total += term.coefficient * value / max(count, 1.0)
    return total


@inlined
def force(p: Parameters, noticed: Noticed, i: int, speed_mps: float, believed_n: float, moment: Moment) -> float:
    """Force against the motion [N]."""
    return _force(p, noticed, i, speed_mps, moment) if _is_on(p, _VEHICLE_FORCE) else 0.0


def by_work(p: Parameters) -> bool:
    """Whether a term depends on friction work."""
    return any(int(one.feature) == Feature.WORK for one in terms_of(p._asdict()))


def acting(p: Parameters) -> set[str]:
    """Return the slots in which the terms act."""
    return {"before_contact", *(_SLOTS[Slot(int(one.slot))] for one in terms_of(p._asdict()))}


def parameters_of(terms: Sequence[Term]) -> dict[str, float]:
    """Return the card's parameters for up to `TERMS` terms; the other terms are null."""
    if len(terms) > TERMS:
        raise ParameterError(f"{len(terms)} terms are too many: a model holds {TERMS}")
    given = {f"{name}_{n}": float(value) for n, term in enumerate(terms, 1) for name, value in term._asdict().items()}
    return {parameter.name: given.get(parameter.name, parameter.null) for parameter in _PARAMETERS}


def terms_of(parameters: Mapping[str, float]) -> list[Term]:
    """Return the terms that are on, from the card's parameters; omitted parameters have their typical value."""
    values = {parameter.name: parameters.get(parameter.name, parameter.typical) for parameter in _PARAMETERS}
    terms = [Term(*(float(values[f"{field}_{n}"]) for field in Term._fields)) for n in range(1, TERMS + 1)]
    return [term for term in terms if term.coefficient != 0.0]


def equation(parameters: Mapping[str, float]) -> str:
    """Return the terms that are on, in words and units."""
    return "; ".join(map(equation_of, terms_of(parameters))) or "nothing"


def no_variants(recorded: Recorded) -> list[dict[str, float]]:
    """Return no variants: terms are not searched by name."""
    return []


CARD = Card(
    name="discovered",
    summary="up to three terms of physics without a name, each a coefficient times a feature of what an axle is doing",
    parameters=_PARAMETERS,
    record=Parameters,
    acts={
        "before_contact": notice,
        "axle_friction": friction,
        "recovery": recovery,
        "force": force,
        "torque": torque,
    },
    memory=memory,
    recalls=by_work,
    acting=acting,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion", "actuator"}),
        trace="whatever no mechanism of the library leaves",
        acts_on="vehicle",
        next_test="a stop in which the feature changes and all else stays",
        said=tuple(
            Said(
                f"coefficient_{n}",
                "",
                itself,
                f"term {n} is {{size}} times its feature",
                f"term {n} is -{{size}} times its feature",
            )
            for n in range(1, TERMS + 1)
        ),
        variants=no_variants,
    ),
    named=False,
)
