"""Where the load of a contact acts when its gap is not a parabola.

By virtual penetration the contact is the part of the overlap that remains when both bodies are moved apart by 45 % of the
penetration, and each strip along the track carries load in proportion to what remains there (W. Kik and J. Piotrowski, 2nd
mini-conference on contact mechanics and wear of rail/wheel systems, Budapest 1996; J. Piotrowski and H. Chollet, Vehicle System
Dynamics 43 (2005) 455-483). In Hertz's case the centre is the point of deepest penetration.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import loop
from wsp_env.contact.geometry.detect import write
from wsp_env.contact.geometry.locus import placed
from wsp_env.contact.geometry.overlap import mismatch
from wsp_env.contact.geometry.port import AT_WHEEL, CURVATURE_B, PENETRATION, PRESSED, Pair, Pose
from wsp_env.contact.geometry.pressing import VIRTUAL

#: Strips from the deepest point to the edge that a parabola would have, and most strips on either side.
_STRIPS, _MOST = 12, 120


@loop
def centre_of_load(pose: Pose, side: float, pair: Pair, rows: NDArray[np.float64], row: int) -> float:
    """Return the wheel's profile coordinate [m] of the centre of load of the contact in row `row`, which must touch."""
    wheel = placed(pose, side, pair)
    start = rows[row, AT_WHEEL]
    _, _, deepest = mismatch(start, wheel, pair)
    apart = (1.0 - VIRTUAL) * deepest
    stride = math.sqrt(VIRTUAL * rows[row, PENETRATION] / rows[row, CURVATURE_B]) / _STRIPS
    load, moment = deepest - apart, 0.0
    for way in (-stride, stride):
        for i in range(1, _MOST):
            _, _, overlap = mismatch(start + i * way, wheel, pair)
            if overlap <= apart:
                break
            load += overlap - apart
            moment += (overlap - apart) * i * way
    return start + moment / load


@loop
def centred(pose: Pose, side: float, pair: Pair, rows: NDArray[np.float64], row: int, out: NDArray[np.float64]) -> None:
    """Fill in row 0 of `out` with the place of the centre of load; penetration and curvatures stay the deepest point's."""
    write(0, centre_of_load(pose, side, pair, rows, row), placed(pose, side, pair), side, pair, out)
    for column in (PENETRATION, CURVATURE_B - 1, CURVATURE_B, PRESSED):
        out[0, column] = rows[row, column]
