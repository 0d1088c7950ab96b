"""How hard contacts press: humps of one overlap that share it, and the curvature over the width of a contact.

Two maxima of the overlap whose saddle lies in the rail too are humps of one contact. With p the humps' penetrations and q that
of the saddle, hump i presses as if p_i^1.5 - (1 - w_i) q^1.5 were its own p^1.5, where w_i = (p_i - q) / (p_1 + p_2 - 2 q).
A hump that has just risen from the other's side presses with nothing, two that have parted press as two, two alike share one
contact's load: the force goes on where maxima appear, vanish and change places (assumption: Hertz's force has no better answer
there; see the benchmark's cases at 0 mm).

Curvature jumps where the arcs of a profile join; a contact of some mm spans the joint, and its force does not jump. B is
therefore that of the parabola through the gap at the contact's edges, which lie where Hertz's contact of the local B has them,
by virtual penetration. At a joint both sides are parabolas of their own, so B is the same from either side.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import loop
from wsp_env.contact.geometry.locus import Wheel, outline
from wsp_env.contact.geometry.overlap import between, mismatch
from wsp_env.contact.geometry.port import AT_RAIL, AT_WHEEL, CONTACTS, CURVATURE_B, PENETRATION, PRESSED, Pair
from wsp_env.contact.geometry.profile import height

Array = NDArray[np.float64]

#: Share of a contact's penetration that remains when both bodies are moved apart until they meet in the true contact: Kik and
#: Piotrowski's, see `wsp_env.contact.geometry.centre`.
VIRTUAL = 0.55
#: Penetration [m] below which a contact is too narrow for its gap to be told from rounding; its force is below 0.1 N.
_LEAST = 1e-8


@loop
def press(count: int, wheel: Wheel, pair: Pair, rows: Array) -> None:
    """Fill in the pressing penetration of the first `count` candidates in `rows` and bring B to their width."""
    touching = 0
    for row in range(CONTACTS):
        rows[row, PRESSED] = max(rows[row, PENETRATION], 0.0) if row < count else 0.0
        touching += 1 if rows[row, PRESSED] > 0.0 else 0
    if touching > 1:
        _share(count, wheel, pair, rows)
    for row in range(count):
        if rows[row, PRESSED] > _LEAST:
            _widen(row, wheel, pair, rows)


@loop
def _share(count: int, wheel: Wheel, pair: Pair, rows: Array) -> None:
    """Let humps of one overlap share it."""
    for row in range(count):
        rows[row, PRESSED] = rows[row, PRESSED] ** 1.5
    for row in range(count):
        next_row = _next(row, count, rows)
        if next_row < 0 or not rows[row, PENETRATION] > 0.0:
            continue
        low, high = rows[row, AT_WHEEL], rows[next_row, AT_WHEEL]
        s = between(low, high, -1.0, wheel, pair)
        _, _, overlap = mismatch(s, wheel, pair)
        across, _, _, _ = outline(s, wheel, pair)
        _, slope, _ = height(pair.rail.breaks, pair.rail.pieces, across)
        saddle = overlap / math.sqrt(1.0 + slope * slope)
        if saddle > 0.0:
            own, other = rows[row, PENETRATION] - saddle, rows[next_row, PENETRATION] - saddle
            share = own / (own + other) if own + other > 0.0 else 0.5
            share = min(max(share, 0.0), 1.0)
            shared = saddle**1.5
            rows[row, PRESSED] -= (1.0 - share) * shared
            rows[next_row, PRESSED] -= share * shared
    for row in range(count):
        rows[row, PRESSED] = max(rows[row, PRESSED], 0.0) ** (2.0 / 3.0)


@loop
def _next(row: int, count: int, rows: Array) -> int:
    """Return the touching candidate next to `row` towards the field side, -1 if there is none."""
    best = -1
    for other in range(count):
        beyond = rows[other, PENETRATION] > 0.0 and rows[other, AT_WHEEL] > rows[row, AT_WHEEL]
        if beyond and (best < 0 or rows[other, AT_WHEEL] < rows[best, AT_WHEEL]):
            best = other
    return best


@loop
def _widen(row: int, wheel: Wheel, pair: Pair, rows: Array) -> None:
    """Bring B to the width of the contact."""
    across, s, b = rows[row, AT_RAIL], rows[row, AT_WHEEL], rows[row, CURVATURE_B]
    if not b > 0.0:
        return
    z, slope, _ = height(pair.rail.breaks, pair.rail.pieces, across)
    length = math.sqrt(1.0 + slope * slope)
    up = z - rows[row, PENETRATION] * length
    half = math.sqrt(VIRTUAL * rows[row, PRESSED] / b) / length
    gap_in, square_in = _gap(s - half, across, up, z, slope, wheel, pair)
    gap_out, square_out = _gap(s + half, across, up, z, slope, wheel, pair)
    mean = (gap_in + gap_out) / (square_in + square_out)
    if 0.0 < mean < math.inf:
        rows[row, CURVATURE_B] = mean


@loop
def _gap(
    s: float, across: float, up: float, z: float, slope: float, wheel: Wheel, pair: Pair
) -> tuple[float, float]:  # fmt: skip
    """Return the gap [m] of a contact at profile coordinate s [m] and its distance from the contact squared [m2].

    The wheel at (across, up) and the rail at (across, z) have the rail's `slope`; they are taken as touching there. The gap is
    along their normal, the distance along their tangent.
    """
    at, height_w, _, _ = outline(s, wheel, pair)
    ends = pair.rail.breaks
    if not ends[0] <= at <= ends[ends.shape[0] - 1]:
        return math.inf, 1.0
    height_r, there, _ = height(ends, pair.rail.pieces, at)
    cosine2 = 1.0 / (1.0 + slope * slope)
    along = (at - across) + slope * (height_w - up)
    return ((height_w - up) - (height_r - z)) / (math.sqrt(cosine2) * (1.0 + slope * there)), along * along * cosine2
