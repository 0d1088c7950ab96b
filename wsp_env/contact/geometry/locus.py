"""The contact locus: the line on the wheel whose normal has no component along the track.

A wheel is a surface of revolution and a rail a prism, so a common normal is across the track. Of the circle of the wheel's
surface at profile coordinate s that condition picks the point at the angle theta from the bottom with

    sin(theta) - tan(yaw) sin(roll) cos(theta) = -tan(yaw) cos(roll) dR/ds,

in closed form. The search for contacts is then along one line, without any loss on straight track (E. A. H. Vollebregt,
Vehicle System Dynamics 60 (2022); refs. [2] and [7] of the seed paper). In a curve the rail is replaced by its tangent at the
wheelset's centre: 15 mm ahead of it, in a curve of 300 m, the rail is 0.4 um from the tangent and turned by 0.05 mrad.

All is written for the left wheel with outward coordinates; the right one is its mirror image.
"""

import math
from typing import NamedTuple

from wsp_env.compiled import loop
from wsp_env.contact.geometry.port import Pair, Pose
from wsp_env.contact.geometry.profile import height


class Wheel(NamedTuple):
    """A wheel's pose with what its trigonometry gives, in outward coordinates."""

    y: float  # of the middle of the wheelset [m], outwards
    z: float  # of the same, above the rails' tops [m]
    cos_roll: float
    sin_roll: float
    cos_yaw: float
    sin_yaw: float
    cos_turn: float  # of atan(tan(yaw) sin(roll)), by which a rolled wheel's locus is turned about the axle
    sin_turn: float
    lever: float  # tan(yaw) cos(roll) / sqrt(1 + (tan(yaw) sin(roll))^2) [-]


class Place(NamedTuple):
    """A point of the locus."""

    x: float  # in the track frame, outward coordinates [m]
    y: float
    z: float
    across: float  # the same in the rail's own frame [m]
    up: float
    normal_y: float  # normal out of the wheel in the rail's frame, unit vector
    normal_z: float
    across_rate: float  # derivative of `across` along the profile coordinate [-]
    angle_rate: float  # derivative of the angle of the normal [rad/m]
    radius: float  # [m]
    slope: float  # dR/ds [-]
    bend: float  # d2R/ds2 [1/m]
    cos_lead: float  # of theta, the angle ahead of the bottom
    sin_lead: float


@loop
def placed(pose: Pose, side: float, pair: Pair) -> Wheel:
    """Return the wheel of one side; its coordinates are mirrored for the right one."""
    cos_roll, sin_roll = math.cos(pose.roll), side * math.sin(pose.roll)
    cos_yaw, sin_yaw = math.cos(pose.yaw), side * math.sin(pose.yaw)
    skew = sin_yaw / cos_yaw
    cos_turn = 1.0 / math.sqrt(1.0 + (skew * sin_roll) ** 2)
    return Wheel(
        side * pose.y, pair.radius + pose.z, cos_roll, sin_roll, cos_yaw, sin_yaw, cos_turn, skew * sin_roll * cos_turn,
        skew * cos_roll * cos_turn,
    )  # fmt: skip


@loop
def outline(s: float, wheel: Wheel, pair: Pair) -> tuple[float, float, float, float]:
    """Return the point of the locus at profile coordinate s [m] in the rail's frame, (across, up) [m], and its normal there.

    The normal (y, z) points out of the wheel and has no unit length. A scan needs no more than this.
    """
    z, slope, _ = height(pair.wheel.breaks, pair.wheel.pieces, s)
    radius = pair.radius + z
    sine = min(max(-wheel.lever * slope, -1.0), 1.0)
    cosine = math.sqrt(1.0 - sine * sine)
    c = cosine * wheel.cos_turn - sine * wheel.sin_turn
    d = sine * wheel.cos_turn + cosine * wheel.sin_turn
    axial = pair.taping + s
    mid_y, mid_z = axial * wheel.cos_roll + radius * c * wheel.sin_roll, axial * wheel.sin_roll - radius * c * wheel.cos_roll
    dy = wheel.y + wheel.sin_yaw * radius * d + wheel.cos_yaw * mid_y - pair.rail_y
    dz = wheel.z + mid_z - pair.rail_z
    n_y = wheel.sin_yaw * d + wheel.cos_yaw * (-slope * wheel.cos_roll + c * wheel.sin_roll)
    n_z = -slope * wheel.sin_roll - c * wheel.cos_roll
    return (
        dy * pair.cosine + dz * pair.sine, -dy * pair.sine + dz * pair.cosine,
        n_y * pair.cosine + n_z * pair.sine, -n_y * pair.sine + n_z * pair.cosine,
    )  # fmt: skip


@loop
def place(s: float, wheel: Wheel, pair: Pair) -> Place:
    """Return the point of the locus at profile coordinate s [m], with the derivatives that a search needs."""
    z, slope, bend = height(pair.wheel.breaks, pair.wheel.pieces, s)
    radius = pair.radius + z
    sine = min(max(-wheel.lever * slope, -1.0), 1.0)
    cosine = math.sqrt(1.0 - sine * sine)
    lead_rate = -wheel.lever * bend / max(cosine, 1e-6)
    c = cosine * wheel.cos_turn - sine * wheel.sin_turn
    d = sine * wheel.cos_turn + cosine * wheel.sin_turn
    # In the wheelset's frame: point (radius d, taping + s, -radius c), normal (d, -slope, -c) without its length.
    axial = pair.taping + s
    mid_y, mid_z = axial * wheel.cos_roll + radius * c * wheel.sin_roll, axial * wheel.sin_roll - radius * c * wheel.cos_roll
    x = wheel.cos_yaw * radius * d - wheel.sin_yaw * mid_y
    y = wheel.y + wheel.sin_yaw * radius * d + wheel.cos_yaw * mid_y
    z = wheel.z + mid_z
    # How y and z change along the profile: r c is changed by slope c - r d lead', r d by slope d + r c lead'.
    c_rate, d_rate = slope * c - radius * d * lead_rate, slope * d + radius * c * lead_rate
    y_rate = wheel.sin_yaw * d_rate + wheel.cos_yaw * (wheel.cos_roll + c_rate * wheel.sin_roll)
    z_rate = wheel.sin_roll - c_rate * wheel.cos_roll
    # The normal and its change, in the track frame.
    n_y = wheel.sin_yaw * d + wheel.cos_yaw * (-slope * wheel.cos_roll + c * wheel.sin_roll)
    n_z = -slope * wheel.sin_roll - c * wheel.cos_roll
    m_y = wheel.sin_yaw * c * lead_rate + wheel.cos_yaw * (-bend * wheel.cos_roll - d * lead_rate * wheel.sin_roll)
    m_z = -bend * wheel.sin_roll + d * lead_rate * wheel.cos_roll
    length = math.sqrt(n_y * n_y + n_z * n_z)
    dy, dz = y - pair.rail_y, z - pair.rail_z
    return Place(
        x, y, z, dy * pair.cosine + dz * pair.sine, -dy * pair.sine + dz * pair.cosine,
        (n_y * pair.cosine + n_z * pair.sine) / length, (-n_y * pair.sine + n_z * pair.cosine) / length,
        y_rate * pair.cosine + z_rate * pair.sine, (n_y * m_z - n_z * m_y) / (length * length), radius, slope, bend, c, d,
    )  # fmt: skip
