"""A wheelset at rest on its rails at a given lateral shift and yaw: where it touches, and with which forces.

`settled` lets the rigid wheelset down until each wheel touches. `loaded` presses each wheel with a vertical load and lets it
roll freely: height, roll and rolling speed follow from the balance of vertical forces and of the torque about the axle.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from wsp_env.contact.fastsim import ELEMENTS, STRIPS, fastsim
from wsp_env.contact.geometry.detect import scan
from wsp_env.contact.geometry.forces import Motion, slip_at
from wsp_env.contact.geometry.patch import PatchTable, patch_at, stiffness_at
from wsp_env.contact.geometry.port import Contact, ContactLostError, Pair, Pose, empty_contacts

Array = NDArray[np.float64]
SIDES = {"left": 1.0, "right": -1.0}
_HEIGHT_TOLERANCE = 1e-12  # [m], of a rigid wheelset on its rails
_LOOK = 0.02  # [m]: a wheel off its taping height by more than this is beside the rail
_DEPTH, _CREEPAGE = 2e-5, 1e-3  # sizes of penetration [m] and creepage [-] that scale the unknowns
_BALANCE = 1e-6  # forces and torque balance to this share of load and friction [-]


class Pressed(NamedTuple):
    """One contact under load; forces as in `wsp_env.contact.geometry.forces`."""

    contact: Contact
    normal: float  # N [N]
    t_x: float  # [N]
    t_y: float  # [N]
    creepage_x: float  # [-]
    creepage_y: float  # [-]
    spin: float  # [1/m]
    max_pressure: float  # of Hertz's ellipse [Pa]


def contacts(pose: Pose, side: str, pair: Pair) -> list[Contact]:
    """Return the candidates of the left or right wheel, deepest first; `ContactLostError` where there is none."""
    if not all(math.isfinite(value) for value in pose):
        raise ContactLostError(f"the pose of the wheelset must be finite numbers, got {tuple(pose)}")
    rows = empty_contacts()
    count = scan(Pose(*map(float, pose)), SIDES[side], pair, rows)
    if count == 0:
        raise ContactLostError(
            f"the {side} wheel is not on its rail at a lateral shift of {pose.y * 1e3:.4g} mm, {pose.z * 1e3:.4g} mm above its "
            f"nominal height, roll {pose.roll:.4g} rad, yaw {pose.yaw:.4g} rad"
        )
    return [Contact(*map(float, row)) for row in rows[:count]]


def settled(y: float, yaw: float, pair: Pair) -> Pose:
    """Return the pose in which the rigid wheelset touches both rails [m, rad]; `ContactLostError` where it cannot."""
    heights = [0.0, 0.0]
    for _ in range(100):
        pose = _pose(y, yaw, heights, pair)
        depths = [_depth(pose, side, pair) for side in SIDES]
        heights = [height + depth for height, depth in zip(heights, depths, strict=True)]
        if max(map(abs, depths)) < _HEIGHT_TOLERANCE:
            break
    return _pose(y, yaw, heights, pair)


def _pose(y: float, yaw: float, heights: list[float] | Array, pair: Pair) -> Pose:
    """Return the pose with these heights of the taping points, left and right [m]."""
    left, right = float(heights[0]), float(heights[1])
    return Pose(y, 0.5 * (left + right), math.asin(0.5 * (left - right) / pair.taping), yaw)


def _depth(pose: Pose, side: str, pair: Pair) -> float:
    """Return by how much a wheel must be lifted to touch just so [m]; negative: let down."""
    best = contacts(pose, side, pair._replace(far=_LOOK))[0]
    return best.penetration / math.cos(best.angle)


def loaded(
    y: float, yaw: float, load: float, friction: float, pair: Pair, table: PatchTable
) -> tuple[Pose, list[list[Pressed]]]:
    """Return the pose of a freely rolling wheelset and the contacts of its left and right wheel.

    Parameters
    ----------
    y, yaw : lateral shift [m] and yaw [rad], both given
    load : vertical load of each wheel [N]
    friction : constant friction coefficient [-]; tangential forces are FASTSIM's
    pair, table : see `track.make_pair` and `patch.make_patch_table`

    Raises
    ------
    ContactLostError
        No pose carries the loads.

    """
    first = settled(y, yaw, pair)
    at_rest = [first.z + first.roll * pair.taping, first.z - first.roll * pair.taping]

    def forces(unknown: Array) -> tuple[Pose, list[list[Pressed]], Array]:
        pose = _pose(y, yaw, [height - depth * _DEPTH for height, depth in zip(at_rest, unknown, strict=False)], pair)
        axle = (-math.sin(yaw) * math.cos(pose.roll), math.cos(yaw) * math.cos(pose.roll), math.sin(pose.roll))
        turn = (1.0 + unknown[2] * _CREEPAGE) / pair.radius
        motion = Motion(1.0, 0.0, 0.0, *(turn * part for part in axle))
        wheels = [_pressed(pose, motion, sign, friction, pair, table) for sign in SIDES.values()]
        up = [
            sum(one.normal * math.cos(one.contact.angle) - one.t_y * math.sin(one.contact.angle) for one in w) for w in wheels
        ]
        torque = sum(_torque(one, pose, axle, pair) for wheel in wheels for one in wheel)
        return pose, wheels, np.array([up[0] / load - 1.0, up[1] / load - 1.0, torque / (friction * load * pair.radius)])

    best = root(lambda unknown: forces(unknown)[2], np.array([1.0, 1.0, 0.0]), options={"xtol": 1e-10})
    pose, wheels, miss = forces(best.x)
    if not np.max(np.abs(miss)) < _BALANCE:
        raise ContactLostError(f"no pose carries the loads at a lateral shift of {y * 1e3:.4g} mm and a yaw of {yaw:.4g} rad")
    return pose, wheels


def _torque(one: Pressed, pose: Pose, axle: tuple[float, float, float], pair: Pair) -> float:
    """Return the torque of a contact's tangential force about the axle [N m]."""
    c, s = math.cos(one.contact.angle), math.sin(one.contact.angle)
    arm = (one.contact.x, one.contact.y - pose.y, one.contact.z - pair.radius - pose.z)
    return float(np.dot(np.cross(arm, (-one.t_x, -one.t_y * c, -one.t_y * s)), axle))


def _pressed(pose: Pose, motion: Motion, sign: float, friction: float, pair: Pair, table: PatchTable) -> list[Pressed]:
    rows = empty_contacts()
    found = []
    for row in range(scan(pose, sign, pair, rows)):
        contact = Contact(*map(float, rows[row]))
        if contact.pressed <= 0.0:
            continue
        a, b = contact.curvature_a, contact.curvature_b
        normal = stiffness_at(a, b, table) * contact.pressed**1.5
        patch = patch_at(a, b, normal, table)
        slip = slip_at(motion, pose, pair.radius, rows, row)
        t_x, t_y = fastsim(slip.x, slip.y, slip.spin, normal, friction, patch, STRIPS, ELEMENTS)
        pressure = 1.5 * normal / (math.pi * patch.semi_axis_a * patch.semi_axis_b)
        found.append(Pressed(contact, normal, t_x, t_y, slip.x, slip.y, slip.spin, pressure))
    return found
