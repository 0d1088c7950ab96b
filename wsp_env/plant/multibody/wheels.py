"""The contacts of a wheelset: forces on its six coordinates and what a change of its speeds takes from them.

In a contact with the normal n and the tangents t1 (forwards) and t2 (across), the wheel's material moves by the slip (s_x, s_y)
against the rail and turns about n. The normal force is N = k p^1.5 (1 + beta dp/dt), the creep force that of the traction law for
the resultant slip (seed paper, eqs. 13 to 17), with its stiffness for this ellipse and direction (eq. 16) and the lateral force of
spin (eq. 18). Forces act along the same directions as the slips are taken, so that their power is that of friction exactly.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop
from wsp_env.contact.geometry.detect import follow, scan
from wsp_env.contact.geometry.port import (
    ANGLE,
    CONTACTS,
    CURVATURE_A,
    CURVATURE_B,
    PENETRATION,
    ROLLING_RADIUS,
    Pose,
    X,
    Y,
    Z,
)
from wsp_env.contact.kalker import Patch
from wsp_env.contact.polach import spin_factor
from wsp_env.contact.port import stiffened
from wsp_env.contact.traction import SPEED_FLOOR, Adhesion, Surface
from wsp_env.plant.components import rail as layer
from wsp_env.plant.longitudinal.axles import Stepping
from wsp_env.plant.multibody.bodies import Bodies, BodyConstants, Scratch
from wsp_env.plant.multibody.elastic import ellipse
from wsp_env.plant.multibody.structure import PITCH, ROLL, WHEELSETS, X_, Y_, YAW, Z_
from wsp_env.plant.multibody.way import Rail, rail
from wsp_env.plant.slots import after_contact, contact, recovery, surface

Array = NDArray[np.float64]

#: Lateral shift [m] beyond which the flange is near and contacts are searched along the whole profile: half the play of S1002 on
#: UIC60 (assumption).
FLANGE_NEAR_M = 0.004
#: Substeps between two searches then, and otherwise.
_OFTEN, _SELDOM = 4, 40


@inlined
def _directions(rows: Array, at: int, pose: Pose, radius: float, height: float, w: Scratch) -> None:
    """Write what a contact's point moves forwards, across and along the normal per coordinate of the wheelset."""
    sine, cosine = math.sin(rows[at, ANGLE]), math.cos(rows[at, ANGLE])
    x, y, z = rows[at, X], rows[at, Y] - pose.y, rows[at, Z] - height
    w.rows_x[X_], w.rows_x[Y_], w.rows_x[Z_], w.rows_x[ROLL], w.rows_x[PITCH], w.rows_x[YAW] = 1.0, 0.0, 0.0, 0.0, -radius, -y
    # The wheel turns about a yawed axis: its rim moves across by yaw r w, more on an inclined contact (no part along n).
    w.rows_y[X_], w.rows_y[Y_], w.rows_y[Z_] = 0.0, cosine, sine
    w.rows_y[ROLL], w.rows_y[PITCH], w.rows_y[YAW] = sine * y - cosine * z, -radius * pose.yaw / cosine, cosine * x
    w.rows_n[X_], w.rows_n[Y_], w.rows_n[Z_] = 0.0, -sine, cosine
    w.rows_n[ROLL], w.rows_n[PITCH], w.rows_n[YAW] = cosine * y + sine * z, 0.0, -sine * x


@loop
def _add_contact(
    k: int, forces: tuple[float, float, float], stiff: tuple[float, float, float, float], along: tuple[Array, Array, Array],
    normal: Array, creep: Array, normal_by: Array, creep_by: Array,
) -> None:  # fmt: skip
    """Add normal force and creep forces, and their stiffnesses nn, xx, xy, yy, along the directions x, y, n."""
    load, t_x, t_y = forces
    s_nn, s_xx, s_xy, s_yy = stiff
    r_x, r_y, r_n = along
    for row in range(6):
        normal[k, row] += load * r_n[row]
        creep[k, row] -= t_x * r_x[row] + t_y * r_y[row]
        by_x, by_y, by_n = s_xx * r_x[row] + s_xy * r_y[row], s_xy * r_x[row] + s_yy * r_y[row], s_nn * r_n[row]
        for column in range(6):
            normal_by[k, row, column] += by_n * r_n[column]
            creep_by[k, row, column] += by_x * r_x[column] + by_y * r_y[column]


@inlined
def _creep(
    s_x: float, s_y: float, spin: float, speed: float, load: float, on: Surface, tau: float, active: Any, patch: Patch,
    law: Any, reference: float,
) -> tuple[float, float, float, float, Adhesion]:  # fmt: skip
    """Return (T_x, T_y) [N] along the slip, and their stiffness along it and across it [N s/m], with the adhesion."""
    per_speed = 1.0 / max(abs(speed), SPEED_FLOOR)
    shifted = s_y + spin * patch.semi_axis_a / per_speed  # Polach's s_yC as a speed
    if abs(shifted) <= abs(s_y):
        shifted = s_y
    total = math.hypot(s_x, shifted)
    slip = math.hypot(s_x, s_y)
    c_jj = math.hypot(patch.c11 * s_x, patch.c22 * s_y) / slip if slip > 0.0 else patch.c11
    own = stiffened(law, patch.semi_axis_a * patch.semi_axis_b * c_jj / reference)
    adhesion = contact(total, speed, load, on, tau, own, active)
    push = load * (adhesion.f / total if total > 1e-12 else adhesion.df_ds)  # [N s/m]
    turn = 0.0
    if spin != 0.0 and total > 1e-12:
        turn = spin_factor(shifted * per_speed, load * on.mu_cd, patch) / (total * per_speed) * spin
    return push * s_x, push * s_y + turn, max(load * adhesion.df_ds, 0.0), push, adhesion


class Sums(NamedTuple):
    """What the contacts of a wheelset, or of one wheel, add up to."""

    load: float  # normal forces [N]
    forward: float  # longitudinal creep forces [N], positive in braking
    limit_d: float  # adhesion limits without recovery and after it, times the normal force [N]
    limit_r: float
    kept: float  # share of the layer that the work leaves, times the normal force [N]


@inlined
def _look(i: int, k: int, j: int, side: float, pose: Pose, wide: bool, m: Bodies, b: BodyConstants) -> int:
    """Bring the contacts of one wheel up to date; return their number."""
    rows = m.rows[i, k, j]
    if not wide:
        count = follow(pose, side, b.pair, rows)
        if count > 0:
            return count
    return scan(pose, side, b.pair, rows)


@inlined
def _press(
    i: int, k: int, j: int, at: int, pose: Pose, own: Rail, turning: float, on: Surface, tau: float, on_step: Stepping,
    m: Bodies, b: BodyConstants, w: Scratch,
) -> Sums:  # fmt: skip
    """Add the forces of one contact that touches."""
    state, c, p, law, active, _, _ = on_step
    rows, first, h = m.rows[i, k, j], WHEELSETS + 6 * k, p.substep
    radius = rows[at, ROLLING_RADIUS] + c.radius[i, k] - b.nominal_radius
    _directions(rows, at, pose, radius, b.nominal_radius + pose.z, w)
    s_x = s_y = v_n = 0.0
    for row in range(6):
        speed = m.speed[i, first + row]
        s_x += w.rows_x[row] * speed
        s_y += w.rows_y[row] * speed
        v_n += w.rows_n[row] * speed
    s_x += w.rows_x[YAW] * turning
    s_y += w.rows_y[YAW] * turning
    rolling = m.speed[i, first + X_]
    v_n -= rolling * (w.rows_n[Y_] * own.y_rate + w.rows_n[Z_] * own.z_rate)
    spin = w.rows_n[Y_] * m.speed[i, first + PITCH] + w.rows_n[Z_] * (m.speed[i, first + YAW] + turning)
    e = ellipse(rows[at, CURVATURE_A], rows[at, CURVATURE_B], b.elastic)
    deep = rows[at, PENETRATION]
    elastic = e.stiffness * deep * math.sqrt(deep)
    damping = elastic * b.contact_damping
    load = elastic - damping * v_n
    if load <= 0.0:
        return Sums(0.0, 0.0, 0.0, 0.0, 0.0)
    size = load ** (1.0 / 3.0)
    patch = Patch(e.semi_axis_a * size, e.semi_axis_b * size, b.elastic.shear_modulus, e.c11, e.c22, e.c23)
    per_speed = 1.0 / max(abs(rolling), SPEED_FLOOR)
    t_x, t_y, along, across, adhesion = _creep(
        s_x, s_y, spin * per_speed, rolling, load, on, tau, active, patch, law, b.reference
    )  # fmt: skip
    slip2 = s_x * s_x + s_y * s_y
    c2 = s_x * s_x / slip2 if slip2 > 0.0 else 1.0
    cs = s_x * s_y / slip2 if slip2 > 0.0 else 0.0
    d_xx, d_xy, d_yy = across + (along - across) * c2, (along - across) * cs, along + (across - along) * c2
    stiff = 1.5 * e.stiffness * math.sqrt(deep)
    gone = b.theta * h * (b.theta * h * stiff + damping)
    _add_contact(
        k, (load, t_x, t_y), (gone, h * d_xx, h * d_xy, h * d_yy), (w.rows_x, w.rows_y, w.rows_n), w.normal, w.creep,
        w.normal_by, w.creep_by,
    )  # fmt: skip
    side = 1.0 - 2.0 * j
    m.wheel_load[i, k, j] += load * w.rows_n[Z_] - t_y * w.rows_y[Z_]
    m.guiding[i, k, j] -= side * (load * w.rows_n[Y_] - t_y * w.rows_y[Y_])
    return Sums(load, t_x, load * adhesion.f_d, load * adhesion.f_r, load * adhesion.kept)


@inlined
def touch(i: int, k: int, steps: int, curvature: float, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> bool:
    """Evaluate the contacts of wheelset k at the predicted coordinates into `w`; False where a wheel has left its rail.

    `curvature` is the track's there [1/m], `steps` the substeps so far.
    """
    state, c, p, law, active, _, _ = on_step
    first = WHEELSETS + 6 * k
    turning = m.speed[i, first + X_] * curvature
    place = state.position[i] - p.axle_offset[k]
    mu_cd, share = layer.look(i, place, c, p.rail)
    rolled = state.speed[i] * p.substep
    on = surface(i, k, place, rolled, mu_cd, share, law.mu_cr, active)
    tau = recovery(active, i, k, c.tau[i])
    for row in range(6):
        w.normal[k, row] = w.creep[k, row] = 0.0
        for column in range(6):
            w.normal_by[k, row, column] = w.creep_by[k, row, column] = 0.0
    load, forward, limit_d, limit_r, kept, shift, on_rail = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True
    for j in range(2):
        own = rail(place, j, b.way)
        pose = Pose(w.at[first + Y_] - own.y, w.at[first + Z_] - own.z, w.at[first + ROLL], w.at[first + YAW] - own.y_rate)
        shift += 0.5 * pose.y
        wide = steps % _SELDOM == 0 or (abs(pose.y) > FLANGE_NEAR_M and steps % _OFTEN == 0)
        m.wheel_load[i, k, j] = m.guiding[i, k, j] = 0.0
        if _look(i, k, j, 1.0 - 2.0 * j, pose, wide, m, b) == 0:
            on_rail = on_rail and abs(pose.y) < b.widest and abs(pose.z) < b.highest
        for at in range(CONTACTS):
            if m.rows[i, k, j, at, PENETRATION] > 0.0:
                s = _press(i, k, j, at, pose, own, turning, on, tau, on_step, m, b, w)
                load += s.load
                forward += s.forward
                limit_d += s.limit_d
                limit_r += s.limit_r
                kept += s.kept
    m.shift[i, k] = shift
    if load > 0.0:
        sign = 1.0 if forward >= 0.0 else -1.0
        state.adhesion[i, k] = forward / load
        state.adhesion_d[i, k] = sign * limit_d / load
        state.adhesion_r[i, k] = sign * limit_r / load
        after_contact(active, i, k, rolled, kept / load)
    else:
        state.adhesion[i, k] = state.adhesion_d[i, k] = state.adhesion_r[i, k] = 0.0
    return on_rail
