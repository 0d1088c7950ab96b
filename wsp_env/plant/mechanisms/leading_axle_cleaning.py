"""Earlier wheels clean the rail for later ones.

The seed paper mentions the effect and omits it (section 2: "the cleaning effect due to the action of the first wheels
guarantees better adhesion conditions to the following wheels"). Form used here: if earlier wheels spent the energy per metre E
[J/m] at a place, the share exp(-removal E) of the contaminant layer remains there. This is the exponential of the paper's
lambda (eq. 4) for a wheel's own energy. It reduces the gap f_r - f_d for later wheels. The rail under the vehicle is stored in
a ring of cells of `CELL_M`. The leading axle opens a new cell. Each axle adds its energy when it leaves the cell, so that no
wheel is affected twice by its own work, which is already in the paper's law.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Passage, Said, Signature

#: Length of a cell [m], longer than a substep at any speed and short compared with the axle distance.
CELL_M = 1.0

#: Cells of the ring beyond the vehicle's length: the longest step [m] that does not overwrite the cells of the last axle.
SPARE_CELLS = 8


class Parameters(NamedTuple):
    """Parameters of the cleaning, see `CARD`."""

    removal_m_per_j: float


def cells(vehicle_length_m: float) -> int:
    """Return the number of cells in the ring for a vehicle whose axles extend over `vehicle_length_m` [m]."""
    return math.ceil(vehicle_length_m / CELL_M) + SPARE_CELLS


class Spent(NamedTuple):
    """Energy that wheels spent on the rail under N vehicles with A axles."""

    ring: np.ndarray  # (N, cells) energy per metre on one rail [J/m]
    pending: np.ndarray  # (N, A) energy in the present cell [J], not yet in the ring


def memory(n: int, axle_positions_m: Sequence[float]) -> Spent:
    """Return the state of a rail on which no wheel has slid."""
    return Spent(np.zeros((n, cells(axle_positions_m[-1]))), np.zeros((n, len(axle_positions_m))))


@inlined
def _cell(place_m: float) -> int:
    """Return the number of the cell at a place [m]."""
    return int(math.floor(place_m / CELL_M))  # noqa: RUF046 -- compiled for CUDA the floor alone is a float, which is no index


@inlined
def layer_left(
    p: Parameters, spent: Spent, i: int, k: int, place_m: float, rolled_m: float, layer: float, held: float
) -> tuple[float, float]:  # fmt: skip
    """Shares of the contaminant layer [-], free and lagging, that earlier wheels left at a place on the rail [m]."""
    if p.removal_m_per_j == 0.0:
        return layer, held
    left = math.exp(-p.removal_m_per_j * spent.ring[i, _cell(place_m) % spent.ring.shape[1]])
    return left * layer, left * held


@inlined
def remember(p: Parameters, spent: Spent, i: int, axle: int, passage: Passage) -> None:
    """Add the energy that one wheel of an axle spent on its path."""
    if p.removal_m_per_j == 0.0:
        return
    ring, pending, energy_j = spent.ring, spent.pending, passage.energy_j
    before_m, after_m = passage.before_m, passage.after_m
    cell = _cell(before_m)
    entered = _cell(after_m)
    if entered == cell:
        pending[i, axle] += energy_j
        return
    size = ring.shape[1]
    per_metre = energy_j / (after_m - before_m)
    whole = pending[i, axle] + per_metre * ((cell + 1) * CELL_M - before_m)
    ring[i, cell % size] += whole / CELL_M
    for passed in range(cell + 1, entered + 1):
        if axle == 0:
            ring[i, passed % size] = 0.0
        if passed < entered:
            ring[i, passed % size] += per_metre
    pending[i, axle] = per_metre * (after_m - entered * CELL_M)


CARD = Card(
    name="leading_axle_cleaning",
    summary="energy spent by earlier wheels removes the contaminant layer at that place on the rail",
    parameters=(
        Parameter("removal_m_per_j", "m/J", 0.0, 2.0e-5, 0.0, 1.0e-2, "assumption, no source; form: eq. (4) of the seed paper"),
    ),
    record=Parameters,
    acts={"layer": layer_left, "after_passage": remember},
    memory=memory,
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: later axles have more at equal slip, by axle distance / v later; not before the leading axle slides",
        acts_on="contact",
        next_test="a stop with the leading axle's brake cut out: its cleaning must vanish behind it",
        said=(
            Said(
                "removal_m_per_j",
                "%",
                lambda r: 100.0 * (1.0 - math.exp(-1e4 * r)),
                "sliding axles clean the rail for those behind them: every 10 kJ/m takes away {size} of the contaminant layer",
            ),
        ),
        least_axles=2,
    ),
    study={"removal_m_per_j": 5e-5},
    longest_step_m=SPARE_CELLS * CELL_M,
)
