"""The effects that may be concealed, and which campaigns conceal which."""

from typing import NamedTuple

import numpy as np


class Effect(NamedTuple):
    """One effect; its form stands in `brakes.py`, `plant.py`, `contact.py` or, for the clock, `record.py`."""

    slot: str  # where it acts, see `SLOTS`
    unit: str  # of its size
    guess: float  # size tried first
    cap: float  # largest size
    signs: tuple[int, ...] = (1,)
    library: bool = True  # the library of wsp_env has a name for it
    axle: str = ""  # field of `records.Places` with the one axle that it acts on; all axles where left out
    others: tuple[str, ...] = ()  # fields with its further parameters
    parameter: str = ""  # the library's, where it means the same


#: Where effects act, as labels say it.
SLOTS = {
    "brake torque": "brake torque", "friction": "friction", "wheel load": "friction", "vehicle force": "vehicle force",
    "inertia": "vehicle force", "sensor": "sensor",
}  # fmt: skip

_BOTH = (-1, 1)
EFFECTS = {
    "leading_axle_cleaning": Effect("friction", "m/J, at which work on the rail raises mu_cd for later wheels", 3e-4, 5e-3),
    "contaminant_memory": Effect("friction", "m, distance over which the friction work is remembered", 4.0, 40.0),
    "adhesion_patch": Effect("friction", "of mu_cd, on a stretch", 0.2, 0.55, _BOTH, others=("patch_m", "patch_length_m")),
    "speed_dependent_friction": Effect("friction", "times exp(-0.0089 (v - 20 m/s)) of mu_cd", 0.8, 2.5),
    "recovery_shape": Effect("friction", "J/m, work below which hardly anything recovers", 150.0, 900.0),
    "falling_friction": Effect("friction", "share of 1 / (1 + 0.2 s) in the fall of mu_d with the slip", 0.5, 1.0, _BOTH),
    "load_transfer": Effect("wheel load", "of a body 1.2 m high on pivots 0.6 m high", 0.7, 1.6),
    "pad_friction": Effect("brake torque", "s/m, change with the speed", 0.004, 0.02, _BOTH),
    "brake_gain_imbalance": Effect("brake torque", "of one axle", 0.08, 0.35, _BOTH, axle="gain_axle", parameter="gain"),
    "dragging_brake": Effect("brake torque", "N m, on one axle once it was braked", 400.0, 2500.0, axle="dragging_axle"),
    "track_gradient": Effect("vehicle force", "rise", 0.002, 0.012, _BOTH, parameter="rise"),
    "aerodynamic_drag": Effect("vehicle force", "N s2/m2 at 25 m/s, with the 1.85th power of the speed", 2.0, 9.0),
    "non_adhesive_brake": Effect("vehicle force", "N, above a speed", 1500.0, 9000.0, others=("electric_from_mps",)),
    "vehicle_mass": Effect("inertia", "of the mass", 0.04, 0.14, _BOTH, parameter="extra"),
    "wheel_radius": Effect("sensor", "of one axle's radius", 0.008, 0.03, _BOTH, axle="radius_axle", parameter="change"),
    "clock_offset": Effect("sensor", "s by which the vehicle's speed is late", 0.2, 0.6, _BOTH, parameter="offset_s"),
    "sticking_rigging": Effect("brake torque", "bar of play, either way", 0.1, 0.8, library=False),
    "leaking_valve": Effect(
        "brake torque", "bar lost at 1 bar, while one axle is not filled", 0.2, 1.2, library=False, axle="leaking_axle"
    ),
    "hydroplaning": Effect("friction", "of mu_cd, lost above a speed", 0.1, 0.5, library=False, others=("planing_mps",)),
    "bogie_resonance": Effect(
        "wheel load", "of the load, for an excitation of 1", 0.03, 0.09, library=False, others=("wave_m", "resonance_radps")
    ),
    "coupled_axles": Effect(
        "brake torque", "N m s/rad of a shaft between axles 1 and 2, whose ratio errs by 1.5 %", 200.0, 2500.0, library=False
    ),
    "parking_brake_remnant": Effect(
        "brake torque", "N m at first, on one axle, released slowly", 900.0, 5000.0, library=False, axle="parking_axle",
        others=("release_s",),
    ),
    "wet_pads": Effect("brake torque", "of the torque, until dried by work", 0.15, 0.7, library=False, others=("drying_j",)),
    "curve_resistance": Effect(
        "vehicle force", "of the weight, in a curve", 0.002, 0.015, library=False, others=("curve_m", "curve_length_m")
    ),
    "squeeze_film": Effect("friction", "of mu_cd, at fast rising slip", 0.15, 0.8, _BOTH, library=False),
}  # fmt: skip

#: Of every ten campaigns, in mixed order.
KINDS = ["null"] * 4 + ["single"] * 3 + ["pair"] + ["outside"] * 2


def plan(seed: int, count: int) -> list[tuple[str, list[str]]]:
    """Return kind and effects of each campaign; effects take turns, those of pairs are drawn."""
    rng = np.random.default_rng((seed, 1))
    inside, outside = (
        [name for name in rng.permutation(list(EFFECTS)).tolist() if EFFECTS[name].library == library]
        for library in (True, False)
    )
    planned: list[tuple[str, list[str]]] = []
    singles = others = 0
    for _ in range(-(-count // len(KINDS))):
        for kind in rng.permutation(KINDS).tolist():
            chosen: list[str] = []
            if kind == "single":
                chosen, singles = [inside[singles % len(inside)]], singles + 1
            elif kind == "outside":
                chosen, others = [outside[others % len(outside)]], others + 1
            elif kind == "pair":
                chosen = rng.choice(inside, 2, replace=False).tolist()
            planned.append((kind, chosen))
    return planned[:count]
