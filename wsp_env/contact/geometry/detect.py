"""Contact points: the places along the contact locus where wheel and rail come nearest to each other.

At a local extremum of the gap the two surfaces have one direction; as the locus is the wheel's outline seen along the track,
two angles are compared. `scan` looks along the whole profile, `follow` goes on from the last contacts.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import loop
from wsp_env.contact.geometry.locus import Place, Wheel, outline, place, placed
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
from wsp_env.contact.geometry.profile import height

Array = NDArray[np.float64]

#: Width [m] to which a contact is found. It then lies within 1e-9 m of the best place and its gap within 1e-16 m of the least.
_WIDTH = 1e-9
#: A candidate is dropped by `follow` when it moved further than this in one step [m]; a scan then finds where it went.
_REACH = 2e-3
#: Vertical gaps are longer than those along the normal, by no more than this [-] at the steepest place of a profile.
_STEEP = 20.0


@loop
def mismatch(s: float, wheel: Wheel, pair: Pair) -> tuple[float, float, float]:
    """Return angle of rail minus angle of wheel [rad] at profile coordinate s [m], its derivative [rad/m], and the overlap [m].

    The overlap is measured upwards in the rail's frame. Beyond the rail's ends it is -inf.
    """
    at = place(s, wheel, pair)
    ends = pair.rail.breaks
    if not ends[0] <= at.across <= ends[ends.shape[0] - 1]:
        return 1.0 if at.across < 0.0 else -1.0, -1.0, -math.inf
    z, slope, bend = height(ends, pair.rail.pieces, at.across)
    angle = math.atan(slope) - math.atan2(at.normal_y, -at.normal_z)
    return angle, bend / (1.0 + slope * slope) * at.across_rate - at.angle_rate, z - at.up


@loop
def _rises(s: float, wheel: Wheel, pair: Pair) -> bool:
    """Return whether the overlap grows with s: the sign of the mismatch, without its arctangents."""
    across, _, n_y, n_z = outline(s, wheel, pair)
    ends = pair.rail.breaks
    if not ends[0] <= across <= ends[ends.shape[0] - 1]:
        return across < 0.0
    _, slope, _ = height(ends, pair.rail.pieces, across)
    return slope * -n_z > n_y


@loop
def between(low: float, high: float, wheel: Wheel, pair: Pair) -> float:
    """Return where the mismatch falls through 0 between two profile coordinates: Newton's method, bisection where it leaves."""
    s = 0.5 * (low + high)
    for _ in range(60):
        angle, rate, _ = mismatch(s, wheel, pair)
        if angle > 0.0:
            low = s
        else:
            high = s
        step = -angle / rate if rate < 0.0 else math.inf
        if not low <= s + step <= high:
            step = 0.5 * (low + high) - s
        s += step
        if abs(step) < _WIDTH:
            break
    return s


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
    uphill, low = False, pair.first
    steps = math.ceil((pair.last - pair.first) / pair.step)
    for i in range(steps + 1):
        s = min(pair.first + i * pair.step, pair.last)
        rises = _rises(s, wheel, pair)
        if uphill and not rises:
            count = _insert(count, between(low, s, wheel, pair), wheel, side, pair, rows)
        uphill, low = rises, s
    _clear(count, rows)
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
        if found and (count == 0 or abs(s - rows[count - 1, AT_WHEEL]) > 1e3 * _WIDTH):
            write(count, s, wheel, side, pair, rows)
            count += 1
    _clear(count, rows)
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
        if abs(step) < _WIDTH:
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
            return between(min(s, s + way), max(s, s + way), wheel, pair), True
        s += way
    return start, False
