"""A profile of wheel or rail as pieces in closed form, polynomials or arcs, which compiled code evaluates.

Profile coordinates: y [m] across, positive to the field side; z [m]. For a wheel z is what its radius has beyond the nominal
one, so the flange has a positive z; for a rail z points up and is 0 at the top of the head.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsp_env.compiled import loop

Array = NDArray[np.float64]

POLYNOMIAL, ARC = 0.0, 1.0
#: Columns of a piece: kind, then of a polynomial its origin y0 and nine coefficients of rising powers of y - y0, or of an arc
#: the centre (y, z), the radius, and +1 for the upper branch or -1 for the lower one.
COLUMNS = 11


class Profile(NamedTuple):
    """Pieces side by side; piece i holds from `breaks[i]` to `breaks[i + 1]` [m]."""

    breaks: Array  # (pieces + 1,), rising
    pieces: Array  # (pieces, COLUMNS)


def polynomial(coefficients: Sequence[float], origin: float = 0.0) -> list[float]:
    """Return the row of z = sum c_i (y - origin)^i, in metres; nine coefficients at most."""
    return [POLYNOMIAL, origin, *coefficients, *[0.0] * (COLUMNS - 2 - len(coefficients))]


def arc(centre_y: float, centre_z: float, radius: float, branch: float) -> list[float]:
    """Return the row of an arc, in metres; branch +1 is its upper half, -1 its lower one."""
    return [ARC, centre_y, centre_z, radius, branch, *[0.0] * (COLUMNS - 5)]


def assembled(breaks: Sequence[float], pieces: Sequence[Sequence[float]]) -> Profile:
    """Return the profile of these pieces, from the lowest y on."""
    return Profile(np.array(breaks, dtype=float), np.array(pieces, dtype=float))


@loop
def piece_at(breaks: Array, y: float) -> int:
    """Return the piece in which y lies; the first or last one for what lies outside."""
    low, high = 0, breaks.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if breaks[middle] <= y:
            low = middle
        else:
            high = middle
    return low


@loop
def height(breaks: Array, pieces: Array, y: float) -> tuple[float, float, float]:
    """Return z [m], dz/dy [-] and d2z/dy2 [1/m] at y [m]; the outermost pieces go on beyond the ends."""
    i = piece_at(breaks, y)
    if pieces[i, 0] == ARC:
        across, radius = y - pieces[i, 1], pieces[i, 3]
        up = math.sqrt(max(radius * radius - across * across, 1e-6 * radius * radius))  # finite where the arc has ended
        return pieces[i, 2] + pieces[i, 4] * up, -pieces[i, 4] * across / up, -pieces[i, 4] * radius * radius / (up * up * up)
    t = y - pieces[i, 1]
    z = slope = bend = 0.0
    for k in range(COLUMNS - 1, 1, -1):
        bend = bend * t + 2.0 * slope
        slope = slope * t + z
        z = z * t + pieces[i, k]
    return z, slope, bend


@loop
def _each(breaks: Array, pieces: Array, y: Array, out: Array) -> None:
    for i in range(y.shape[0]):
        out[0, i], out[1, i], out[2, i] = height(breaks, pieces, y[i])


def evaluate(profile: Profile, y: ArrayLike) -> tuple[Array, Array, Array]:
    """Return z [m], slope [-] and second derivative [1/m] of a profile at y [m], any shape."""
    at = np.asarray(y, dtype=float)
    out = np.empty((3, at.size))
    _each(profile.breaks, profile.pieces, at.ravel(), out)
    z, slope, bend = out.reshape(3, *at.shape)
    return z, slope, bend
