"""Which cases a bank holds."""

import dataclasses
import math
from typing import NamedTuple

from experiments.concealed.effects import FOREIGN, NAMED
from experiments.concealed.faults import FAULTS

#: Share of the bank by class.
SHARES = {
    "null": 0.265, "single": 0.42, "pair": 0.07, "confounded": 0.05, "foreign": 0.085, "mixed": 0.04, "fault": 0.07,
}  # fmt: skip

#: Multiples of the smallest effect of interest and noise levels that every library effect gets, in this order.
SINGLE_DESIGN = ((2.0, 1.0), (4.0, 1.0), (1.0, 1.0), (2.0, 2.0), (8.0, 1.0), (2.0, 0.5))
FOREIGN_DESIGN = ((2.0, 1.0), (4.0, 1.0), (2.0, 2.0), (8.0, 1.0))
NULL_NOISES = (1.0, 1.0, 2.0, 0.5)

PAIRS = (
    ("leading_axle_cleaning", "track_gradient"), ("load_transfer", "aerodynamic_drag"),
    ("wheel_radius", "adhesion_patch"), ("contaminant_memory", "vehicle_mass"),
    ("brake_gain_imbalance", "speed_dependent_friction"), ("pad_friction", "load_transfer"),
    ("falling_friction", "track_gradient"), ("leading_axle_cleaning", "wheel_radius"),
    ("non_adhesive_brake", "adhesion_patch"), ("wheel_speed_lag", "leading_axle_cleaning"),
    ("recovery_shape", "clock_offset"), ("initial_slope", "non_adhesive_brake"),
    ("flash_temperature", "brake_gain_imbalance"), ("contaminant_memory", "wheel_radius"),
    ("leading_axle_cleaning", "load_transfer"), ("vehicle_mass", "speed_dependent_friction"),
)  # fmt: skip

#: An effect of the library and one that is in none, in other balances, so that neither hides the other.
MIXED = (
    ("vehicle_mass", "hunting"), ("wheel_radius", "wind_gusts"), ("leading_axle_cleaning", "torque_drift"),
    ("load_transfer", "radar_pitch"), ("aerodynamic_drag", "hunting"), ("adhesion_patch", "wind_gusts"),
)  # fmt: skip
#: What is true beside a faulty channel, in turn: mostly nothing.
BESIDE_FAULT: tuple[tuple[str, ...], ...] = ((), ("vehicle_mass",), (), ("leading_axle_cleaning",))
#: Of so many nulls, and of so many singles, one has no start positions.
PLACELESS_NULLS, PLACELESS_SINGLES = 10, 12


class Recipe(NamedTuple):
    """A campaign in which an effect cannot be told from others, or cannot show at all."""

    effect: str
    why: str
    axles: int = 4
    multiple: float = 4.0
    coast_s: float | None = None  # of every stop
    end_speed_mps: float | None = None
    speed_mps: float | None = None  # of every stop
    demand: float | None = None  # torque of every stop over mu_cd; below 2 no wheel slides


CONFOUNDED = (
    Recipe("track_gradient", "no coasting, one demand, stops from one speed to half of it: gradient, drag or mass",
           coast_s=0.2, end_speed_mps=14.0, speed_mps=28.0, demand=1.3),
    Recipe("aerodynamic_drag", "stops from 26 to 18 m/s: drag, gradient or mass", end_speed_mps=18.0, speed_mps=26.0),
    Recipe("leading_axle_cleaning", "a bogie whose two axles always slide alike: cleaning or load transfer", axles=2),
    Recipe("recovery_shape", "no wheel slides in any stop", demand=1.3),
    Recipe("wheel_radius", "no coasting: the radius or the slope of the curve", coast_s=0.0),
    Recipe("flash_temperature", "all stops from one speed and demand: flash temperature or falling friction",
           speed_mps=36.0, demand=2.6),
    Recipe("contaminant_memory", "one wheelset, stops that slide steadily: memory or recovery", axles=1, demand=2.3),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Case:
    """One case before anything is drawn."""

    index: int
    kind: str  # a key of SHARES
    effects: tuple[str, ...]
    multiple: float  # of the smallest effect of interest, as planned
    noise: float
    repeat: int = 0  # which turn of the design: gives signs, axles, places and variants their variety
    axles: int = 4
    measured_torque: bool = False
    recipe: int = -1  # of CONFOUNDED
    start_positions: bool = True  # whether the campaign says where its stops begin
    fault: str = ""  # of FAULTS

    @property
    def name(self) -> str:
        """Name of its folder; says nothing of what is in it."""
        return f"case{self.index:03d}"


def plan(cases: int) -> list[Case]:
    """Return the cases of a bank of that size: classes by their shares, within each every effect in turn.

    Raises
    ------
    ValueError
        for fewer cases than classes

    """
    if cases < len(SHARES):
        raise ValueError(f"a bank needs at least {len(SHARES)} cases, one of each class, got {cases}")
    numbers = {kind: max(1, math.floor(share * cases)) for kind, share in SHARES.items()}
    numbers["single"] += cases - sum(numbers.values())
    makers = {"null": _null, "single": _single, "pair": _pair, "confounded": _confounded, "foreign": _foreign,
              "mixed": _mixed, "fault": _fault}  # fmt: skip
    drafts = [makers[kind](i) for kind, number in numbers.items() for i in range(number)]
    # Neighbours in the bank should not be of one kind: a step prime to the number scatters them, the same way every time.
    step = next(s for s in range(max(2, round(0.618 * cases)), 2 * cases) if math.gcd(s, cases) == 1)
    return [dataclasses.replace(drafts[(i * step) % cases], index=i) for i in range(cases)]


def _null(i: int) -> Case:
    axles = 2 if i % 13 == 6 else 1 if i % 21 == 10 else 4
    return Case(0, "null", (), 0.0, NULL_NOISES[i % len(NULL_NOISES)], i, axles, measured_torque=i % 4 == 3,
                start_positions=i % PLACELESS_NULLS != PLACELESS_NULLS // 2)  # fmt: skip


def _single(i: int) -> Case:
    turn, which = divmod(i, len(NAMED))
    effect = NAMED[tuple(NAMED)[which]]
    multiple, noise = SINGLE_DESIGN[turn % len(SINGLE_DESIGN)]
    measured = (i + turn) % 4 == 3 and not effect.pressure_only
    known = i % PLACELESS_SINGLES != PLACELESS_SINGLES // 2 or effect.name == "adhesion_patch"  # a patch has a place
    return Case(0, "single", (effect.name,), multiple, noise, turn, measured_torque=measured, start_positions=known)


def _pair(i: int) -> Case:
    return Case(0, "pair", PAIRS[i % len(PAIRS)], 4.0, 1.0, i)


def _confounded(i: int) -> Case:
    recipe = CONFOUNDED[i % len(CONFOUNDED)]
    return Case(0, "confounded", (recipe.effect,), recipe.multiple, 1.0, i, recipe.axles, recipe=i % len(CONFOUNDED))


def _foreign(i: int) -> Case:
    turn, which = divmod(i, len(FOREIGN))
    multiple, noise = FOREIGN_DESIGN[turn % len(FOREIGN_DESIGN)]
    return Case(0, "foreign", (tuple(FOREIGN)[which],), multiple, noise, turn)


def _mixed(i: int) -> Case:
    return Case(0, "mixed", MIXED[i % len(MIXED)], 4.0, 1.0, i)


def _fault(i: int) -> Case:
    turn, which = divmod(i, len(FAULTS))
    return Case(0, "fault", BESIDE_FAULT[turn % len(BESIDE_FAULT)], 4.0, 1.0, turn, fault=tuple(FAULTS)[which])
