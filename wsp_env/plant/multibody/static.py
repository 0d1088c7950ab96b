"""The wheelset at rest on straight track: how deep its own weight presses it into the rails."""

import math
from typing import NamedTuple

from wsp_env.contact.geometry.detect import scan
from wsp_env.contact.geometry.port import ANGLE, CONTACTS, CURVATURE_A, CURVATURE_B, PENETRATION, Pose, empty_contacts
from wsp_env.plant.multibody.bodies import BodyConstants
from wsp_env.plant.multibody.elastic import ellipse


class Settled(NamedTuple):
    """A centred wheelset under a load."""

    z: float  # vertical shift, up [m]
    load_n: float  # of one wheel
    area_c11: float  # a b c11 of the contact [m2]


def load_at(z: float, b: BodyConstants) -> Settled:
    """Return the vertical force of one wheel of a centred wheelset that is shifted up by z [m]."""
    rows = empty_contacts()
    scan(Pose(0.0, z, 0.0, 0.0), 1.0, b.pair, rows)
    load, area = 0.0, 0.0
    for at in range(CONTACTS):
        deep = float(rows[at, PENETRATION])
        if deep > 0.0:
            e = ellipse(float(rows[at, CURVATURE_A]), float(rows[at, CURVATURE_B]), b.elastic)
            own = e.stiffness * deep**1.5
            load += own * math.cos(rows[at, ANGLE])
            area = max(area, e.semi_axis_a * e.semi_axis_b * own ** (2.0 / 3.0) * e.c11)
    return Settled(z, load, area)


def lowered(load_n: float, b: BodyConstants) -> Settled:
    """Return where a centred wheelset rests whose wheels carry `load_n` [N] each; bisection to 1e-12 m."""
    high, low = 2e-3, -2e-3
    while high - low > 1e-12:
        middle = 0.5 * (high + low)
        if load_at(middle, b).load_n > load_n:
            low = middle
        else:
            high = middle
    return load_at(high, b)
