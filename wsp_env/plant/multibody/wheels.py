"""The contacts of a wheelset: forces on its six coordinates and what a change of its speeds takes from them.

In a contact with the normal n and the tangents t1 (forwards) and t2 (across), the wheel's material moves by the slip (s_x,
s_y) against the rail and turns about n. The normal force is Hertz' with damping, the creep force that of the traction law for
the resultant slip with the lateral force of spin (seed paper, eqs. 13 to 18, see `wsp_env.contact.geometry.forces`). Forces act
along the same directions as the slips are taken, so that their power is that of friction exactly.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop
from wsp_env.contact.geometry.detect import follow, scan
from wsp_env.contact.geometry.forces import Creeping, Slip, creeping, resolved
from wsp_env.contact.geometry.patch import normal_force, patch_at, stiffness_at
from wsp_env.contact.geometry.port import (
    ANGLE,
    CONTACTS,
    CURVATURE_A,
    CURVATURE_B,
    PRESSED,
    ROLLING_RADIUS,
    Pair,
    Pose,
    X,
    Y,
    Z,
)
from wsp_env.contact.kalker import Patch
from wsp_env.contact.port import stiffened
from wsp_env.plant.components import rail as layer
from wsp_env.plant.longitudinal.axles import Stepping
from wsp_env.plant.multibody.bodies import Bodies, BodyConstants, Rolling, Scratch, Touching
from wsp_env.plant.multibody.structure import PITCH, ROLL, WHEELSETS, X_, Y_, YAW, Z_
from wsp_env.plant.multibody.way import Rail, rail
from wsp_env.plant.slots import after_contact, contact, recovery, surface

Array = NDArray[np.float64]

#: Lateral shift [m] beyond which the flange is near and contacts are searched along the whole profile (assumption: half the
#: play of S1002 on UIC60).
FLANGE_NEAR_M = 0.004
#: Time between two searches then, and otherwise [s].
_OFTEN_S, _SELDOM_S = 2e-3, 2e-2


class Met(NamedTuple):
    """One contact that touches, as the traction law is asked about it."""

    load: float  # N [N]; 0: it does not press
    root: float  # dN/dp / 1.5 [N/m]
    deep: float  # p [m]
    rolling: float  # forward speed [m/s]
    creep: Creeping
    patch: Patch


@loop
def look(side: float, pose: Pose, wide: bool, pair: Pair, rows: Array) -> int:
    """Bring the contacts of one wheel up to date, `wide` along its whole profile; return their number."""
    if not wide:
        count = follow(pose, side, pair, rows)
        if count > 0:
            return count
    return scan(pose, side, pair, rows)


@loop
def _directions(rows: Array, at: int, pose: Pose, radius: float, height: float, along: Array) -> None:
    """Write what a contact's point moves forwards, across and along the normal per coordinate of the wheelset."""
    sine, cosine = math.sin(rows[at, ANGLE]), math.cos(rows[at, ANGLE])
    x, y, z = rows[at, X], rows[at, Y] - pose.y, rows[at, Z] - height
    forward, across, normal = along[0], along[1], along[2]
    forward[X_], forward[Y_], forward[Z_], forward[ROLL], forward[PITCH], forward[YAW] = 1.0, 0.0, 0.0, 0.0, -radius, -y
    across[X_], across[Y_], across[Z_], across[ROLL] = 0.0, cosine, sine, sine * y - cosine * z
    # The wheel turns about a yawed axis: its rim moves across by yaw r w, more on an inclined contact (no part along n).
    across[PITCH], across[YAW] = -radius * pose.yaw / cosine, cosine * x
    normal[X_], normal[Y_], normal[Z_], normal[ROLL] = 0.0, -sine, cosine, cosine * y + sine * z
    normal[PITCH], normal[YAW] = 0.0, -sine * x


@loop
def meet(
    rows: Array, at: int, pose: Pose, own: Rail, curvature: float, worn: float, speed: Array, r: Rolling, along: Array
) -> Met:  # fmt: skip
    """Return the normal force and the slip of a contact, of a wheelset with the speeds (6,).

    `curvature` is that of the track [1/m], `worn` what the wheel's radius has beyond the nominal one [m].
    """
    radius = rows[at, ROLLING_RADIUS] + worn
    _directions(rows, at, pose, radius, r.radius + pose.z, along)
    s_x = s_y = v_n = 0.0
    for direction in range(3):  # who runs forwards is turned by the track: a contact's yaw moment slows the vehicle
        along[direction, X_] += curvature * along[direction, YAW]
    for row in range(6):
        s_x += along[0, row] * speed[row]
        s_y += along[1, row] * speed[row]
        v_n += along[2, row] * speed[row]
    s_y -= speed[X_] * (along[1, Y_] * own.y_rate + along[1, Z_] * own.z_rate)
    v_n -= speed[X_] * (along[2, Y_] * own.y_rate + along[2, Z_] * own.z_rate)
    spin = along[2, Y_] * speed[PITCH] + along[2, Z_] * (speed[YAW] + curvature * speed[X_])
    deep, a, b = rows[at, PRESSED], rows[at, CURVATURE_A], rows[at, CURVATURE_B]
    stiffness = stiffness_at(a, b, r.table)
    load = normal_force(deep, -v_n, stiffness, r.damping)
    patch = patch_at(a, b, load, r.table)
    return Met(
        load, stiffness * math.sqrt(deep), deep, speed[X_], creeping(Slip(s_x, s_y, spin, -v_n), speed[X_], patch), patch
    )


@loop
def press(
    k: int, h: float, theta: float, met: Met, law: tuple[float, float, float], r: Rolling, t: Touching
) -> tuple[float, float, float]:  # fmt: skip
    """Add a contact's forces; return the longitudinal creep force, and its force on the wheel to the left and up [N].

    `law` is the adhesion [-], its derivative by the slip speed [s/m] and the friction limit of the spin [-].
    """
    adhesion, slope, static = law
    creep, load = met.creep, met.load
    t_x, t_y = resolved(creep, adhesion, load, static, met.patch)
    steep = max(load * slope, 0.0)  # stiffness of the creep force along the slip and across it [N s/m]
    across = load * adhesion / creep.total if creep.total > 1e-12 else steep
    slip2 = creep.e_x * creep.e_x + creep.e_y * creep.e_y
    c2 = creep.e_x * creep.e_x / slip2 if slip2 > 0.0 else 1.0
    cs = creep.e_x * creep.e_y / slip2 if slip2 > 0.0 else 0.0
    s_xx, s_xy, s_yy = h * (across + (steep - across) * c2), h * (steep - across) * cs, h * (steep + (across - steep) * c2)
    s_nn = theta * h * met.root * (1.5 * theta * h + met.deep * r.damping)
    a = t.along
    for row in range(6):
        t.normal[k, row] += load * a[2, row]
        t.creep[k, row] -= t_x * a[0, row] + t_y * a[1, row]
        by_x, by_y, by_n = s_xx * a[0, row] + s_xy * a[1, row], s_xy * a[0, row] + s_yy * a[1, row], s_nn * a[2, row]
        for column in range(6):
            t.normal_by[k, row, column] += by_n * a[2, column]
            t.creep_by[k, row, column] += by_x * a[0, column] + by_y * a[1, column]
    return t_x, load * a[2, Y_] - t_y * a[1, Y_], load * a[2, Z_] - t_y * a[1, Z_]


@loop
def _clear(k: int, t: Touching) -> None:
    for row in range(6):
        t.normal[k, row] = t.creep[k, row] = 0.0
        for column in range(6):
            t.normal_by[k, row, column] = t.creep_by[k, row, column] = 0.0


@inlined
def touch(i: int, k: int, steps: int, curvature: float, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> bool:
    """Evaluate the contacts of wheelset k at the predicted coordinates into `w`; False where a wheel has left its rail.

    `curvature` is that of the track there [1/m], `steps` the substeps of the control interval so far.
    """
    state, c, p, law, active, _, _ = on_step
    first, at_all, r = WHEELSETS + 6 * k, w.motion.at, b.rolling
    place = state.position[i] - p.axle_offset[k]
    rolled = state.speed[i] * p.substep
    mu_cd, share = layer.look(i, place, c, p.rail)
    on = surface(i, k, place, rolled, mu_cd, share, law.mu_cr, active)
    tau = recovery(active, i, k, c.tau[i])
    _clear(k, w.touching)
    often, seldom = max(int(_OFTEN_S / p.substep + 0.5), 1), max(int(_SELDOM_S / p.substep + 0.5), 1)
    load, forward, limit_d, limit_r, kept, shift, on_rail = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True
    for wheel in range(2 * CONTACTS):
        j, at = wheel // CONTACTS, wheel % CONTACTS
        own = rail(place, j, b.way)
        pose = Pose(
            at_all[first + Y_] - own.y, at_all[first + Z_] - own.z, at_all[first + ROLL], at_all[first + YAW] - own.y_rate
        )
        rows = m.rows[i, k, j]
        if at == 0:
            shift += 0.5 * pose.y
            wide = steps % seldom == 0 or (abs(pose.y) > FLANGE_NEAR_M and steps % often == 0)
            m.wheel_load[i, k, j] = m.guiding[i, k, j] = 0.0
            look(1.0 - 2.0 * j, pose, wide, r.pair, rows)
            on_rail = on_rail and abs(pose.y) < r.widest and abs(pose.z) < r.highest
        if rows[at, PRESSED] > 0.0:
            worn = c.radius[i, k] - r.radius
            met = meet(rows, at, pose, own, curvature, worn, m.speed[i, first : first + 6], r, w.touching.along)
            # The law's own stiffness is kept where the vehicle's contact parameters belong: centred, under its own weight.
            own_law = stiffened(law, law.stiffness * met.creep.stiffness / r.reference)
            f = contact(met.creep.total, met.rolling, met.load, on, tau, own_law, active)
            t_x, f_y, f_z = press(
                k, p.substep, b.theta, met, (f.f, f.df_ds, on.mu_cd / law.ratio_d), r, w.touching
            )  # fmt: skip
            m.wheel_load[i, k, j] += f_z
            m.guiding[i, k, j] -= (1.0 - 2.0 * j) * f_y
            load += met.load
            forward += t_x
            limit_d += met.load * f.f_d
            limit_r += met.load * f.f_r
            kept += met.load * f.kept
    m.shift[i, k] = shift
    per_load = 1.0 / load if load > 0.0 else 0.0
    sign = 1.0 if forward >= 0.0 else -1.0
    state.adhesion[i, k] = forward * per_load
    state.adhesion_d[i, k] = sign * limit_d * per_load
    state.adhesion_r[i, k] = sign * limit_r * per_load
    after_contact(active, i, k, rolled, kept * per_load if load > 0.0 else 1.0)
    return on_rail
