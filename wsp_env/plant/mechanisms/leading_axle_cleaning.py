"""Earlier wheels clean the rail for later ones.

The seed paper names the effect and leaves it out (section 2: "the cleaning effect due to the action of the first wheels
guarantees better adhesion conditions to the following wheels"). Form taken here: the energy per metre E [J/m] that earlier
wheels spent at a place leaves the share exp(-removal E) of the film there, the same exponential as the paper's lambda
(eq. 4) for a wheel's own energy; it narrows the gap f_r - f_d for the wheels behind.

The rail is remembered in cells of `CELL_M` under the vehicle, in a ring: the leading axle opens a fresh cell, every axle adds
what it spent when it leaves the cell, so that no wheel sees its own work twice (its own is in the paper's law).
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter

#: Length of a cell of rail [m]: longer than a substep at any speed, short against the distance of axles.
CELL_M = 1.0

#: Cells in the ring beyond the vehicle's length: the farthest step [m] that does not overwrite what the last axle reads.
SPARE_CELLS = 8


class Parameters(NamedTuple):
    """Parameters of the cleaning, see `MECHANISM`."""

    removal_m_per_j: float


MECHANISM = Mechanism(
    name="leading_axle_cleaning",
    summary="energy spent by earlier wheels removes the film at that place on the rail",
    parameters=(
        Parameter("removal_m_per_j", "m/J", 0.0, 2.0e-5, 0.0, 1.0e-2, "assumption, no source; form: eq. (4) of the seed paper"),
    ),
    record=Parameters,
    trace="adhesion: later axles have more at equal slip, lagging by axle distance / v, absent before the leading axle slides",
)


def cells(vehicle_length_m: float) -> int:
    """Cells the ring needs for a vehicle with its axles spread over `vehicle_length_m` [m]."""
    return math.ceil(vehicle_length_m / CELL_M) + SPARE_CELLS


@inlined
def film_left(p: Parameters, i: int, place_m: float, ring: np.ndarray) -> float:
    """Share of the film [-] that earlier wheels left at a place on the rail [m]; ring: (N, cells) [J/m]."""
    if p.removal_m_per_j == 0.0:
        return 1.0
    return math.exp(-p.removal_m_per_j * ring[i, math.floor(place_m / CELL_M) % ring.shape[1]])


@inlined
def remember(
    p: Parameters, axle: int, before_m: float, after_m: float, energy_j: float,
    i: int, ring: np.ndarray, pending: np.ndarray,
) -> None:  # fmt: skip
    """Book the energy [J] that one wheel of an axle spent on its way from `before_m` to `after_m` in `ring`, `pending`."""
    if p.removal_m_per_j == 0.0:
        return
    cell = math.floor(before_m / CELL_M)
    entered = math.floor(after_m / CELL_M)
    if entered == cell:
        pending[i, axle] += energy_j
        return
    size = ring.shape[1]
    per_metre = energy_j / (after_m - before_m)
    spent = pending[i, axle] + per_metre * ((cell + 1) * CELL_M - before_m)
    ring[i, cell % size] += spent / CELL_M
    for passed in range(cell + 1, entered + 1):
        if axle == 0:
            ring[i, passed % size] = 0.0
        if passed < entered:
            ring[i, passed % size] += per_metre
    pending[i, axle] = per_metre * (after_m - entered * CELL_M)
