"""The wheelset at rest on straight track: how deep its own weight presses it into the rails."""

import math
from typing import NamedTuple

from wsp_env.contact.geometry.detect import scan
from wsp_env.contact.geometry.equilibrium import contacts, settled
from wsp_env.contact.geometry.forces import Slip, creeping
from wsp_env.contact.geometry.patch import patch_at, stiffness_at
from wsp_env.contact.geometry.port import ANGLE, CONTACTS, CURVATURE_A, CURVATURE_B, PRESSED, Pair, Pose, empty_contacts
from wsp_env.plant.multibody.bodies import Rolling


class Settled(NamedTuple):
    """A centred wheelset under a load."""

    z: float  # vertical shift, up [m]
    load_n: float  # of one wheel
    stiffness: float  # pi G a b c11 / 4 of the contact [N]


def load_at(z: float, r: Rolling) -> Settled:
    """Return the vertical force of one wheel of a centred wheelset that is shifted up by z [m]."""
    rows = empty_contacts()
    scan(Pose(0.0, z, 0.0, 0.0), 1.0, r.pair, rows)
    load, stiffness = 0.0, 0.0
    for at in range(CONTACTS):
        deep = float(rows[at, PRESSED])
        if deep > 0.0:
            curvatures = float(rows[at, CURVATURE_A]), float(rows[at, CURVATURE_B])
            own = stiffness_at(*curvatures, r.table) * deep**1.5
            load += own * math.cos(rows[at, ANGLE])
            stiffness = max(stiffness, creeping(Slip(1e-9, 0.0, 0.0, 0.0), 1.0, patch_at(*curvatures, own, r.table)).stiffness)
    return Settled(z, load, stiffness)


def centred_radius(pair: Pair) -> float:
    """Return the rolling radius [m] of a centred wheelset that just touches its rails; `ContactLostError` where it cannot."""
    return contacts(settled(0.0, 0.0, pair), "left", pair)[0].rolling_radius


def lowered(load_n: float, r: Rolling) -> Settled:
    """Return where a centred wheelset rests whose wheels carry `load_n` [N] each; bisection to 1e-12 m."""
    high, low = 2e-3, -2e-3
    while high - low > 1e-12:
        middle = 0.5 * (high + low)
        if load_at(middle, r).load_n > load_n:
            low = middle
        else:
            high = middle
    return load_at(high, r)
