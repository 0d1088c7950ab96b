"""The rail: what lies along the track before any wheel comes, friction of the contaminated rail and share of the layer.

Its parameters are the grid's step; its state are the nodes of every stop, `profile` and `coverage` of the conditions.
"""

from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.port import Conditions


class RailConstants(NamedTuple):
    """The grid along the track."""

    step: float  # distance of the nodes [m]


@inlined
def along_track(i: int, place: float, table: np.ndarray, step: float) -> float:
    """Value of stop i at a place [m], linear between the nodes of `table` (N, M), which lie `step` [m] apart."""
    x = min(max(place / step, 0.0), table.shape[1] - 1.0)
    last = table.shape[1] - 1
    node = int(x)  # no min and max of whole numbers: compiled for CUDA they are floats, which are no index
    if node >= last:
        node = last - 1 if last > 0 else 0
    following = node + 1 if node < last else last
    return table[i, node] + (x - node) * (table[i, following] - table[i, node])


@inlined
def look(i: int, place: float, c: Conditions, r: RailConstants) -> tuple[float, float]:
    """Return mu_cd [-] and the share of the contaminant layer [-] at a place [m] of stop i."""
    layer = along_track(i, place, c.coverage, r.step)
    return c.mu_cd[i] * along_track(i, place, c.profile, r.step), layer
