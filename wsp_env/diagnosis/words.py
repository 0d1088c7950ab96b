"""What a diagnosis says in words: what a mechanism does here, the verdict in one sentence, and the test to make next."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from wsp_env.diagnosis.answer import Closure, Estimate, Location, Named
from wsp_env.plant.mechanisms import ALL


class _Size(NamedTuple):
    """How one size of a mechanism is said; {size} is the number with its unit, other fields are the mechanism's parameters."""

    parameter: str
    unit: str
    shown: Callable[[float], float]  # the number said, from the parameter; its sign goes into the words
    above: str  # said of a parameter above its null
    below: str = ""  # below it; none where the null is the lower bound


def _percent(value: float) -> float:
    return 100.0 * value


def _itself(value: float) -> float:
    return value


#: Every mechanism's sizes in words.
_SAID: dict[str, tuple[_Size, ...]] = {
    "leading_axle_cleaning": (
        _Size("removal_m_per_j", "%", lambda r: 100.0 * (1.0 - math.exp(-1e4 * r)),
              "sliding axles clean the rail for those behind them: every 10 kJ/m takes away {size} of the film"),
    ),
    "contaminant_memory": (_Size("distance_m", "m", _itself, "the film follows the friction work only after rolling {size}"),),
    "adhesion_patch": (
        _Size("change", "%", _percent, "the adhesion is {size} higher from {start_m:.0f} m to {end_m:.0f} m",
              "the adhesion is {size} lower from {start_m:.0f} m to {end_m:.0f} m"),
    ),
    "speed_dependent_friction": (
        _Size("share", "%", _percent, "friction falls with the running speed by {size} of the fall of Curtius and Kniffler",
              "friction rises with the running speed by {size} of the fall of Curtius and Kniffler"),
    ),
    "recovery_shape": (
        _Size("exponent", "", _itself, "the film goes later, and then faster, than believed, with exponent {size} instead of 1",
              "the film goes sooner, and then more slowly, than believed, with exponent {size} instead of 1"),
        _Size("threshold_j_per_m", "J/m", _itself, "friction work below {size} removes no film"),
    ),
    "flash_temperature": (
        _Size("fall_per_k", "%", lambda a: 1e4 * a, "friction falls by {size} for every 100 K of heat in the contact"),
    ),
    "load_transfer": (
        _Size("body_height_m", "m", _itself, "braking loads the leading bogie: the body's mass acts {size} above the pivots"),
        _Size("pivot_height_m", "m", _itself, "braking loads each bogie's leading axle: the pivots are {size} above the rail"),
    ),
    "pad_friction": (
        _Size("per_speed_s_per_m", "%", lambda a: 1e3 * a, "the pads' friction rises by {size} for every 10 m/s of speed",
              "the pads' friction falls by {size} for every 10 m/s of speed"),
        _Size("per_pressure_1_per_bar", "%", _percent, "the pads' friction rises by {size} for every bar",
              "the pads' friction falls by {size} for every bar"),
        _Size("per_temperature_1_per_k", "%", lambda a: 1e4 * a, "the pads' friction rises by {size} for every 100 K",
              "the pads' friction falls by {size} for every 100 K"),
    ),
    "brake_gain_imbalance": (
        _Size("gain", "%", _percent, "axle {axle:.0f}'s brake is {size} stronger than believed",
              "axle {axle:.0f}'s brake is {size} weaker than believed"),
    ),
    "track_gradient": (
        _Size("rise", "per mille", lambda i: 1e3 * i, "the track rises by {size} more than believed",
              "the track falls by {size} more than believed"),
    ),
    "aerodynamic_drag": (
        _Size("c_ns2_per_m2", "kN", lambda c: 0.9 * c, "the running resistance at 30 m/s is {size} higher than believed",
              "the running resistance at 30 m/s is {size} lower than believed"),
    ),
    "vehicle_mass": (
        _Size("extra", "%", _percent, "the vehicle is {size} heavier than believed",
              "the vehicle is {size} lighter than believed"),
    ),
    "non_adhesive_brake": (
        _Size("force_n", "kN", lambda force: 1e-3 * force, "a brake that needs no wheels gives {size} {band}"),
    ),
    "initial_slope": (
        _Size("factor", "%", lambda factor: _percent(factor - 1.0), "the creep curve begins {size} steeper than Kalker's",
              "the creep curve begins {size} flatter than Kalker's"),
    ),
    "falling_friction": (
        _Size("decrease", "", _itself, "friction falls faster with slip speed than believed, at {size} times the rate",
              "friction falls more slowly with slip speed than believed, at {size} times the rate"),
        _Size("excess", "", _itself, "friction falls further with slip speed than believed, {size} times as far",
              "friction falls less far with slip speed than believed, {size} times as far"),
    ),
    "wheel_radius": (
        _Size("change", "%", _percent, "axle {axle:.0f}'s wheels are {size} larger than believed",
              "axle {axle:.0f}'s wheels are {size} smaller than believed"),
    ),
    "wheel_speed_lag": (_Size("lag_s", "ms", lambda lag: 1e3 * lag, "the wheel speeds are recorded with a lag of {size}"),),
    "clock_offset": (
        _Size("offset_s", "ms", lambda late: 1e3 * late, "the vehicle's speed is recorded {size} late beside the wheel speeds",
              "the vehicle's speed is recorded {size} early beside the wheel speeds"),
    ),
}  # fmt: skip


def said(name: str, parameters: Mapping[str, Estimate]) -> str:
    """Say what a mechanism does: size, sign and axle or place, with the 90 % interval in brackets.

    A size whose interval holds its null is left out beside one whose interval does not.
    """
    nulls = {one.name: one.null for one in ALL[name].parameters}
    sizes = [size for size in _SAID[name] if size.parameter in parameters]
    sure = [s for s in sizes if not _holds(parameters[s.parameter].interval90, nulls[s.parameter])]
    values = {parameter: estimate.value for parameter, estimate in parameters.items()}
    values["end_m"] = values.get("start_m", 0.0) + values.get("length_m", 0.0)
    lowest = values.get("lowest_mps", 0.0)
    band = f"above {lowest:.0f} m/s" if lowest > 0.0 else "at every speed"
    told = []
    for size in sure or sizes[:1]:
        estimate = parameters[size.parameter]
        shown = [size.shown(x) for x in (estimate.value, *estimate.interval90)]
        if shown[0] < 0.0:
            shown = [-shown[0], -shown[2], -shown[1]]
        number, low, high = _numbers(*shown)
        words = size.above if estimate.value >= nulls[size.parameter] or not size.below else size.below
        inside = f"{low} to {high} {size.unit}".rstrip()
        told.append(f"{words.format(size=f'{number} {size.unit}'.rstrip(), band=band, **values)} ({inside})")
    return ", and ".join(told)


def _holds(interval: tuple[float, float], null: float) -> bool:
    return interval[0] <= null <= interval[1]


def _numbers(*values: float) -> list[str]:
    """Put an estimate and its interval in words, to the digits that the interval leaves."""
    width = max(values) - min(values)
    if width <= 0.0:
        return [f"{value:.3g}" for value in values]
    digits = max(math.ceil(0.6 - math.log10(width)), 0)
    return [f"{value:.{digits}f}" for value in values]


#: The test that shows a mechanism apart from others.
_TESTS = {
    "leading_axle_cleaning": "a stop with the leading axle's brake cut out: its cleaning must vanish behind it",
    "contaminant_memory": "a stop in which the demand is stepped, so that the slip changes fast and slowly",
    "adhesion_patch": "a stop that begins some 100 m earlier: the patch must stay at its place",
    "speed_dependent_friction": "stops from a low and from the highest initial speed at equal demand",
    "recovery_shape": "stops with the creepage limited to 5 % and to 20 %, so that little and much friction work is done",
    "flash_temperature": "stops at equal slip from two speeds, so that slip power changes and slip does not",
    "load_transfer": "a stop at half the brake demand: load transfer falls with the deceleration",
    "pad_friction": "a gentle stop without sliding from the highest speed, and one from half of it",
    "brake_gain_imbalance": "a gentle stop on each axle's brake alone",
    "track_gradient": "coasting over the same track in both directions",
    "aerodynamic_drag": "coasting from the highest speed",
    "vehicle_mass": "weighing the vehicle, or a gentle stop beside one with known ballast",
    "non_adhesive_brake": "a stop with the track brake cut out",
    "initial_slope": "gentle stops at several demands below sliding, for the slope of the creep curve",
    "falling_friction": "stops with the creepage limited to 5 % and to 30 % at equal speed",
    "wheel_radius": "coasting at constant speed for some 20 s, or measuring the wheels",
    "wheel_speed_lag": "a stop with hard, fast changes of slip, recorded with a reference tachometer on one axle",
    "clock_offset": "a sharp brake application from rolling freely, on both recorders",
}

#: The test that shows on what an unknown cause depends, by the beginning of the closure that describes it.
_UNKNOWN_TESTS = {
    "adhesion": (
        "stops from several speeds at controlled slip, up and down the creep curve: that parts slip, speed, work and time"
    ),
    "slip while rolling freely": "measuring the wheels' diameters, and coasting at constant speed for some 20 s",
    "recorded speed": "the same stops with a second, independent reading of the vehicle's speed, on one clock with the wheels'",
    "torque": "the same stops with the brake torque measured at the calipers instead of computed from the pressure",
    "force on the vehicle": (
        "the same stops on level track, with the vehicle's acceleration and the couplers' forces recorded beside the speeds"
    ),
}


def next_test(verdict: str, named: Sequence[Named], reasons: Mapping[str, str], closure: Closure | None = None) -> str:
    """Return the test that would tell most next."""
    if verdict == "adequate":
        return "none is needed for what these stops can show; gentle and hard stops from other speeds would show more"
    if verdict == "insufficient":
        return f"stops that slide: {'; '.join(sorted(set(reasons.values()))) or 'these recordings show too little'}"
    if verdict == "unknown":
        depends_on = closure.depends_on if closure else ""
        fitting = (test for beginning, test in _UNKNOWN_TESTS.items() if depends_on.startswith(beginning))
        return next(fitting, _UNKNOWN_TESTS["force on the vehicle"])
    tests = [_TESTS[name] for one in named for name in one.alternatives[:2]]
    return "; ".join(dict.fromkeys(tests))


def sentence(verdict: str, named: Sequence[Named], closure: Closure | None, where: Sequence[Location]) -> str:
    """Return the verdict in one sentence."""
    if verdict == "adequate":
        return "The simulation is adequate: nothing is missing that these recordings could show and that matters in a stop."
    if verdict == "insufficient":
        return "The recordings are insufficient: no wheel slides in them, so they say nothing on adhesion."
    if verdict == "unknown":
        place = where[0].equation if where else "vehicle"
        best = f"best described by an unknown {closure.depends_on}" if closure else "which no closure describes either"
        return f"Something is missing that no mechanism of the library explains: the {place} balance is off, {best}."
    return f"What the simulation lacks: {'; and '.join(_claim(one) for one in named)}."


def _claim(one: Named) -> str:
    """Say what one mechanism does, and how far that can be trusted."""
    others = " or ".join(name.replace("_", " ") for name in one.alternatives[1:])
    words = said(one.name, one.parameters)
    if one.multiple < 1.0:
        words = f"perhaps {words}, which is too little to matter in a stop"
    elif others:
        words = f"probably {words}"
    return f"{words} (or it is {others}: these recordings cannot tell)" if others else words
