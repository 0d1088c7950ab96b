"""The way of the track for compiled code: curves with transitions and cant, and irregularities of both rails.

Curvature and tilt are linear within a segment, so heading and lateral position are known in closed form. The frame of the track
turns with the curve: a body in it feels the curve as forces, and bodies at different places see each other's frames shifted and
turned (`shift`).
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop
from wsp_env.contact.geometry.track import Track
from wsp_env.parameters.track_geometry import TrackGeometry

Array = NDArray[np.float64]

#: Columns of a segment: place where it begins [m], curvature there [1/m] and its rate [1/m2], heading [rad] and lateral
#: position [m] there, tilt [rad] and its rate [rad/m].
BEGIN, CURVATURE, CURVATURE_RATE, HEADING, ACROSS, TILT, TILT_RATE = range(7)

#: Columns of the irregularities: of the left rail across (to the left) and up, of the right rail across and up [m].
RAILS = 4


class Way(NamedTuple):
    """A track; straight and smooth if there is one segment and no node of irregularity."""

    segments: Array  # (segments, 7)
    rails: Array  # (nodes, 4) [m]; (0, 4): none
    node: float  # distance of the nodes [m]; the first lies at place 0, the table is repeated along the track


class Here(NamedTuple):
    """The track at one place."""

    curvature: float  # [1/m], to the left
    curvature_rate: float  # [1/m2]
    heading: float  # [rad]
    across: float  # [m]
    tilt: float  # [rad], left side up
    tilt_rate: float  # [rad/m]


class Rail(NamedTuple):
    """Irregularity of one rail at one place."""

    y: float  # [m], to the left
    z: float  # [m], up
    y_rate: float  # [-], per way
    z_rate: float  # [-]


def way(curvature: list[tuple[float, float, float]], rails: Array | None = None, node_m: float = 0.25) -> Way:
    """Return a track from nodes (place [m], curvature [1/m], tilt [rad]), both linear between them and constant beyond."""
    nodes = [(-1e9, *curvature[0][1:]), *curvature] if curvature else [(-1e9, 0.0, 0.0)]
    rows, heading, across = [], 0.0, 0.0
    for i, (begin, curve, tilt) in enumerate(nodes):
        last = i + 1 == len(nodes)
        length = 1.0 if last else nodes[i + 1][0] - begin
        rate = 0.0 if last else (nodes[i + 1][1] - curve) / length
        turn = 0.0 if last else (nodes[i + 1][2] - tilt) / length
        rows.append([begin, curve, rate, heading, across, tilt, turn])
        if not (last or i == 0):
            across += heading * length + curve * length**2 / 2.0 + rate * length**3 / 6.0
            heading += curve * length + rate * length**2 / 2.0
    return Way(np.array(rows), np.zeros((0, RAILS)) if rails is None else np.ascontiguousarray(rails, dtype=float), node_m)


def way_of(track: TrackGeometry) -> Way:
    """Return a track for compiled code."""
    nodes = [(0.0, 0.0, 0.0)]
    for curve in track.curves:
        curvature = 1.0 / curve.radius_m
        tilt = Track(track.gauge_m, curvature_1pm=curvature, superelevation_m=curve.cant_m).tilt_rad
        full = curve.begin_m + curve.transition_m
        nodes += [(curve.begin_m, 0.0, 0.0), (full, curvature, tilt), (full + curve.length_m, curvature, tilt)]
        nodes += [(curve.end_m, 0.0, 0.0)]
    kept = [node for node, after in itertools.pairwise(nodes) if after[0] > node[0]] + nodes[-1:]
    return way(kept if track.curves else [], track.irregularities.rails(), track.irregularities.node_m)


@loop
def here(place: float, s: Array) -> Here:
    """Return the track of the segments (segments, 7) at a place [m]."""
    i = s.shape[0] - 1
    while i > 0 and s[i, BEGIN] > place:
        i -= 1
    t = max(place - s[i, BEGIN], 0.0) if i > 0 else 0.0
    return Here(
        s[i, CURVATURE] + t * s[i, CURVATURE_RATE], s[i, CURVATURE_RATE],
        s[i, HEADING] + t * (s[i, CURVATURE] + t * 0.5 * s[i, CURVATURE_RATE]),
        s[i, ACROSS] + t * (s[i, HEADING] + t * (0.5 * s[i, CURVATURE] + t * s[i, CURVATURE_RATE] / 6.0)),
        s[i, TILT] + t * s[i, TILT_RATE], s[i, TILT_RATE],
    )  # fmt: skip


@inlined
def _cubic(t: float, a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return Catmull and Rom's cubic between b and c at t in [0, 1], and its derivative by t."""
    p, q, r = 0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 0.5 * (d - a) + 1.5 * (b - c)
    return b + t * (p + t * (q + t * r)), p + t * (2.0 * q + t * 3.0 * r)


@loop
def rail(place: float, side: int, w: Way) -> Rail:
    """Return the irregularity of a rail, side 0 left or 1 right, at a place [m]."""
    n = w.rails.shape[0]
    if n == 0:
        return Rail(0.0, 0.0, 0.0, 0.0)
    x = place / w.node
    i = int(np.floor(x))
    t = x - i
    i0, i1, i2, i3 = (i - 1) % n, i % n, (i + 1) % n, (i + 2) % n
    r, j = w.rails, 2 * side
    y, dy = _cubic(t, r[i0, j], r[i1, j], r[i2, j], r[i3, j])
    z, dz = _cubic(t, r[i0, j + 1], r[i1, j + 1], r[i2, j + 1], r[i3, j + 1])
    return Rail(y, z, dy / w.node, dz / w.node)
