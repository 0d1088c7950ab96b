"""What a diagnosis says in words: the verdict in one sentence, and the test to make next."""

from collections.abc import Mapping, Sequence

from wsp_env.diagnosis.answer import Closure, Location, Named
from wsp_env.plant.mechanisms import ALL

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


def next_test(verdict: str, named: Sequence[Named], reasons: Mapping[str, str]) -> str:
    """Return the test that would tell most next."""
    if verdict == "adequate":
        return "none is needed for what these stops can show; gentle and hard stops from other speeds would show more"
    if verdict == "insufficient":
        return f"stops that slide: {'; '.join(sorted(set(reasons.values()))) or 'these recordings show too little'}"
    if verdict == "unknown":
        return "the same stops again, with the vehicle's acceleration and couplers' forces recorded beside the speeds"
    tests = [_TESTS[name] for one in named for name in one.alternatives[:2]]
    return "; ".join(dict.fromkeys(tests))


def sentence(verdict: str, named: Sequence[Named], closure: Closure | None, where: Sequence[Location]) -> str:
    """Return the verdict in one sentence."""
    if verdict == "adequate":
        return "The simulation is adequate: nothing is missing that these recordings could show and that matters in a stop."
    if verdict == "insufficient":
        return "The recordings are insufficient: no wheel slides in them, so they say nothing on adhesion."
    if verdict == "unknown" and closure is not None:
        place = where[0].equation if where else "vehicle"
        return (
            f"Something is missing that no mechanism of the library explains: the {place} balance is off, "
            f"best described by an unknown {closure.depends_on}."
        )
    told = []
    for one in named:
        others = [name.replace("_", " ") for name in one.alternatives[1:]]
        doubt = f" (or {', '.join(others)}: these data cannot tell)" if others else ""
        told.append(f"{one.name.replace('_', ' ')}: {ALL[one.name].summary}{doubt}")
    return f"The simulation lacks {'; and '.join(told)}."
