"""What a multibody plant asks of the geometry: records and two compiled functions, `scan` and `follow`.

Frame: the track's, x forward, y to the left, z up; its origin lies midway between the rails at the height of their tops, under
the centre of the wheelset; its x axis is the tangent of the track there. `side` is +1 for the left wheel, -1 for the right.

A pose is (y, z, roll, yaw) of the wheelset in this frame, in metres and radians: the shift of its centre to the left and up
from the centred position with the taping points at the height of the rails' tops, roll (left side up), and yaw (left side
backwards), rotations about x and then z.

Irregularities of a rail are subtracted from the pose that its wheel is given. Superelevation tilts the frame and with it
gravity, not the contact.

A plant keeps one array (CONTACTS, len(Contact._fields)) for every wheel, makes it with `empty_contacts()`, and calls

    from wsp_env.contact.geometry.detect import follow, scan
    scan(pose, side, pair, rows)      # looks everywhere, 8 us or so; at the start, every few ms, beyond 4 mm of lateral shift
    follow(pose, side, pair, rows)    # goes on from the contacts in `rows`, 1 us or so

Both fill in `rows` and return the number of candidates, 0 to CONTACTS, deepest first after a scan. A candidate is a place
where the gap has a local minimum; it touches if its `penetration` is positive. Those that nearly touch are kept, so that
`follow` sees them close. Rows beyond the number have a penetration of -inf. 0 candidates after a scan: the wheel is far above
its rail, or beside it, or the pose is not a number; see `ContactLostError`. From `follow`, 0 may also mean that the contacts
moved on: scan, then judge.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.contact.geometry.profile import Profile

#: Candidates kept for one wheel.
CONTACTS = 3


class ContactLostError(ValueError):
    """A wheel is not above its rail any more."""


class Pose(NamedTuple):
    """Where a wheelset is; see the head of this file."""

    y: float  # lateral shift, to the left [m]
    z: float  # vertical shift, up [m]
    roll: float  # [rad], left side up
    yaw: float  # [rad], left side backwards


class Pair(NamedTuple):
    """Wheel and rail of one side, as outward coordinates (the two sides are mirror images); made by `track.make_pair`."""

    wheel: Profile
    rail: Profile
    radius: float  # nominal wheel radius at the taping line [m]
    taping: float  # distance of the taping line from the middle of the wheelset [m]
    rail_y: float  # origin of the rail's profile in the track frame, outwards [m]
    rail_z: float  # the same, up [m]
    cosine: float  # of the rail's inclination
    sine: float
    curvature: float  # of the track [1/m], positive to the left; bends the rails along the contact
    first: float  # the wheel's profile is searched from here [m]
    last: float  # to here [m]
    step: float  # of a scan [m]
    far: float  # a candidate's gap is no wider [m]


class Contact(NamedTuple):
    """One candidate: a row of the array that `scan` and `follow` fill in."""

    at_wheel: float  # y of the wheel's profile, positive to the field side [m]
    at_rail: float  # y of the rail's profile, positive to the field side [m]
    penetration: float  # along the normal [m]; negative: a gap
    x: float  # position in the track frame [m], ahead of the wheelset's centre
    y: float  # [m], from the middle of the track to the left
    z: float  # [m], up from the rails' tops
    rolling_radius: float  # distance from the axle [m]
    angle: float  # contact angle in the track frame, rotation of the tangent plane about x [rad]
    curvature_a: float  # A [1/m], half the sum of the curvatures in rolling direction
    curvature_b: float  # B [1/m], the same across, over the width of a contact that touches
    pressed: float  # penetration that its force belongs to [m]: less than its own where humps share one overlap, else 0 or more


# Columns by name, constants for compiled code.
AT_WHEEL, AT_RAIL, PENETRATION, X, Y, Z, ROLLING_RADIUS, ANGLE, CURVATURE_A, CURVATURE_B, PRESSED = range(len(Contact._fields))


def empty_contacts(wheels: int | None = None) -> NDArray[np.float64]:
    """Return the array (CONTACTS, fields) of one wheel, or (wheels, CONTACTS, fields), without candidates."""
    shape = (CONTACTS, len(Contact._fields))
    rows = np.zeros(shape if wheels is None else (wheels, *shape))
    rows[..., PENETRATION] = -np.inf
    return rows
