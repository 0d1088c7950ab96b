"""Polach's creep-force law with reduction factors, falling friction and spin.

Sources: eqs. (5) to (7) and (18) of the seed paper (Meli, Ridolfi et al., degraded adhesion); O. Polach, "Creep forces in
simulations of traction vehicles running on adhesion limit", Wear 258 (2005) 992-1000; O. Polach, "A fast wheel-rail
forces calculation computer code", Vehicle System Dynamics Suppl. 33 (1999) 728-739.
"""

import math

import numpy as np

from wsp_env.compiled import elementwise, kernel


@kernel
def falling_friction(
    slip_speed: float, kinetic_friction: float, friction_ratio: float, decrease_rate: float
) -> float:
    """Friction coefficient mu(s) [-], eq. (7), for a slip speed |s| [m/s].

    It falls from `kinetic_friction / friction_ratio` (static) to `kinetic_friction` (kinetic) at the `decrease_rate` [s/m].
    """
    return kinetic_friction * (1.0 + (1.0 / friction_ratio - 1.0) * math.exp(-decrease_rate * slip_speed))


@kernel
def saturation(gradient: float, k_adhesion: float, k_slip: float) -> float:
    """Saturation curve of eq. (5): share of the friction limit in use [-], 0 to 1, at the stress gradient epsilon [-].

    `k_adhesion` and `k_slip` are Polach's reduction factors of the areas of adhesion and slip (both 1: a clean contact).
    """
    x = k_adhesion * gradient
    return (2.0 / math.pi) * (x / (1.0 + x * x) + math.atan(k_slip * gradient))


@kernel
def saturation_slope(gradient: float, k_adhesion: float, k_slip: float) -> float:
    """Derivative of `saturation` with respect to the stress gradient [-]."""
    x2 = (k_adhesion * gradient) ** 2
    y = k_slip * gradient
    return (2.0 / math.pi) * (k_adhesion * (1.0 - x2) / (1.0 + x2) ** 2 + k_slip / (1.0 + y * y))


def contact_stiffness(
    semi_axis_a: float | np.ndarray,
    semi_axis_b: float | np.ndarray,
    shear_modulus: float | np.ndarray,
    kalker_c11: float | np.ndarray,
) -> float | np.ndarray:
    """Stiffness pi G a b c11 / 4 [N] of eq. (6): epsilon = stiffness * creepage / (mu N).

    Semi-axes [m] (a in rolling direction), shear modulus [Pa], Kalker's c11 [-]; scalars or arrays that broadcast.
    """
    return 0.25 * math.pi * shear_modulus * semi_axis_a * semi_axis_b * kalker_c11


def shear_stiffness(
    semi_axis_a: float | np.ndarray,
    shear_modulus: float | np.ndarray,
    kalker_c11: float | np.ndarray,
    kalker_c22: float | np.ndarray | None = None,
    slip_x: float | np.ndarray = 1.0,
    slip_y: float | np.ndarray = 0.0,
) -> float | np.ndarray:
    """Contact shear stiffness C [N/m^3]: eq. (8), or eq. (16) when the slip has a lateral part.

    Without slip (0, 0), where eq. (16) is undefined, the longitudinal value of eq. (8) is returned.
    """
    stiffness_x = 3.0 * np.asarray(shear_modulus) / (8.0 * np.asarray(semi_axis_a)) * kalker_c11
    if kalker_c22 is None:
        return stiffness_x
    stiffness_y = 3.0 * np.asarray(shear_modulus) / (8.0 * np.asarray(semi_axis_a)) * kalker_c22
    slip = np.hypot(slip_x, slip_y)
    moving = slip > 0.0
    scale = np.where(moving, slip, 1.0)
    cosine = np.where(moving, slip_x / scale, 1.0)
    sine = np.where(moving, slip_y / scale, 0.0)
    return np.hypot(stiffness_x * cosine, stiffness_y * sine)


def _adhesion(
    creepage: float,
    slip_speed: float,
    normal_load: float,
    stiffness: float,
    kinetic_friction: float,
    friction_ratio: float,
    decrease_rate: float,
    k_adhesion: float,
    k_slip: float,
) -> float:
    friction = falling_friction(abs(slip_speed), kinetic_friction, friction_ratio, decrease_rate)
    if friction <= 0.0:
        return 0.0
    limit = friction * max(normal_load, 1e-6)
    return math.copysign(
        friction * saturation(stiffness * abs(creepage) / limit, k_adhesion, k_slip), creepage
    )


#: Adhesion coefficient f = T/N [-] of eq. (5), a ufunc of (creepage [-], slip speed [m/s], normal load of one wheel [N],
#: stiffness pi G a b c11 / 4 [N], kinetic friction [-], friction ratio A [-], decrease rate gamma [s/m], k_A [-], k_S [-]).
#: It carries the sign of the creepage. Constant friction: A = 1 and gamma = 0.
polach_adhesion = elementwise(_adhesion)
