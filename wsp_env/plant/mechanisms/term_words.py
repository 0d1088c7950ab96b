"""Terms in words: the change, its axles, the feature, and known physics of the same form."""

import math
from typing import NamedTuple

from wsp_env.plant.mechanisms.terms import Feature, Slot, Term


class Described(NamedTuple):
    """A feature in words; {scale} and {second_scale} are replaced by the term's scales."""

    words: str
    unit: str  # "-": dimensionless
    scale: tuple[str, str] = ("", "")  # units of the two scales; "" if the feature has none


#: Slots in words, with the unit of coefficient times feature.
SLOTS: dict[Slot, tuple[str, str]] = {
    Slot.BRAKE_TORQUE: ("brake torque", "N m"),
    Slot.FRICTION: ("friction", "-"),
    Slot.RECOVERY: ("recovery", "-"),
    Slot.VEHICLE_FORCE: ("vehicle force", "N"),
    Slot.RECORDED_SPEED: ("sensor", "m/s"),
    Slot.WHEEL_READING: ("sensor", "-"),
}

FEATURES: dict[Feature, Described] = {
    Feature.BRAKING: Described("while braking", "-"),
    Feature.ALWAYS: Described("always", "-"),
    Feature.SPEED: Described("running speed over 30 m/s", "-"),
    Feature.SPEED_SQUARED: Described("square of running speed over 30 m/s", "-"),
    Feature.SLIP: Described("slip speed", "m/s"),
    Feature.SLIP_SIGN: Described("tanh(slip speed / {scale:g} m/s)", "-", ("m/s", "")),
    Feature.TORQUE: Described("believed torque over full torque", "-"),
    Feature.WHEEL_RATE: Described("the wheel's circumferential acceleration", "m/s2"),
    Feature.TORQUE_MEMORY: Described("(torque lagging by {scale:g} s, less torque) over full torque", "-", ("s", "")),
    Feature.SLIP_RATE: Described("tanh(slip acceleration / {scale:g} m/s2)", "-", ("m/s2", "")),
    Feature.TIME: Described("time since the start", "s"),
    Feature.BRAKING_TIME: Described("time since braking began", "s"),
    Feature.SINE: Described("sin(2 pi {scale:g} Hz t)", "-", ("Hz", "")),
    Feature.COSINE: Described("cos(2 pi {scale:g} Hz t)", "-", ("Hz", "")),
    Feature.WHEEL_SINE: Described("sin({scale:g} x wheel angle)", "-", ("1/turn", "")),
    Feature.WHEEL_COSINE: Described("cos({scale:g} x wheel angle)", "-", ("1/turn", "")),
    Feature.PLACE_BUMP: Described("a bump {second_scale:.0f} m long about {scale:.0f} m along the track", "-", ("m", "m")),
    Feature.WHEEL_DIFFERENCE: Described("circumferential speed beyond the other wheels' mean", "m/s"),
    Feature.WORK: Described("friction work done so far", "MJ"),
    Feature.BUILT_UP: Described(
        "a state that builds up within {scale:g} s of sliding faster than {second_scale:g} m/s", "-", ("s", "m/s")
    ),
    Feature.SPEED_TENT: Described("a tent {second_scale:g} m/s about a speed of {scale:g} m/s", "-", ("m/s", "m/s")),
    Feature.SLIP_TENT: Described("a tent {second_scale:g} m/s about a slip of {scale:g} m/s", "-", ("m/s", "m/s")),
    Feature.TIME_TENT: Described("a tent {second_scale:g} s about {scale:g} s", "-", ("s", "s")),
    Feature.SPEED_DECELERATION: Described("deceleration, times running speed over 30 m/s", "m/s2"),
    Feature.TORQUE_SINE: Described("share of the full torque, times sin({scale:g} x wheel angle)", "-", ("1/turn", "")),
    Feature.TORQUE_COSINE: Described("share of the full torque, times cos({scale:g} x wheel angle)", "-", ("1/turn", "")),
    Feature.TORQUE_PLAY: Described(
        "share of the full torque, minus it while it rises (by more than {scale:.0%})", "-", ("-", "")
    ),
    Feature.SETTLING: Described("a share that dies away within {scale:.3g} s of braking", "-", ("s", "")),
    Feature.TORQUE_SETTLING: Described(
        "share of the full torque, times a share that dies away within {scale:.3g} s of braking", "-", ("s", "")
    ),
    Feature.TORQUE_WARMING: Described(
        "share of the full torque, times a share that dies away within {scale:.3g} MJ of the brake's work", "-", ("MJ", "")
    ),
    Feature.FADING_OUT: Described(
        "a share that is 1 until braking begins and then dies away within {scale:.3g} s", "-", ("s", "")
    ),
    Feature.SPEED_TIME: Described("time since the start, times running speed over 30 m/s", "s"),
}

_SWING = dict.fromkeys((Feature.SINE, Feature.COSINE), ("coupler force", "pitching of the coach"))
_TURN = (Feature.WHEEL_SINE, Feature.WHEEL_COSINE, Feature.TORQUE_SINE, Feature.TORQUE_COSINE)

#: Known physics with the form of a slot and a feature.
LOOKS_LIKE: dict[Slot, dict[Feature, tuple[str, ...]]] = {
    Slot.BRAKE_TORQUE: {
        Feature.BRAKING: ("dragging brake", "offset of the torque or pressure sensor"),
        Feature.ALWAYS: ("dragging brake", "bearing friction"),
        Feature.SPEED: ("pad friction that depends on speed", "blended dynamic brake"),
        Feature.SPEED_SQUARED: ("pad friction that depends on speed", "blended dynamic brake"),
        Feature.SPEED_TENT: ("blended dynamic brake",),
        Feature.SLIP: ("brake gain that changes while sliding",),
        Feature.TORQUE: ("stronger or weaker brake",),
        Feature.WHEEL_RATE: ("wheelset inertia",),
        Feature.TORQUE_MEMORY: ("brake lag", "hysteresis of the brake rigging"),
        Feature.TIME: ("fading of the pads",),
        Feature.BRAKING_TIME: ("fading of the pads",),
        Feature.WHEEL_DIFFERENCE: ("coupled axles",),
        Feature.WORK: ("fading of the pads",),
        Feature.BUILT_UP: ("fading of the pads",),
        Feature.TORQUE_PLAY: ("hysteresis of the brake rigging",),
        Feature.SETTLING: ("wet or icy brake discs", "cold pads"),
        Feature.TORQUE_SETTLING: ("wet or icy brake discs", "cold pads"),
        Feature.TORQUE_WARMING: ("wet or icy brake discs", "cold pads"),
        Feature.FADING_OUT: ("traction that is cut off late",),
    }
    | dict.fromkeys(_TURN, ("torque ripple of an eccentric disc",)),
    Slot.FRICTION: {
        Feature.BRAKING: ("sanding",),
        Feature.BUILT_UP: ("sanding", "third body that builds up"),
        Feature.SPEED: ("friction that depends on speed",),
        Feature.SPEED_SQUARED: ("friction that depends on speed",),
        Feature.SPEED_TENT: ("friction that depends on speed",),
        Feature.SLIP: ("falling friction", "contact temperature"),
        Feature.SLIP_SIGN: ("falling friction",),
        Feature.SLIP_TENT: ("falling friction",),
        Feature.SLIP_RATE: ("friction that depends on the rate of slip", "memory of the contaminant layer"),
        Feature.PLACE_BUMP: ("patch of another adhesion",),
        Feature.WORK: ("wheel tread that is cleaned or heated",),
        Feature.TIME: ("rail that dries or gets wet",),
        Feature.TIME_TENT: ("rail that dries or gets wet",),
        Feature.BRAKING_TIME: ("sanding",),
        Feature.SETTLING: ("wheel tread or rail that dries or is cleaned",),
        Feature.ALWAYS: ("another friction of the wheel tread",),
    }
    | dict.fromkeys(_TURN, ("out-of-round wheel",)),
    Slot.RECOVERY: {
        Feature.ALWAYS: ("cleaning by earlier wheels", "another contaminant"),
        Feature.WORK: ("shape of the recovery",),
        Feature.PLACE_BUMP: ("patch of another contaminant",),
        Feature.TIME: ("contaminant that changes",),
    },
    Slot.VEHICLE_FORCE: {
        Feature.BRAKING: ("track brake", "retarder"),
        Feature.ALWAYS: ("track gradient",),
        Feature.SPEED: ("running resistance",),
        Feature.SPEED_SQUARED: ("aerodynamic drag",),
        Feature.SPEED_TENT: ("track brake within a band of speed",),
        Feature.TORQUE: ("another mass", "coupler force"),
        Feature.PLACE_BUMP: ("curve drag", "change of gradient"),
        Feature.TIME: ("coupler force",),
        Feature.SETTLING: ("coupler force", "brake of another vehicle that applies later"),
        Feature.FADING_OUT: ("traction that is cut off late",),
        Feature.TIME_TENT: ("coupler force",),
    }
    | _SWING,
    Slot.RECORDED_SPEED: {
        Feature.SPEED_DECELERATION: ("radar that pitches with the body",),
        Feature.TIME: ("drift of the speed sensor",),
        Feature.SPEED_TIME: ("drift of the speed sensor's scale",),
        Feature.SPEED_SQUARED: ("speed sensor that is not linear",),
    },
    Slot.WHEEL_READING: {
        Feature.ALWAYS: ("wheel-speed sensor that loses pulses at high speed",),
        Feature.SPEED: ("wheel-speed sensor that is not linear",),
        Feature.TIME: ("drift of a wheel-speed sensor's scale",),
    },
}


def looks_like(slot: float, feature: float) -> tuple[str, ...]:
    """Return known physics with the form of a term, likeliest first; empty if there is none."""
    return LOOKS_LIKE[Slot(int(slot))].get(Feature(int(feature)), ())


def axles_of(mask: float) -> tuple[int, ...]:
    """Return the axles of a bit mask, from 1; empty for all axles."""
    return tuple(bit + 1 for bit in range(int(mask).bit_length()) if int(mask) >> bit & 1)


def mask_of(axles: tuple[int, ...]) -> float:
    """Return the bit mask of axles, from 1; 0 for an empty tuple, which means all axles."""
    return float(sum(1 << (axle - 1) for axle in set(axles)))


def _axles(mask: float) -> str:
    named = axles_of(mask)
    if not named:
        return "all axles"
    return f"axle {named[0]}" if len(named) == 1 else f"axles {', '.join(map(str, named[:-1]))} and {named[-1]}"


def _per(term: Term) -> tuple[str, str]:
    """Return the words after the number, and the words after the axles."""
    feature = Feature(int(term.feature))
    described = FEATURES[feature]
    words = described.words.format(scale=term.scale, second_scale=term.second_scale)
    if feature in (Feature.BRAKING, Feature.ALWAYS):
        return "", f" {words}"
    if feature is Feature.PLACE_BUMP:
        return "", f" at most, in {words}"
    if described.unit == "-":
        return "", f", times {words}"
    return f" per {described.unit} of {words}", ""


def unit_of(term: Term, field: str) -> str:
    """Return the unit of a field of a term."""
    described, own = FEATURES[Feature(int(term.feature))], SLOTS[Slot(int(term.slot))][1]
    if field == "coefficient":
        return own if described.unit == "-" else f"{own} / ({described.unit})"
    units = {"scale": described.scale[0], "second_scale": described.scale[1], "low": described.unit, "high": described.unit}
    return units.get(field, "") or "-"


def equation_of(term: Term) -> str:
    """Return a term in words: "650 N m on axle 1 while braking"."""
    slot, axles = Slot(int(term.slot)), _axles(term.axles)
    size, (per, behind) = float(f"{abs(term.coefficient):.3g}"), _per(term)
    rises, high = ("rises", "high") if term.coefficient > 0.0 else ("falls", "low")
    if slot is Slot.BRAKE_TORQUE:
        less = "" if term.coefficient > 0.0 else " less"
        return f"{size:g} N m{less}{per} on {axles}{behind}"
    if slot is Slot.FRICTION:
        return f"friction of {axles} {rises} by {100.0 * size:.3g} %{per}{behind}"
    if slot is Slot.RECOVERY:
        return f"recovery rate of {axles} {rises} by a factor of {math.exp(min(abs(term.coefficient), 700.0)):.3g}{per}{behind}"
    if slot is Slot.WHEEL_READING:
        behind = f" above {term.scale:.0f} m/s" if term.feature == Feature.ALWAYS else behind
        return f"wheel speed of {axles} read too {high} by {100.0 * size:.3g} %{per}{behind}"
    if slot is Slot.RECORDED_SPEED:
        return f"recorded speed too {high} by {size:g} m/s{per}{behind}"
    way = "against" if term.coefficient > 0.0 else "along"
    where = "" if not axles_of(term.axles) else f" (of {axles})"
    return f"{size:g} N {way} the motion{per}{behind}{where}"
