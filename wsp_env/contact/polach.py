"""Polach's creep-force law with reduction factors, falling friction and spin.

Sources: eqs. (5) to (7) and (16) to (18) of the seed paper (Meli, Ridolfi et al., degraded adhesion); O. Polach, "Creep
forces in simulations of traction vehicles running on adhesion limit", Wear 258 (2005) 992-1000; O. Polach, "A fast
wheel-rail forces calculation computer code", Vehicle System Dynamics Suppl. 33 (1999) 728-739.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsp_env.compiled import elementwise, kernel
from wsp_env.contact.kalker import Patch, each_contact


@kernel
def falling_friction(slip_speed: float, kinetic_friction: float, friction_ratio: float, decrease_rate: float) -> float:
    """Friction coefficient mu(s) [-], eq. (7), for a slip speed |s| [m/s].

    It falls from `kinetic_friction / friction_ratio` (static) to `kinetic_friction` (kinetic) at the `decrease_rate`
    [s/m].
    """
    return kinetic_friction * (1.0 + (1.0 / friction_ratio - 1.0) * math.exp(-decrease_rate * slip_speed))


@kernel
def saturation(gradient: float, k_adhesion: float, k_slip: float) -> float:
    """Saturation curve of eq. (5): share of the friction limit in use [-], 0 to 1, at the stress gradient epsilon [-].

    `k_adhesion` and `k_slip` are Polach's reduction factors of the areas of adhesion and slip (both 1: clean contact).
    """
    x = k_adhesion * gradient
    return (2.0 / math.pi) * (x / (1.0 + x * x) + math.atan(k_slip * gradient))


@kernel
def saturation_slope(gradient: float, k_adhesion: float, k_slip: float) -> float:
    """Return the derivative of `saturation` with respect to the stress gradient [-]."""
    x2 = (k_adhesion * gradient) ** 2
    y = k_slip * gradient
    return (2.0 / math.pi) * (k_adhesion * (1.0 - x2) / (1.0 + x2) ** 2 + k_slip / (1.0 + y * y))


def contact_stiffness(
    semi_axis_a: ArrayLike,
    semi_axis_b: ArrayLike,
    shear_modulus: ArrayLike,
    kalker_c11: ArrayLike,
) -> NDArray[np.float64]:
    """Stiffness pi G a b c11 / 4 [N] of eq. (6): epsilon = stiffness * creepage / (mu N).

    Semi-axes [m] (a in rolling direction), shear modulus [Pa], Kalker's c11 [-]; scalars or arrays that broadcast.
    """
    area = math.pi * np.asarray(semi_axis_a) * np.asarray(semi_axis_b)
    stiffness: NDArray[np.float64] = 0.25 * np.asarray(shear_modulus) * area * np.asarray(kalker_c11)
    return stiffness


def shear_stiffness(
    semi_axis_a: ArrayLike,
    shear_modulus: ArrayLike,
    kalker_c11: ArrayLike,
    kalker_c22: ArrayLike | None = None,
    slip_x: ArrayLike = 1.0,
    slip_y: ArrayLike = 0.0,
) -> NDArray[np.float64]:
    """Contact shear stiffness C [N/m^3]: eq. (8), or eq. (16) when the slip has a lateral part.

    Without slip (0, 0), where eq. (16) is undefined, the longitudinal value of eq. (8) is returned.
    """
    per_coefficient = 3.0 * np.asarray(shear_modulus) / (8.0 * np.asarray(semi_axis_a))
    stiffness_x: NDArray[np.float64] = per_coefficient * np.asarray(kalker_c11)
    if kalker_c22 is None:
        return stiffness_x
    stiffness_y = per_coefficient * np.asarray(kalker_c22)
    slip = np.hypot(slip_x, slip_y)
    moving = slip > 0.0
    scale = np.where(moving, slip, 1.0)
    cosine = np.where(moving, np.asarray(slip_x) / scale, 1.0)
    sine = np.where(moving, np.asarray(slip_y) / scale, 0.0)
    stiffness: NDArray[np.float64] = np.hypot(stiffness_x * cosine, stiffness_y * sine)
    return stiffness


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
    return math.copysign(friction * saturation(stiffness * abs(creepage) / limit, k_adhesion, k_slip), creepage)


#: Adhesion coefficient f = T/N [-] of eq. (5), a ufunc of (creepage [-], slip speed [m/s], normal load of a wheel [N],
#: stiffness pi G a b c11 / 4 [N], kinetic friction [-], friction ratio A [-], decrease rate gamma [s/m], k_A [-],
#: k_S [-]). It carries the sign of the creepage. Constant friction: A = 1 and gamma = 0.
polach_adhesion = elementwise(_adhesion)


@kernel
def spin_factor(creepage_y: float, limit: float, patch: Patch) -> float:
    """Return F_yS [N m] of Polach (1999): the lateral force of spin is F_yS omega / s_C.

    Its arguments are s_yC [-], the lateral creepage with what spin adds, and the friction limit mu N [N]. Polach's
    K_M = |e| (d^3 / 3 - d^2 / 2 + 1 / 6) - sqrt((1 - d^2)^3) / 3 with d = (e^2 - 1) / (e^2 + 1) equals
    -(2 / 3) |e| / (1 + e^2)^2; he counts forces against the creepage, here they are positive along it.
    """
    a, b = patch.semi_axis_a, patch.semi_axis_b
    slender = 1.0 + 6.3 * (1.0 - math.exp(-a / b))
    stiffness = (8.0 / 3.0) * patch.shear_modulus * patch.c23 * b * math.sqrt(a * b)
    gradient = stiffness * abs(creepage_y) / (limit * slender)
    return 0.375 * a * limit * slender * gradient / (1.0 + gradient * gradient) ** 2


@kernel
def shifted_creepage(creepage_y: float, spin: float, semi_axis_a: float) -> float:
    """Return s_yC [-] of Polach (1999): lateral creepage [-] with what spin [1/m] adds, where it adds."""
    shifted = creepage_y + spin * semi_axis_a
    return shifted if abs(shifted) > abs(creepage_y) else creepage_y


@kernel
def force_with_spin(
    creepage_x: float,
    creepage_y: float,
    spin: float,
    slip_speed: float,
    normal_load: float,
    kinetic_friction: float,
    friction_ratio: float,
    decrease_rate: float,
    k_adhesion: float,
    k_slip: float,
    patch: Patch,
) -> tuple[float, float]:
    """Return (T_x, T_y) [N] of eq. (18), Polach's law in the plane.

    Creepages [-], spin creepage [1/m], slip speed |s| [m/s] of the translation (for the falling friction only), normal
    load of one wheel [N]; the rest as in `falling_friction` and `saturation`. Force and creepage have the same sign.
    As in the paper the force of spin knows neither the reduction factors nor the fall of friction: its limit is static.
    """
    if normal_load <= 0.0 or kinetic_friction <= 0.0 or patch.semi_axis_a <= 0.0 or patch.semi_axis_b <= 0.0:
        return 0.0, 0.0
    shifted_y = shifted_creepage(creepage_y, spin, patch.semi_axis_a)
    total = math.hypot(creepage_x, shifted_y)  # s_C, the paper's e_m
    if total == 0.0:
        return 0.0, 0.0
    translation = math.hypot(creepage_x, creepage_y)
    push = 0.0  # translational force over s_C
    if translation > 0.0:
        c_jj = math.hypot(patch.c11 * creepage_x, patch.c22 * creepage_y) / translation  # eq. (16)
        area = math.pi * patch.semi_axis_a * patch.semi_axis_b
        limit = normal_load * falling_friction(abs(slip_speed), kinetic_friction, friction_ratio, decrease_rate)
        gradient = 0.25 * patch.shear_modulus * area * c_jj * total / limit
        push = limit * saturation(gradient, k_adhesion, k_slip) / total
    turn = spin_factor(shifted_y, normal_load * kinetic_friction / friction_ratio, patch) / total
    return push * creepage_x, push * creepage_y + turn * spin


@kernel
def _loop(inputs: NDArray[np.float64], forces: NDArray[np.float64]) -> None:
    for i in range(inputs.shape[1]):
        v = inputs[:, i]
        patch = Patch(v[10], v[11], v[12], v[13], v[14], v[15])
        forces[0, i], forces[1, i] = force_with_spin(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], patch)


def polach_force(
    creepage_x: ArrayLike,
    creepage_y: ArrayLike,
    spin: ArrayLike,
    slip_speed: ArrayLike,
    normal_load: ArrayLike,
    patch: Patch,
    kinetic_friction: ArrayLike,
    friction_ratio: ArrayLike = 1.0,
    decrease_rate: ArrayLike = 0.0,
    k_adhesion: ArrayLike = 1.0,
    k_slip: ArrayLike = 1.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (T_x, T_y) [N] of `force_with_spin` for scalars or arrays that broadcast; so may the fields of `patch`.

    The defaults are a clean contact with constant friction.
    """
    friction = (kinetic_friction, friction_ratio, decrease_rate, k_adhesion, k_slip)
    return each_contact(_loop, creepage_x, creepage_y, spin, slip_speed, normal_load, *friction, *patch)
