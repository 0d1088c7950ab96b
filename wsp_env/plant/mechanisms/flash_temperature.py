"""Friction falls with the contact temperature.

A sliding contact heats the surfaces by theta = f p_0 s sqrt(a / v) / (2 e) during its passage; half of the heat flows into each
body (flash temperature of a moving source, H. Blok 1937; form as in M. Ertz, K. Knothe, Wear 253 (2002) 498-508, whose factor
of order one for the distribution in the ellipse is included in `fall_per_k`). Friction falls as 1 / (1 + fall theta). Because
theta is proportional to the adhesion coefficient f, the heated f solves f (1 + c f) = f_cold, in closed form and without a
state. It follows the slip immediately, because heating takes a / v, less than a millisecond. The work of the cold contact
removes the contaminant layer.
"""

import math
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact.traction import SPEED_FLOOR, Adhesion
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.card import Card, OnCreepCurve, Parameter, Said, Signature

#: Thermal effusivity of steel, sqrt(50 W/mK x 7850 kg/m3 x 477 J/kgK) [W s0.5 / (m2 K)] (handbook values of carbon steel).
EFFUSIVITY = 13_700.0


class Parameters(NamedTuple):
    """Parameters of the heating, see `CARD`."""

    fall_per_k: float


class Heating(NamedTuple):
    """Heating as a function of the contact's size."""

    per_power: float  # theta / (f N s / sqrt(v)) [K s1.5 / (N m0.5)]


def heating(semi_axis_a_m: float, semi_axis_b_m: float) -> Heating:
    """Return the heating of a Hertzian contact with p_0 = 1.5 N / (pi a b)."""
    return Heating(1.5 / (math.pi * semi_axis_a_m * semi_axis_b_m) * math.sqrt(semi_axis_a_m) / (2.0 * EFFUSIVITY))


def derive(vehicle: Vehicle) -> Heating:
    """Return the heating of a vehicle's contacts."""
    return heating(vehicle.contact.semi_axis_a_m, vehicle.contact.semi_axis_b_m)


@inlined
def heated(p: Parameters, heats: Heating, cold: Adhesion, slip_speed: float, speed: float, load_n: float) -> Adhesion:
    """Return the adhesion of the heated contact, its limits and derivatives."""
    if p.fall_per_k == 0.0:
        return cold
    rolling = max(abs(speed), SPEED_FLOOR)
    per_slip = p.fall_per_k * heats.per_power * load_n / math.sqrt(rolling)
    c = per_slip * abs(slip_speed)
    f = _heated(cold.f, c)
    steepness = 1.0 / (1.0 + 2.0 * c * f)
    df_ds = (cold.df_ds - f * f * per_slip) * steepness
    df_dv = (cold.df_dv + 0.5 * f * f * c / rolling) * steepness
    return Adhesion(f, _heated(cold.f_d, c), _heated(cold.f_r, c), df_ds, df_dv, cold.kept)


@inlined
def _heated(cold: float, c: float) -> float:
    """Solve f (1 + c f) = cold for f [-]."""
    return 2.0 * cold / (1.0 + math.sqrt(1.0 + 4.0 * c * cold))


CARD = Card(
    name="flash_temperature",
    summary="friction falls with the contact temperature",
    parameters=(Parameter("fall_per_k", "1/K", 0.0, 1.0e-3, 0.0, 0.1, "form: Ertz, Knothe (2002); size: assumption"),),
    record=Parameters,
    acts={"contact": heated},
    derive=derive,
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: residual against slip power, reversible",
        acts_on="contact",
        next_test="stops at equal slip from two speeds, so that slip power changes and slip does not",
        said=(Said("fall_per_k", "%", lambda a: 1e4 * a, "friction falls by {size} for every 100 K of heat in the contact"),),
        creep_curve=OnCreepCurve(),
    ),
)
