"""The words of a diagnosis: the effect of a mechanism, the verdict in one sentence, and the next test."""

import math
import re
from collections.abc import Mapping, Sequence

from wsp_env.diagnosis.answer import Discovered, Estimate, Location, Named, Verdict
from wsp_env.plant.mechanisms import ALL

#: Names of the balances for readers.
BALANCES = {
    "vehicle": "vehicle speed",
    "adhesion": "adhesion under torque",
    "kinematics": "free rolling",
    "actuator": "brake torque against pressure",
}


def mechanism_words(name: str, parameters: Mapping[str, Estimate]) -> str:
    """Return the effect of a mechanism in words: size, sign and axle or place, with the 90 % interval in brackets.

    Sizes whose interval contains the null value are omitted if the interval of another size does not.
    """
    card = ALL[name]
    nulls = {one.name: one.null for one in card.parameters}
    sizes = [size for size in card.signature.said if size.parameter in parameters]
    sure = [s for s in sizes if not _holds(parameters[s.parameter].interval90, nulls[s.parameter])]
    values = {parameter: estimate.value for parameter, estimate in parameters.items()}
    fields = values | dict(card.signature.words(values))
    parts = []
    for size in sure or sizes[:1]:
        estimate = parameters[size.parameter]
        shown = [size.shown(x) for x in (estimate.value, *estimate.interval90)]
        if shown[0] < 0.0:
            shown = [-shown[0], -shown[2], -shown[1]]
        number, low, high = _numbers(*shown)
        words = size.above if estimate.value >= nulls[size.parameter] or not size.below else size.below
        inside = f"{low} to {high} {size.unit}".rstrip()
        parts.append(f"{words.format(size=f'{number} {size.unit}'.rstrip(), **fields)} ({inside})")
    return ", and ".join(parts)


#: Units at the end of parameter names, longest first.
_ENDS = ("_ns2_per_m2", "_ns_per_m", "_1_per_bar", "_1_per_k", "_j_per_m", "_m_per_j", "_s_per_m", "_per_k", "_mps", "_nm",
         "_hz", "_m", "_s", "_n")  # fmt: skip

#: Words for parameter names that are unclear without their unit.
_SAY_LITTLE = {
    "change": "relative change",
    "gain": "relative change of the gain",
    "extra": "relative surplus",
    "rise": "additional gradient",
    "a": "constant part",
    "b": "part in proportion to speed",
    "c": "part in proportion to speed squared",
    "sine": "sine part",
    "cosine": "cosine part",
    "fall": "fall per kelvin",
    "per_speed": "change with speed",
    "per_pressure": "change with pressure",
    "per_temperature": "change with temperature",
    "bend": "bend of the curve",
    "recovered": "share of it that the recovered friction has",
    "lowest": "lowest speed",
    "highest": "highest speed",
}


def parameter_words(parameter: str) -> str:
    """Return the name of a parameter in words, without its unit."""
    plain = next((parameter.removesuffix(end) for end in _ENDS if parameter.endswith(end)), parameter)
    return _SAY_LITTLE.get(plain, plain.replace("_", " "))


def unit_words(unit: str) -> str:
    """Return a unit for a table column; a single dash could be read as minus."""
    return "(dimensionless)" if unit == "-" else unit


def parameter_said(parameter: str, estimate: Estimate) -> str:
    """Return a parameter with its unit and 90 % interval in words; without interval if it was not fitted (axle, place)."""
    name, unit = parameter_words(parameter), "" if estimate.unit == "-" else estimate.unit
    low, high = estimate.interval90
    if name == "axle":
        return f"axle {estimate.value:.0f}" if estimate.value else "every axle"
    if low == high:
        return f"{name} {estimate.value:.4g} {unit}".rstrip()
    return f"{name} {estimate.value:.3g} {unit}".rstrip() + f" ({low:.3g} to {high:.3g}{f' {unit}' if unit else ''})"


def _holds(interval: tuple[float, float], null: float) -> bool:
    return interval[0] <= null <= interval[1]


def _numbers(*values: float) -> list[str]:
    """Return an estimate and its interval as text, with the digits that the width of the interval justifies."""
    width = max(values) - min(values)
    if width <= 0.0:
        return [f"{value:.3g}" for value in values]
    digits = max(math.ceil(0.6 - math.log10(width)), 0)
    return [f"{value:.{digits}f}" for value in values]


#: The test that shows the dependence of an unknown cause, by the balance with the misfit.
_UNKNOWN_TESTS = {
    "adhesion": (
        "stops from several speeds at controlled slip, up and down the creep curve: that parts slip, speed, work and time"
    ),
    "kinematics": "measuring the wheels' diameters, and coasting at constant speed for some 20 s",
    "actuator": "the same stops with the brake torque measured at the calipers instead of computed from the pressure",
    "vehicle": (
        "the same stops on level track, with the vehicle's acceleration and the couplers' forces recorded beside the speeds"
    ),
}


def next_test(
    verdict: Verdict, named: Sequence[Named], reasons: Mapping[str, str], where: Sequence[Location] = (),
    terms: Sequence[Discovered] = (),
) -> str:  # fmt: skip
    """Return the test that would give most information next."""
    if verdict == "adequate":
        return "none is needed for what these stops can show; gentle and hard stops from other speeds would show more"
    if verdict == "insufficient":
        return f"stops that slide: {'; '.join(sorted(set(reasons.values()))) or 'these recordings show too little'}"
    if verdict == "unknown":
        return _UNKNOWN_TESTS[where[0].equation if where else "vehicle"]
    tests = [ALL[name].signature.next_test for one in named for name in one.alternatives[:2] if name in ALL]
    tests += [_term_test(one) for one in terms]
    return "; ".join(dict.fromkeys(tests))


def _term_test(term: Discovered) -> str:
    """Return the test that would confirm a term."""
    axles = f" on axle {', '.join(map(str, term.axles))}" if term.axles else ""
    if any(one.endswith("along the track") for one in term.features):
        return f"stops that begin some 100 m earlier: the {term.slot} must stay at its place"
    alone = f"the {term.slot}{axles} measured by itself"
    return f"stops in which {' and '.join(term.features)} varies on purpose, with {alone}" if term.features else alone


def sentence(
    verdict: Verdict, named: Sequence[Named], where: Sequence[Location], terms: Sequence[Discovered] = (),
    nearest: Sequence[str] = (),
) -> str:  # fmt: skip
    """Return the verdict in one sentence; `nearest`: what came nearest to an explanation, of an unknown cause."""
    if verdict == "adequate":
        return "The simulation is adequate: nothing is missing that these recordings could show and that matters in a stop."
    if verdict == "insufficient":
        return "The recordings are insufficient: no wheel slides in them, so they say nothing on adhesion."
    if verdict == "unknown":
        shows = f" It shows in {_shown(where[0])}." if where else ""
        near = f" Nearest to it, but in no form that holds: {' or '.join(nearest)}." if nearest else ""
        return f"Something is missing that neither a name nor a term explains.{shows}{near}"
    return f"What the simulation lacks: {'; and '.join([*map(_claim, named), *_unnamed(terms)])}."


def _shown(place: Location) -> str:
    """Return where something unknown shows, in words."""
    axles = f" of axle{'s' if len(place.axles) > 1 else ''} {', '.join(map(str, place.axles))}" if place.axles else ""
    within = "" if place.where == "everywhere" else f", most of all at {place.where}"
    return f"the balance of {BALANCES.get(place.equation, place.equation)}{axles}{within}"


def _unnamed(terms: Sequence[Discovered]) -> list[str]:
    """Return claims on what has no name, one for all that acts in the same place, with the physics that it resembles."""
    places = dict.fromkeys((one.slot, one.axles) for one in terms)
    found = []
    for place in places:
        mine = [one for one in terms if (one.slot, one.axles) == place]
        alike = dict.fromkeys(name for one in mine for name in one.looks_like)
        like = f", which looks like: {' or '.join(alike)}" if alike else ""
        found.append(f"something without a name in the library, {', and '.join(one.equation for one in mine)}{like}")
    return found


def _claim(one: Named) -> str:
    """Return a claim on one mechanism, with its confidence."""
    others = " or ".join(name.replace("_", " ") for name in one.alternatives[1:])
    words = mechanism_words(one.name, one.parameters)
    if one.multiple < 1.0:
        words = f"perhaps {words}, at the limit of what matters in a stop"
    elif others:
        words = f"probably {words}"
    return f"{words} (or it is {others}: these recordings cannot tell)" if others else words


def capital(text: str) -> str:
    """Return a text with a capital first letter; a path is unchanged."""
    return text if re.match(r"\S*[/\\]", text) else f"{text[:1].upper()}{text[1:]}"
