"""How far the wheel reaches into the rail along the contact locus, and where it does so most and least."""

import math

from wsp_env.compiled import loop
from wsp_env.contact.geometry.locus import Wheel, outline, place
from wsp_env.contact.geometry.port import Pair
from wsp_env.contact.geometry.profile import height

#: Width [m] to which a contact is found. It then lies within 1e-9 m of the best place and its gap within 1e-16 m of the least.
WIDTH = 1e-9


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
def rises(s: float, wheel: Wheel, pair: Pair) -> bool:
    """Return whether the overlap grows with s: the sign of the mismatch, without its arctangents."""
    across, _, n_y, n_z = outline(s, wheel, pair)
    ends = pair.rail.breaks
    if not ends[0] <= across <= ends[ends.shape[0] - 1]:
        return across < 0.0
    _, slope, _ = height(ends, pair.rail.pieces, across)
    return slope * -n_z > n_y


@loop
def between(low: float, high: float, sign: float, wheel: Wheel, pair: Pair) -> float:
    """Return where the overlap is greatest (`sign` +1) or least (-1) between two profile coordinates.

    Newton's method for the mismatch, bisection where it leaves the two.
    """
    s = 0.5 * (low + high)
    for _ in range(60):
        angle, rate, _ = mismatch(s, wheel, pair)
        if sign * angle > 0.0:
            low = s
        else:
            high = s
        step = -angle / rate if sign * rate < 0.0 else math.inf
        if not low <= s + step <= high:
            step = 0.5 * (low + high) - s
        s += step
        if abs(step) < WIDTH:
            break
    return s
