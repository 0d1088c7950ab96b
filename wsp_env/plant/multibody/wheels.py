"""The contacts of a wheelset: forces on its six coordinates and what a change of its speeds takes from them.

In a contact with the normal n and the tangents t1 (forwards) and t2 (across), the wheel's material moves by the slip (s_x, s_y)
against the rail and turns about n. The normal force is N = k p^1.5 (1 + beta dp/dt), the creep force that of the traction law for
the resultant slip (seed paper, eqs. 13 to 17), with its stiffness for this ellipse and direction (eq. 16) and the lateral force of
spin (eq. 18). Forces act along the same directions as the slips are taken, so that their power is that of friction exactly.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop
from wsp_env.contact.geometry.detect import follow, scan
from wsp_env.contact.geometry.forces import Slip, creeping, resolved
from wsp_env.contact.geometry.patch import normal_force, patch_at, stiffness_at
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
from wsp_env.contact.port import stiffened
from wsp_env.contact.traction import Surface
from wsp_env.plant.components import rail as layer
from wsp_env.plant.longitudinal.axles import Stepping
from wsp_env.plant.multibody.bodies import Bodies, BodyConstants, Scratch
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
    deep = rows[at, PENETRATION]
    stiff = stiffness_at(rows[at, CURVATURE_A], rows[at, CURVATURE_B], b.table)
    load = normal_force(deep, -v_n, stiff, b.contact_damping)
    if load <= 0.0:
        return Sums(0.0, 0.0, 0.0, 0.0, 0.0)
    patch = patch_at(rows[at, CURVATURE_A], rows[at, CURVATURE_B], load, b.table)
    slip = Slip(s_x, s_y, spin, -v_n)
    creep = creeping(slip, rolling, patch)
    # The law's own stiffness is kept where the vehicle's contact parameters belong: centred, under the empty vehicle's weight.
    own_law = stiffened(law, law.stiffness * creep.stiffness / b.reference)
    adhesion = contact(creep.total, rolling, load, on, tau, own_law, active)
    t_x, t_y = resolved(creep, adhesion.f, load, on.mu_cd / law.ratio_d, patch)
    along = max(load * adhesion.df_ds, 0.0)  # stiffness of the creep force along the slip and across it [N s/m]
    across = load * adhesion.f / creep.total if creep.total > 1e-12 else along
    slip2 = creep.total * creep.total
    c2 = s_x * s_x / slip2 if slip2 > 0.0 else 1.0
    cs = s_x * s_y / slip2 if slip2 > 0.0 else 0.0
    d_xx, d_xy, d_yy = across + (along - across) * c2, (along - across) * cs, along + (across - along) * c2
    root = stiff * math.sqrt(deep)
    gone = b.theta * h * root * (1.5 * b.theta * h + deep * b.contact_damping)
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
