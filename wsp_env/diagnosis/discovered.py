"""Terms without a name that the search tries: a coefficient times a feature, in one slot of the plant, on some axles.

They compete with the library's names under the same rules. See `wsp_env.plant.mechanisms.terms` for slots and features.
"""

from collections.abc import Iterator, Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import ACTUATOR, ADHESION
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.replica import Replica
from wsp_env.plant.mechanisms import ALL, misread_speed, misread_wheel
from wsp_env.plant.mechanisms.discovered import TERMS
from wsp_env.plant.mechanisms.term_words import FEATURES, SLOTS, axles_of, equation_of, mask_of, unit_of
from wsp_env.plant.mechanisms.term_words import looks_like as physics_of
from wsp_env.plant.mechanisms.terms import UNBOUNDED, Feature, Slot, Term

#: Cards that hold terms: the numbered terms of the plant, the one error of the recorded speed, and the one of a wheel sensor.
NAME, MISREAD, MISREAD_WHEEL = "discovered", misread_speed.CARD.name, misread_wheel.CARD.name
_ERRORS = {MISREAD: misread_speed.term_of, MISREAD_WHEEL: misread_wheel.term_of}

#: Finite-difference steps of a coefficient by slot, for a feature of size 1 [N m], [-], [-], [N], [m/s], [-]; small against
#: the values in a stop.
_STEPS = {
    Slot.BRAKE_TORQUE: 100.0, Slot.FRICTION: 0.02, Slot.RECOVERY: 0.1, Slot.VEHICLE_FORCE: 200.0, Slot.RECORDED_SPEED: 0.02,
    Slot.WHEEL_READING: 0.002,
}  # fmt: skip
#: Usual sizes of features that are far from 1, in their units; used only for the steps.
_USUAL = {
    Feature.SLIP: 3.0, Feature.WHEEL_RATE: 3.0, Feature.TIME: 15.0, Feature.BRAKING_TIME: 15.0, Feature.SPEED_TIME: 15.0,
}  # fmt: skip
#: Widths of bumps along the track [m] (a curve, a gradient), and the distance of tried positions: a force halfway between two
#: positions keeps at least half of its evidence.
_BUMPS_M, _APART_M = (150.0, 300.0), 75.0

_ONE = ((1.0, 1.0),)
#: Speeds [m/s] above which a wheel sensor that loses pulses is tried; a refit moves them.
_ABOVE_MPS = ((12.0, 1.0), (20.0, 1.0), (28.0, 1.0))
#: Play of a brake rigging as a share of the torque: the share held back while the brake is applied (assumption: a few per
#: cent).
_PLAY = ((0.03, 1.0), (0.045, 1.0), (0.065, 1.0), (0.09, 1.0))
#: Settling times [s], and works of a brake [MJ] within which it dries or warms, from which a refit begins: one short and one
#: long compared with a stop (assumption).
_SETTLING = ((3.0, 1.0), (8.0, 1.0))
_WARMING = ((0.5, 1.0), (2.0, 1.0))
#: Times within which a traction that is cut off late fades out [s], from which a refit begins (assumption).
_FADING_OUT = ((0.7, 1.0), (2.0, 1.0))
#: Steps by which a refit moves the scales of features [of the scale]: those of a bump along the track [m], and the others as a
#: share of their start; scales of further features stay.
_MOVED_M = 10.0
_MOVED = dict.fromkeys((Feature.SETTLING, Feature.TORQUE_SETTLING, Feature.TORQUE_WARMING, Feature.FADING_OUT), 0.2)
#: The same of the speed above which a wheel sensor loses pulses [m/s].
_MOVED_MPS = 1.0
#: Features with their scales by slot, tried on all axles together; `_SOME`: on groups of axles. Features with a name in the
#: library are omitted, and so is the friction or recovery of one axle as a whole, which is normal variation of wheel treads.
_TOGETHER: dict[Slot, dict[Feature, tuple[tuple[float, float], ...]]] = {
    Slot.BRAKE_TORQUE: {
        Feature.SLIP: _ONE, Feature.BRAKING_TIME: _ONE, Feature.WHEEL_DIFFERENCE: _ONE, Feature.WORK: _ONE,
        Feature.TORQUE_SINE: _ONE, Feature.TORQUE_PLAY: _PLAY, Feature.TORQUE_SETTLING: _SETTLING,
        Feature.TORQUE_WARMING: _WARMING, Feature.FADING_OUT: _FADING_OUT,
    },
    Slot.FRICTION: {
        Feature.BRAKING_TIME: _ONE, Feature.WORK: _ONE, Feature.WHEEL_DIFFERENCE: _ONE,
        Feature.BUILT_UP: ((0.5, 0.6), (0.5, 1.2), (1.5, 0.6), (1.5, 1.2)), Feature.SLIP_RATE: ((3.0, 1.0),),
        Feature.SETTLING: _SETTLING,
    },
    Slot.RECOVERY: {Feature.SPEED: _ONE, Feature.BRAKING_TIME: _ONE, Feature.WORK: _ONE},
    Slot.VEHICLE_FORCE: {
        Feature.TIME: _ONE, Feature.BRAKING_TIME: _ONE, Feature.SETTLING: _SETTLING, Feature.FADING_OUT: _FADING_OUT,
    },
    Slot.RECORDED_SPEED: {
        Feature.SPEED_DECELERATION: _ONE, Feature.TIME: _ONE, Feature.SPEED_TIME: _ONE, Feature.SPEED_SQUARED: _ONE,
    },
}  # fmt: skip
#: Features with positive coefficients only. Higher friction speeds up the wheel, so in a closed loop noise of friction looks
#: like friction that falls with the slip rate: only a rise with this rate is informative. Play cannot be negative.
_ABOVE = {(Slot.FRICTION, Feature.SLIP_RATE), (Slot.BRAKE_TORQUE, Feature.TORQUE_PLAY)}
_SOME: dict[Slot, dict[Feature, tuple[tuple[float, float], ...]]] = {
    Slot.BRAKE_TORQUE: {
        Feature.SPEED: _ONE,
        Feature.BRAKING_TIME: _ONE,
        Feature.WHEEL_DIFFERENCE: _ONE,
        Feature.TORQUE_PLAY: _PLAY,
        Feature.TORQUE_SETTLING: _SETTLING,
        Feature.TORQUE_WARMING: _WARMING,
        Feature.FADING_OUT: _FADING_OUT,
    },
    Slot.FRICTION: {Feature.SPEED: _ONE, Feature.BRAKING_TIME: _ONE},
    Slot.WHEEL_READING: {Feature.SPEED: _ONE, Feature.TIME: _ONE, Feature.ALWAYS: _ABOVE_MPS},
}
#: Slots that one term fills, on the axles that it is given.
_ONLY = {Slot.RECORDED_SPEED: MISREAD, Slot.WHEEL_READING: MISREAD_WHEEL}

#: Slots, in words, of terms that act on each wheelset.
OF_WHEELS = frozenset(SLOTS[slot][0] for slot in (Slot.BRAKE_TORQUE, Slot.FRICTION, Slot.RECOVERY))
#: Slot for each object on which a mechanism of the library acts.
_ACTS = {
    "contact": Slot.FRICTION, "brake": Slot.BRAKE_TORQUE, "vehicle": Slot.VEHICLE_FORCE, "sensor": Slot.RECORDED_SPEED,
}  # fmt: skip

#: Features over which a curve is tried if no term holds, by slot.
_CURVES: dict[Slot, tuple[Feature, ...]] = {
    Slot.BRAKE_TORQUE: (Feature.SPEED_TENT, Feature.TIME_TENT),
    Slot.FRICTION: (Feature.SLIP_TENT, Feature.SPEED_TENT, Feature.TIME_TENT),
    Slot.VEHICLE_FORCE: (Feature.SPEED_TENT, Feature.TIME_TENT),
}
_FEWEST_KNOTS = 2  # smallest number of a curve's knots: a line
_TAIL = 0.02  # share of the rows beyond its first knot, and beyond its last


def terms(replica: Replica, accepted: Sequence[Variant] = ()) -> list[Variant]:
    """Return the terms to try in addition to the accepted ones; none if the model is full."""
    n = _next(accepted)
    return list(_all(replica, n, _closed(replica, n, accepted)))


def curves(replica: Replica, accepted: Sequence[Variant] = ()) -> list[Variant]:
    """Return the curves to try if no term holds: over one feature in each slot, with as many tents as there are terms left."""
    n = _next(accepted)
    knots = TERMS + 1 - n
    if knots < _FEWEST_KNOTS:
        return []
    rows, found = replica.rows, []
    seen = {Feature.SPEED_TENT: rows.speed, Feature.SLIP_TENT: rows.slip, Feature.TIME_TENT: rows.time}
    axles = [(), *axle_groups(replica.vehicle.running_gear)]
    for slot, features in _CURVES.items():
        if slot in _closed(replica, n, accepted):
            continue
        for feature in features:
            values = seen[feature][rows.slides | (slot is not Slot.FRICTION)]
            if not len(values):  # friction shows only where wheels slide
                continue
            low, high = np.quantile(values, (_TAIL, 1.0 - _TAIL))
            apart = (high - low) / (knots - 1)
            tents = [(feature, (float(low + k * apart), float(apart))) for k in range(knots)]
            name = f"a curve over {feature.name.removesuffix('_TENT').lower()}"
            groups = axles if slot is not Slot.VEHICLE_FORCE else axles[:1]
            found += [_of(n, slot, group, tents, name, _STEPS[slot]) for group in groups]
    return found


def _next(accepted: Sequence[Variant]) -> int:
    """Return the number of the next term of the plant, from 1."""
    return 1 + sum(len(one.sizes) for one in accepted if one.name == NAME)


def _closed(replica: Replica, n: int, accepted: Sequence[Variant]) -> set[Slot]:
    """Return the slots without trials: the recordings give no information on them, or the model is full."""
    blind = replica.campaign.vehicle.torque_is_measured and not (replica.rows.balance == ACTUATOR).any()
    closed = {Slot.BRAKE_TORQUE} if blind else set()
    if not (replica.rows.balance == ADHESION).any():
        closed |= {Slot.FRICTION, Slot.RECOVERY}
    if n > TERMS:
        closed |= set(Slot) - set(_ONLY)
    return closed | {slot for slot, name in _ONLY.items() if any(one.name == name for one in accepted)}


def _all(replica: Replica, n: int, closed: Set[Slot]) -> Iterator[Variant]:
    for slot, features in _TOGETHER.items():
        if slot in closed:
            continue
        for feature, scales in features.items():
            for scale in scales:
                yield _variant(n, slot, (), feature, scale)
    groups = axle_groups(replica.vehicle.running_gear)
    of_slot: dict[Slot, list[tuple[int, ...]]] = {
        Slot.WHEEL_READING: [one for one in groups if len(one) == 1],  # each axle has a sensor of its own
        Slot.FRICTION: [*groups, *behind_the_first(replica.vehicle.running_gear)],  # which wets or cleans the rail for them
    }
    for slot, features in _SOME.items():
        if slot in closed:
            continue
        for feature, scales in features.items():
            for scale in scales:
                for axles in of_slot.get(slot, groups):
                    yield _variant(n, slot, axles, feature, scale)
    if Slot.VEHICLE_FORCE in closed:
        return
    place = replica.rows.place
    for middle in np.arange(place.min(), place.max(), _APART_M):
        for width in _BUMPS_M:
            yield _variant(n, Slot.VEHICLE_FORCE, (), Feature.PLACE_BUMP, (float(middle), width))


def axle_groups(running_gear: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Return groups of axles, from 1, other than all: each single axle, each bogie, and all leading (second, ...) axles.

    Parameters
    ----------
    running_gear : for each body the numbers of axles of its bogies

    """
    counts = [count for body in running_gear for count in body]
    firsts = np.cumsum([1, *counts[:-1]])
    bogies = [tuple(range(first, first + count)) for first, count in zip(map(int, firsts), counts, strict=True)]
    places = [tuple(bogie[k] for bogie in bogies if k < len(bogie)) for k in range(max(counts))]
    each = [(axle,) for bogie in bogies for axle in bogie]
    whole = sum(counts)
    return [one for one in dict.fromkeys([*each, *bogies, *places]) if len(one) < whole]


def behind_the_first(running_gear: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Return the group of all axles behind the first, from 1, if it is not among `axle_groups`."""
    behind = tuple(range(2, sum(count for body in running_gear for count in body) + 1))
    return [behind] if behind and behind not in axle_groups(running_gear) else []


def _variant(n: int, slot: Slot, axles: tuple[int, ...], feature: Feature, scale: tuple[float, float]) -> Variant:
    step, name = _STEPS[slot] / _USUAL.get(feature, 1.0), feature.name.lower()
    if slot in _ONLY:
        fixed = {"feature": float(feature)}
        if slot is Slot.WHEEL_READING:
            fixed |= {"axles": mask_of(axles), "above_mps": scale[0] if feature is Feature.ALWAYS else 0.0}
        shapes = {"above_mps": _MOVED_MPS} if fixed.get("above_mps") else {}
        return Variant(_ONLY[slot], ("coefficient",), fixed, (step,), _family(slot, axles, name), shapes=shapes)
    parts = [(feature, scale)]
    if feature is Feature.TORQUE_SINE and n < TERMS:  # with its cosine, because the initial wheel angle is unknown
        parts.append((Feature.TORQUE_COSINE, scale))
    return _of(n, slot, axles, parts, name, step, (slot, feature) in _ABOVE)


def _family(slot: Slot, axles: tuple[int, ...], name: str) -> str:
    names = [str(axle) for axle in axles]
    several = f" of axles {', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else ""
    where = several or (f" of axle {names[0]}" if names else "")
    return f"{_said(slot)}{where} by {name}".replace("_", " ")


def _said(slot: Slot) -> str:
    return slot.name.lower().replace("_", " ")


def _of(
    n: int, slot: Slot, axles: tuple[int, ...], parts: Sequence[tuple[Feature, tuple[float, float]]], name: str, step: float,
    above: bool = False,
) -> Variant:  # fmt: skip
    """Return the variant whose terms, numbered from n, are given features with their scales in one slot."""
    fixed: dict[str, float] = {}
    shapes: dict[str, float] = {}
    for k, (feature, scale) in enumerate(parts, n):
        fixed |= {
            f"slot_{k}": float(slot), f"axles_{k}": mask_of(axles), f"feature_{k}": float(feature), f"scale_{k}": scale[0],
            f"second_scale_{k}": scale[1], f"low_{k}": -UNBOUNDED, f"high_{k}": UNBOUNDED,
        }  # fmt: skip
        if feature is Feature.PLACE_BUMP:
            shapes |= {f"scale_{k}": _MOVED_M, f"second_scale_{k}": _MOVED_M}
        elif feature in _MOVED:
            shapes[f"scale_{k}"] = _MOVED[feature] * scale[0]
    sizes = tuple(f"coefficient_{k}" for k in range(n, n + len(parts)))
    return Variant(NAME, sizes, fixed, (step,) * len(parts), _family(slot, axles, name), above, shapes)


class Words(NamedTuple):
    """A term in words."""

    equation: str
    axles: tuple[int, ...]  # from 1; empty for all
    features: tuple[str, ...]


def _terms_in(variant: Variant, values: Mapping[str, float]) -> list[Term]:
    """Return the terms of a variant, from the card's parameters."""
    if variant.name in _ERRORS:
        return [_ERRORS[variant.name]({"coefficient": 0.0} | dict(values))]
    return [Term(*(values.get(f"{field}_{n}", 0.0) for field in Term._fields)) for n in _numbers(variant)]


def _numbers(variant: Variant) -> list[str]:
    """Return the numbers of a variant's terms in the model."""
    return [size.removeprefix("coefficient_") for size in variant.sizes if size.startswith("coefficient_")]


def equation(variant: Variant, values: Mapping[str, float]) -> Words:
    """Return a variant that is on, in words."""
    found = _terms_in(variant, values)
    features = (
        ("running speed",)
        if variant.name == MISREAD_WHEEL and found[0].feature == Feature.ALWAYS
        else tuple(
            FEATURES[Feature(int(one.feature))].words.format(scale=one.scale, second_scale=one.second_scale) for one in found
        )
    )
    return Words(", and ".join(map(equation_of, found)), axles_of(found[0].axles), features)


def unit_in(variant: Variant, parameter: str) -> str:
    """Return the unit of a parameter of a variant."""
    if parameter == "above_mps":
        return "m/s"
    field = parameter.rstrip("_0123456789")
    at = 0 if variant.name in _ERRORS else _numbers(variant).index(parameter.removeprefix(f"{field}_"))
    return unit_of(_terms_in(variant, variant.fixed)[at], field)


def slot_of(variant: Variant) -> str:
    """Return the slot of a variant in words."""
    return SLOTS[Slot(int(_terms_in(variant, variant.fixed)[0].slot))][0]


def slot_of_title(title: str) -> str:
    """Return the slot in words for the title of a candidate: a mechanism of the library or a term."""
    if title in ALL:
        return SLOTS[_ACTS[ALL[title].signature.acts_on]][0]
    return next(words for slot, (words, _) in SLOTS.items() if title.startswith(_said(slot)))


def axles_on(variant: Variant) -> tuple[int, ...]:
    """Return the axles, from 1, on which alone a mechanism or a term acts; none if on all, or on the vehicle."""
    if variant.family:
        return axles_of(_terms_in(variant, variant.fixed)[0].axles)
    first, last = (int(variant.fixed.get(name, 0.0)) for name in ("axle", "last_axle"))
    return tuple(range(first, max(first, last) + 1)) if first else ()


def one_thing(variant: Variant) -> tuple[Slot, tuple[int, ...]] | None:
    """Return the one thing on which a mechanism or a term acts: the brake of some axles, or the sensors of speed; else None."""
    slot = (
        Slot(int(_terms_in(variant, variant.fixed)[0].slot)) if variant.family else _ACTS[ALL[variant.name].signature.acts_on]
    )
    if slot is Slot.RECORDED_SPEED:
        return slot, ()
    return (slot, axles_on(variant)) if slot is Slot.BRAKE_TORQUE and axles_on(variant) else None


def looks_like(variant: Variant) -> tuple[str, ...]:
    """Return known physics of the same form."""
    first = _terms_in(variant, variant.fixed)[0]
    return physics_of(first.slot, first.feature)
