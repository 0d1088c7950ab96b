"""Terms without a name that the search tries: a coefficient times a feature, in one slot of the plant, on some axles.

They compete with the library's names under the same principle. See `wsp_env.plant.mechanisms.terms` for slots and features.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import ADHESION
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.replica import Replica
from wsp_env.plant.mechanisms.discovered import TERMS
from wsp_env.plant.mechanisms.term_words import FEATURES, SLOTS, axles_of, equation_of, mask_of
from wsp_env.plant.mechanisms.term_words import looks_like as physics_of
from wsp_env.plant.mechanisms.terms import UNBOUNDED, Feature, Slot, Term

NAME = "discovered"

#: Finite-difference steps of a coefficient by slot, for a feature of size 1 [N m], [-], [-], [N]: small against a stop's own.
_STEPS = {Slot.BRAKE_TORQUE: 100.0, Slot.FRICTION: 0.02, Slot.RECOVERY: 0.1, Slot.VEHICLE_FORCE: 200.0}
#: Usual sizes of features that are far from 1, in their units: for the steps alone.
_USUAL = {Feature.SLIP: 3.0, Feature.WHEEL_RATE: 3.0, Feature.TIME: 15.0, Feature.BRAKING_TIME: 15.0}
#: Widths of bumps along the track, of a curve and of a grade, and how far apart they are tried [m]: a force that lies between
#: two keeps half of its evidence and more.
_BUMPS_M, _APART_M = (150.0, 300.0), 75.0

_ONE = ((1.0, 1.0),)
#: Features tried in each slot with their scales: on all axles together, and on each axle alone; those that have a name in the
#: library are left to it, and what wheels' treads differ by, an axle's friction or recovery as a whole, to normal variation.
#: Friction by the rate of the
#: slip is not tried: whatever moves the friction moves the wheel, so that in a closed loop any noise of friction looks like it.
_TOGETHER: dict[Slot, dict[Feature, tuple[tuple[float, float], ...]]] = {
    Slot.BRAKE_TORQUE: {
        Feature.SLIP: _ONE, Feature.BRAKING_TIME: _ONE, Feature.WHEEL_DIFFERENCE: _ONE, Feature.WORK: _ONE,
        Feature.WHEEL_SINE: _ONE,
    },
    Slot.FRICTION: {
        Feature.BRAKING_TIME: _ONE, Feature.WORK: _ONE, Feature.WHEEL_DIFFERENCE: _ONE, Feature.TORQUE: _ONE,
        Feature.BUILT_UP: ((0.5, 0.6), (0.5, 1.2), (1.5, 0.6), (1.5, 1.2)),
    },
    Slot.RECOVERY: {Feature.SPEED: _ONE, Feature.BRAKING_TIME: _ONE, Feature.WORK: _ONE},
    Slot.VEHICLE_FORCE: {Feature.TIME: _ONE, Feature.BRAKING_TIME: _ONE},
}  # fmt: skip
_EACH: dict[Slot, dict[Feature, tuple[tuple[float, float], ...]]] = {
    Slot.BRAKE_TORQUE: {Feature.SPEED: _ONE, Feature.BRAKING_TIME: _ONE, Feature.WHEEL_DIFFERENCE: _ONE},
    Slot.FRICTION: {Feature.SPEED: _ONE, Feature.BRAKING_TIME: _ONE},
}


def terms(replica: Replica, n: int) -> list[Variant]:
    """Return what is tried as the n-th term, from 1; nothing beyond the most that a model may hold."""
    if n > TERMS:
        return []
    slides = bool((replica.rows.balance == ADHESION).any())
    blind = replica.campaign.vehicle.torque_is_measured
    return [
        one
        for one in _all(replica, n)
        if not (blind and one.fixed[f"slot_{n}"] == Slot.BRAKE_TORQUE)
        and (slides or one.fixed[f"slot_{n}"] in (Slot.BRAKE_TORQUE, Slot.VEHICLE_FORCE))
    ]


def _all(replica: Replica, n: int) -> Iterator[Variant]:
    for slot, features in _TOGETHER.items():
        for feature, scales in features.items():
            for scale in scales:
                yield _variant(n, slot, (), feature, scale)
    axles = range(1, replica.axles + 1) if replica.axles > 1 else ()
    for slot, features in _EACH.items():
        for feature, scales in features.items():
            for scale in scales:
                for axle in axles:
                    yield _variant(n, slot, (axle,), feature, scale)
    place = replica.rows.place
    for middle in np.arange(place.min(), place.max(), _APART_M):
        for width in _BUMPS_M:
            yield _variant(n, Slot.VEHICLE_FORCE, (), Feature.PLACE_BUMP, (float(middle), width))


def _variant(n: int, slot: Slot, axles: tuple[int, ...], feature: Feature, scale: tuple[float, float]) -> Variant:
    where = f" of axle {axles[0]}" if axles else ""
    parts = [(n, feature)]
    if feature is Feature.WHEEL_SINE and n < TERMS:  # with its cosine: where the wheel stood at the start is not known
        parts.append((n + 1, Feature.WHEEL_COSINE))
    fixed: dict[str, float] = {}
    for k, one in parts:
        fixed |= {
            f"slot_{k}": float(slot), f"axles_{k}": mask_of(axles), f"feature_{k}": float(one), f"scale_{k}": scale[0],
            f"second_scale_{k}": scale[1], f"low_{k}": -UNBOUNDED, f"high_{k}": UNBOUNDED,
        }  # fmt: skip
    family = f"{slot.name.lower()}{where} by {feature.name.lower()}".replace("_", " ")
    steps = (_STEPS[slot] / _USUAL.get(feature, 1.0),) * len(parts)
    return Variant(NAME, tuple(f"coefficient_{k}" for k, _ in parts), fixed, steps, family)


class Words(NamedTuple):
    """A term in words."""

    equation: str
    axles: tuple[int, ...]  # from 1; none for all
    features: tuple[str, ...]


def _numbers(variant: Variant) -> list[str]:
    return [size.removeprefix("coefficient_") for size in variant.sizes if size.startswith("coefficient_")]


def equation(variant: Variant, values: Mapping[str, float]) -> Words:
    """Return a variant that is on in words."""
    found = [Term(*(values[f"{field}_{n}"] for field in Term._fields)) for n in _numbers(variant)]
    features = tuple(
        FEATURES[Feature(int(one.feature))].words.format(scale=one.scale, second_scale=one.second_scale) for one in found
    )
    return Words(", and ".join(map(equation_of, found)), axles_of(found[0].axles), features)


def slot_of(variant: Variant) -> str:
    """Return the slot in words."""
    return SLOTS[Slot(int(variant.fixed[f"slot_{_numbers(variant)[0]}"]))][0]


def looks_like(variant: Variant) -> tuple[str, ...]:
    """Return known physics of that form."""
    n = _numbers(variant)[0]
    return physics_of(variant.fixed[f"slot_{n}"], variant.fixed[f"feature_{n}"])
