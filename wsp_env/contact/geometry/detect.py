"""Contact points: the places along the contact locus where wheel and rail come nearest to each other.

At a local extremum of the gap the two surfaces have one direction; as the locus is the wheel's outline seen along the track,
two angles are compared (see `overlap`). `scan` looks along the whole profile, `follow` goes on from the last contacts.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import loop
from wsp_env.contact.geometry.locus import Place, Wheel, place, placed
from wsp_env.contact.geometry.overlap import WIDTH, between, mismatch, rises
from wsp_env.contact.geometry.port import (
    ANGLE,
    AT_RAIL,
    AT_WHEEL,
    CONTACTS,
    CURVATURE_A,
    CURVATURE_B,
    PENETRATION,
    ROLLING_RADIUS,
    Pair,
    Pose,
    X,
    Y,
    Z,
)
from wsp_env.contact.geometry.pressing import press
from wsp_env.contact.geometry.profile import height

Array = NDArray[np.float64]

#: A candidate is dropped by `follow` when it moved further than this in one step [m]; a scan then finds where it went.
_REACH = 2e-3
#: Vertical gaps are longer than those along the normal, by no more than this [-] at the steepest place of a profile.
_STEEP = 20.0


@loop
def write(row: int, s: float, wheel: Wheel, side: float, pair: Pair, rows: Array) -> None:
    """Fill in one candidate at profile coordinate s [m]."""
    at = place(s, wheel, pair)
    z, slope, bend = height(pair.rail.breaks, pair.rail.pieces, at.across)
    rail_cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    penetration = (z - at.up) * rail_cosine
    n_y = at.normal_y * pair.cosine - at.normal_z * pair.sine  # out of the wheel, in the track frame
    n_z = at.normal_y * pair.sine + at.normal_z * pair.cosine
    rows[row, AT_WHEEL], rows[row, AT_RAIL] = s, at.across
    rows[row, PENETRATION] = penetration
    rows[row, X] = at.x
    rows[row, Y] = side * (at.y - 0.5 * penetration * n_y)  # midway between the two surfaces
    rows[row, Z] = at.z - 0.5 * penetration * n_z
    rows[row, ROLLING_RADIUS] = at.radius
    rows[row, ANGLE] = side * math.atan2(n_y, -n_z)
    curvatures(row, at, n_y, side, wheel, pair, bend * rail_cosine**3, rows)


@loop
def curvatures(row: int, at: Place, n_y: float, side: float, wheel: Wheel, pair: Pair, rail_bend: float, rows: Array) -> None:
    """Fill in A and B [1/m] of a candidate: half the principal sums of both surfaces' curvatures in the tangent plane.

    The wheel's principal directions are turned against the rail's by yaw; the ellipse's own turn, as small, is left out.
    """
    lift = 1.0 / math.sqrt(1.0 + at.slope * at.slope)
    around, across = lift / at.radius, -at.bend * lift**3
    cosine = wheel.cos_yaw * at.cos_lead + wheel.sin_yaw * at.sin_lead * wheel.sin_roll
    sine2 = max(1.0 - cosine * cosine, 0.0)
    along = side * pair.curvature * n_y  # of the rail, bent with the track
    q_xx = around + (across - around) * sine2 + along
    q_yy = across + (around - across) * sine2 - rail_bend
    q_xy = (around - across) * cosine * math.sqrt(sine2)
    mean, half = 0.5 * (q_xx + q_yy), 0.5 * (q_xx - q_yy)
    root = math.copysign(math.sqrt(half * half + q_xy * q_xy), half)
    rows[row, CURVATURE_A], rows[row, CURVATURE_B] = 0.5 * (mean + root), 0.5 * (mean - root)


@loop
def over_rail(wheel: Wheel, pair: Pair) -> tuple[float, float]:
    """Return the part of the wheel's profile that may lie over the rail [m]; the first is above the last where none does."""
    margin = 2.0 * pair.step
    off = wheel.y + (pair.taping * wheel.cos_yaw - pair.rail_y)  # of the taping line from the rail's origin
    ends = pair.rail.breaks
    # Roll, inclination and yaw move a point by its height times their sine; heights are below the width of a profile.
    reach = (ends[ends.shape[0] - 1] - ends[0]) * (abs(pair.sine) + abs(wheel.sin_roll) + abs(wheel.sin_yaw)) + margin
    reach += pair.radius * abs(wheel.sin_roll)
    return max(pair.first, ends[0] - off - reach), min(pair.last, ends[ends.shape[0] - 1] - off + reach)


@loop
def _clear(count: int, rows: Array) -> None:
    for row in range(count, CONTACTS):
        rows[row, PENETRATION] = -math.inf


@loop
def _insert(count: int, s: float, wheel: Wheel, side: float, pair: Pair, rows: Array) -> int:
    """Keep a candidate among the deepest; return their number."""
    _, _, overlap = mismatch(s, wheel, pair)
    if overlap < -_STEEP * pair.far:
        return count
    last = CONTACTS - 1
    if count == CONTACTS:
        kept = rows[last, PENETRATION]
        held = rows[last, AT_WHEEL]
        write(last, s, wheel, side, pair, rows)
        if rows[last, PENETRATION] <= kept:
            write(last, held, wheel, side, pair, rows)
            return count
        count = last
    else:
        write(count, s, wheel, side, pair, rows)
    if rows[count, PENETRATION] < -pair.far:
        return count
    row = count
    while row > 0 and rows[row, PENETRATION] > rows[row - 1, PENETRATION]:
        for column in range(rows.shape[1]):
            rows[row, column], rows[row - 1, column] = rows[row - 1, column], rows[row, column]
        row -= 1
    return count + 1


@loop
def scan(pose: Pose, side: float, pair: Pair, rows: Array) -> int:
    """Look for contacts along the whole profile; fill in `rows` (CONTACTS, fields), deepest first, return their number.

    `side` is +1.0 for the left wheel, -1.0 for the right one. The gap of each candidate is below `pair.far`.
    """
    wheel = placed(pose, side, pair)
    count = 0
    first, last = over_rail(wheel, pair)
    uphill, low = False, first
    steps = math.ceil((last - first) / pair.step)
    for i in range(steps + 1):
        s = min(first + i * pair.step, last)
        upwards = rises(s, wheel, pair)
        if uphill and not upwards:
            count = _insert(count, between(low, s, 1.0, wheel, pair), wheel, side, pair, rows)
        uphill, low = upwards, s
    _clear(count, rows)
    press(count, wheel, pair, rows)
    return count


@loop
def follow(pose: Pose, side: float, pair: Pair, rows: Array) -> int:
    """Go on from the candidates in `rows` at a pose near the last one; fill in `rows`, return their number.

    A candidate that ceases to be a local minimum of the gap, or moves by more than 2 mm, is dropped.
    """
    wheel = placed(pose, side, pair)
    count = 0
    for row in range(CONTACTS):
        if not rows[row, PENETRATION] > -math.inf:
            continue
        s, found = _followed(rows[row, AT_WHEEL], wheel, pair)
        for other in range(count):  # two that have grown together
            found = found and abs(s - rows[other, AT_WHEEL]) > 1e3 * WIDTH
        if found:
            write(count, s, wheel, side, pair, rows)
            count += 1
    _clear(count, rows)
    press(count, wheel, pair, rows)
    return count


@loop
def _followed(start: float, wheel: Wheel, pair: Pair) -> tuple[float, bool]:
    """Return the minimum of the gap next to `start` and whether there is one."""
    s = start
    for _ in range(6):
        angle, rate, overlap = mismatch(s, wheel, pair)
        if not overlap > -math.inf or rate >= 0.0:
            break
        step = -angle / rate
        s += step
        if not abs(s - start) < _REACH:
            break
        if abs(step) < WIDTH:
            return s, True
    # Newton's method jumps to and fro where the curvature jumps: walk uphill until the sign changes.
    stride = 0.1 * _REACH
    angle, _, overlap = mismatch(start, wheel, pair)
    if not overlap > -math.inf:
        return start, False
    way = stride if angle > 0.0 else -stride
    s = start
    for _ in range(10):
        further, _, overlap = mismatch(s + way, wheel, pair)
        if not overlap > -math.inf:
            return start, False
        if further * angle <= 0.0:
            return between(min(s, s + way), max(s, s + way), 1.0, wheel, pair), True
        s += way
    return start, False
