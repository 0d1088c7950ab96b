"""Forces of one contact: slip from the wheelset's motion, the adhesion law on the resultant, and Polach's spin.

Sources: eqs. (13) to (18) of the seed paper. The contact's frame is t1 = x (along the track), t2 across in the tangent plane, to
the left, and n from the rail into the wheel. Slip and spin are the wheel's motion against the rail; the force on the **wheel** is
-t_x t1 - t_y t2 + N n, so that a positive slip gives a positive, retarding force as everywhere in this package.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop
from wsp_env.contact.geometry.port import ANGLE, Pose, X, Y, Z
from wsp_env.contact.kalker import Patch
from wsp_env.contact.polach import shifted_creepage, spin_factor
from wsp_env.contact.port import stiffened, traction
from wsp_env.contact.traction import SPEED_FLOOR, Adhesion, Surface


class Motion(NamedTuple):
    """Absolute velocity of a wheelset's centre [m/s] and angular velocity [rad/s], components in the track frame.

    Rolling forward is a positive `turn_y`. As the rails are fixed to the ground, a curve needs no further term.
    """

    v_x: float
    v_y: float
    v_z: float
    turn_x: float
    turn_y: float
    turn_z: float


class Slip(NamedTuple):
    """Motion of the wheel against the rail at one contact."""

    x: float  # along the track [m/s], positive in braking
    y: float  # across, in the tangent plane [m/s]
    spin: float  # about the normal [rad/s]
    approach: float  # rate of the penetration [m/s]


class Tangential(NamedTuple):
    """Tangential force of one contact and what its friction does."""

    x: float  # t_x [N], retarding where positive
    y: float  # t_y [N]
    work: float  # W_sp = f N e, friction work per metre of travel [J/m], eq. (15)
    adhesion: Adhesion  # of the resultant, with its limits, derivatives, and what the work leaves of the layer


@loop
def slip_at(motion: Motion, pose: Pose, radius: float, rows: NDArray[np.float64], row: int) -> Slip:
    """Return the slip at the contact in row `row`, eq. (13); `radius` is the nominal wheel radius [m] of the pair."""
    arm_x, arm_y, arm_z = rows[row, X], rows[row, Y] - pose.y, rows[row, Z] - radius - pose.z
    v_x = motion.v_x + motion.turn_y * arm_z - motion.turn_z * arm_y
    v_y = motion.v_y + motion.turn_z * arm_x - motion.turn_x * arm_z
    v_z = motion.v_z + motion.turn_x * arm_y - motion.turn_y * arm_x
    c, s = math.cos(rows[row, ANGLE]), math.sin(rows[row, ANGLE])
    return Slip(v_x, v_y * c + v_z * s, motion.turn_z * c - motion.turn_y * s, v_y * s - v_z * c)


class Creeping(NamedTuple):
    """A slip as the law and the spin take it."""

    total: float  # slip of the translation [m/s]
    stiffness: float  # pi G a b c / 4 in its direction, eq. (16), for the stress gradient at e_m [N]
    e_x: float  # creepages [-]
    e_y: float
    spin: float  # [1/m]
    shifted: float  # lateral creepage with what spin adds [-]
    modified: float  # e_m [-]


@inlined
def creeping(slip: Slip, speed: float, patch: Patch) -> Creeping:
    """Return a slip at a running speed [m/s] as the law takes it."""
    per_speed = 1.0 / max(abs(speed), SPEED_FLOOR)
    e_x, e_y, spin = slip.x * per_speed, slip.y * per_speed, slip.spin * per_speed
    total_slip = math.hypot(slip.x, slip.y)
    e = total_slip * per_speed
    shifted = shifted_creepage(e_y, spin, patch.semi_axis_a)
    e_m = math.hypot(e_x, shifted)
    share_x, share_y = (e_x / e, e_y / e) if e > 0.0 else (1.0, 0.0)
    c_jj = math.hypot(patch.c11 * share_x, patch.c22 * share_y)
    stiffness = 0.25 * math.pi * patch.shear_modulus * patch.semi_axis_a * patch.semi_axis_b * c_jj
    return Creeping(total_slip, stiffness * (e_m / e if e > 0.0 else 1.0), e_x, e_y, spin, shifted, e_m)


@inlined
def resolved(c: Creeping, adhesion: float, normal_load: float, static: float, patch: Patch) -> tuple[float, float]:
    """Return (t_x, t_y) [N] of eq. (18) from the law's adhesion [-]; `static` is the friction limit of the spin [-]."""
    if not (c.modified > 0.0 and normal_load > 0.0):
        return 0.0, 0.0
    push = adhesion * normal_load / c.modified
    turn = spin_factor(c.shifted, static * normal_load, patch) / c.modified
    return push * c.e_x, push * c.e_y + turn * c.spin


@loop
def tangential(slip: Slip, speed: float, normal_load: float, patch: Patch, on: Surface, tau: float, law: Any) -> Tangential:
    """Return the force of eq. (18) under any law of `wsp_env.contact.port`.

    `speed` [m/s] is the running speed, `tau` the recovery rate [m/J]. Stiffness follows the direction of the slip, eq. (16).
    The law is evaluated at the slip of the translation, its stress gradient at the modified creepage e_m, which spin enlarges;
    friction work and recovery are those of the translation. The force of spin has the static friction of the contaminated rail,
    mu_cd / A_d: as in the paper it knows neither the fall of friction nor recovery.
    """
    c = creeping(slip, speed, patch)
    adhesion = traction(c.total, speed, normal_load, on, tau, stiffened(law, c.stiffness))
    t_x, t_y = resolved(c, adhesion.f, normal_load, on.mu_cd / law.ratio_d, patch)
    return Tangential(t_x, t_y, adhesion.f * normal_load * math.hypot(c.e_x, c.e_y), adhesion)
