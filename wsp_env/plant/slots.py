"""Where mechanisms act: the wheel's contact, the brake torque, the forces beside the wheels.

Each slot is written once; the plant's step and the evaluation along a recording (`wsp_env.plant.along`) call the same ones.
"""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact.degraded import Adhesion, AdhesionLaw, adhesion
from wsp_env.plant.mechanisms import (
    adhesion_patch,
    aerodynamic_drag,
    brake_gain_imbalance,
    contaminant_memory,
    flash_temperature,
    load_transfer,
    non_adhesive_brake,
    pad_friction,
    speed_dependent_friction,
)
from wsp_env.plant.state import Constants


class Rail(NamedTuple):
    """What a wheel finds on the rail."""

    mu_cd: float  # kinetic friction coefficient with the film [-]
    film: float  # share of the film that this wheel's work acts on [-]
    held: float  # share that lags behind it, see contaminant_memory [-]


@inlined
def wheel_load(k: int, mass: float, deceleration: float, p: Constants) -> float:
    """Load of one wheel of axle k [N] under the vehicle's deceleration [m/s2]."""
    static = mass * p.gravity / (2.0 * len(p.axle_offset))
    return load_transfer.wheel_load(p.mechanisms.load_transfer, static, mass, deceleration, p.body_arm[k], p.pivot_arm[k])


@inlined
def rail(place: float, mu_cd: float, film: float, recovery: float, rolled: float, p: Constants) -> tuple[Rail, float]:
    """Return what a wheel finds at a place [m], and the weight [-] of the `recovery` that it had `rolled` [m] before.

    mu_cd and film are what lies there before the mechanisms of the wheel's own past and of the place.
    """
    mu_cd *= adhesion_patch.friction_factor(p.mechanisms.adhesion_patch, place)
    past = contaminant_memory.weight_of_past(p.mechanisms.contaminant_memory, rolled)
    return Rail(min(mu_cd, p.law.mu_cr), film * (1.0 - past), film * past * (1.0 - recovery)), past


@inlined
def contact(slip: float, speed: float, load: float, on: Rail, tau: float, p: Constants) -> Adhesion:
    """Adhesion of one wheel at |slip| [m/s], running speed [m/s] and load [N]."""
    factor = speed_dependent_friction.friction_factor(p.mechanisms.speed_dependent_friction, speed)
    w = p.law
    law = AdhesionLaw(
        w.stiffness, w.k_ad, w.k_sd, w.k_ar, w.k_sr, w.mu_cr * factor, w.ratio_d, w.ratio_r, w.gamma_d, w.gamma_r,
        w.recovery_exponent, w.recovery_threshold,
    )  # fmt: skip
    cold = adhesion(slip, speed, load, on.mu_cd * factor, tau, on.film, law, on.held)
    return flash_temperature.heated(p.mechanisms.flash_temperature, cold, slip, speed, load, p.heating)


@inlined
def torque_factor(k: int, wheel_mps: float, pressure: float, warmer: float, p: Constants) -> float:
    """Brake torque of axle k over the believed one [-]; from wheel speed [m/s], pressure [bar], discs' warming [K]."""
    factor = pad_friction.torque_factor(p.mechanisms.pad_friction, wheel_mps, pressure, warmer)
    return factor * brake_gain_imbalance.torque_factor(p.mechanisms.brake_gain_imbalance, k)


@inlined
def resistance(speed: float, mass: float, gradient: float, applied: float, p: Constants) -> float:
    """Force [N] against the motion beside the wheels: running resistance, gradient, track brake (where `applied` is 1)."""
    believed = p.resistance_a + speed * (p.resistance_b + speed * p.resistance_c) + mass * p.gravity * gradient
    drag = aerodynamic_drag.force(p.mechanisms.aerodynamic_drag, speed)
    return believed + drag + non_adhesive_brake.force(p.mechanisms.non_adhesive_brake, speed, applied)
