"""The friction of the brake pads depends on sliding speed, pressure and temperature.

The torque is multiplied by 1 + a_v (v_w - v_0) + a_p (p - p_0) + a_t theta: organic pads lose friction with speed, pressure and
heat (the permitted bands around 0.35 in UIC 541-3 have this size; sizes: assumption). v_w is the wheel's circumferential speed;
that of the disc is proportional to it. v_0 is the speed at which the friction is the believed one: a gain of brakes is measured
at some speed, or is a mean over a stop, and nobody says which. theta is the rise of the discs' mean temperature. The discs take
the braking power and cool with a time constant.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Passage, Recorded, Said, Signature, never, percent

#: Pressure [bar] at which the friction is the believed one (assumption: middle of a full stop).
REFERENCE_BAR = 2.0

#: Speed [m/s] from which a fit of the reference speed begins (assumption: middle of a full stop).
MIDDLE_MPS = 20.0

#: Heat capacity of the discs of one axle [J/K] (assumption: two discs of 120 kg at 470 J/kgK).
HEAT_CAPACITY_J_PER_K = 113_000.0

#: Time constant of the discs' cooling [s] (assumption: minutes, long compared with a stop).
COOLING_S = 600.0


class Parameters(NamedTuple):
    """Parameters of the pads, see `CARD`."""

    per_speed_s_per_m: float
    per_pressure_1_per_bar: float
    per_temperature_1_per_k: float
    reference_mps: float


class Discs(NamedTuple):
    """State of the discs of N vehicles with A axles."""

    warmer_k: np.ndarray  # (N, A) rise of their mean temperature [K]


def memory(n: int, axle_positions_m: Sequence[float]) -> Discs:
    """Return the state of cold discs."""
    return Discs(np.zeros((n, len(axle_positions_m))))


@inlined
def torque_factor(p: Parameters, discs: Discs, i: int, k: int, wheel_mps: float, pressure_bar: float) -> float:
    """Brake torque over the believed one [-]; at least zero."""
    if p.per_speed_s_per_m == 0.0 and p.per_pressure_1_per_bar == 0.0 and p.per_temperature_1_per_k == 0.0:
        return 1.0
    change = p.per_speed_s_per_m * (wheel_mps - p.reference_mps) + p.per_pressure_1_per_bar * (pressure_bar - REFERENCE_BAR)
    return max(1.0 + change + p.per_temperature_1_per_k * discs.warmer_k[i, k], 0.0)


@inlined
def warm(p: Parameters, discs: Discs, i: int, k: int, passage: Passage) -> None:
    """Heat the discs of axle k by the work of its brake, and let them cool."""
    if p.per_temperature_1_per_k != 0.0:
        cooled = discs.warmer_k[i, k] * math.exp(-passage.duration_s / COOLING_S)
        discs.warmer_k[i, k] = cooled + passage.braking_j / HEAT_CAPACITY_J_PER_K


def middle(recorded: Recorded) -> list[dict[str, float]]:
    """Return the only variant, with the reference speed that a refit begins with."""
    return [{"reference_mps": MIDDLE_MPS}]


CARD = Card(
    name="pad_friction",
    summary="pad friction depends on speed, pressure and temperature",
    parameters=(
        Parameter("per_speed_s_per_m", "s/m", 0.0, -5e-3, -0.03, 0.03, "assumption: 10 % over 20 m/s, band of UIC 541-3"),
        Parameter("per_pressure_1_per_bar", "1/bar", 0.0, -0.03, -0.3, 0.3, "assumption: band of UIC 541-3", fitted=False),
        Parameter("per_temperature_1_per_k", "1/K", 0.0, -5e-4, -5e-3, 5e-3, "assumption: fading of organic pads"),
        Parameter(
            "reference_mps", "m/s", MIDDLE_MPS, MIDDLE_MPS, 0.0, 60.0, "assumption: middle of a stop", "shape", refit_step=2.0
        ),
    ),
    record=Parameters,
    acts={"torque_factor": torque_factor, "after_passage": warm},
    memory=memory,
    recalls=never,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion", "actuator"}),
        trace="the same error in the balances of actuator, vehicle and adhesion, also in stops without slide",
        acts_on="brake",
        next_test="a gentle stop without sliding from the highest speed, and one from half of it",
        said=(
            Said(
                "per_speed_s_per_m",
                "%",
                lambda a: 1e3 * a,
                "the pads' friction rises by {size} for every 10 m/s of speed",
                "the pads' friction falls by {size} for every 10 m/s of speed",
            ),
            Said(
                "per_pressure_1_per_bar",
                "%",
                percent,
                "the pads' friction rises by {size} for every bar",
                "the pads' friction falls by {size} for every bar",
            ),
            Said(
                "per_temperature_1_per_k",
                "%",
                lambda a: 1e4 * a,
                "the pads' friction rises by {size} for every 100 K",
                "the pads' friction falls by {size} for every 100 K",
            ),
        ),
        over="speed",
        variants=middle,
    ),
)
