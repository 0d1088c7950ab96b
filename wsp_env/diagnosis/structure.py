"""Correlation from row to row in the residual of a model: its size over the channels' noise, and whether it matters.

White residuals of any size are noise. What a row shares with the next row of the same axle and run is physics that neither
model nor nuisances describe. Better channels show more of it (bouncing loads, wind). It matters

- as an alternating force with an amplitude of 1 % of the retarding force, as a mechanism (`wsp_env.diagnosis.interest`), if it
  lasts from one block of the vehicle balance to the next: what swings by more than 0.5 Hz changes no speed and no distance;
- if it moves the slip of an axle by 0.1 m/s within a block;
- for rolling wheels, as a slip error of 0.1 m/s.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import linalg

from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, BALANCES, KINEMATICS, VEHICLE, Rows
from wsp_env.diagnosis.interest import PUSH
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen
from wsp_env.diagnosis.stops import BLOCK_S, SLIP_MPS, VEHICLE_BLOCK_S
from wsp_env.diagnosis.weights import Weights

#: Size of the correlated residual over the channels' noise, beside all nuisances, above which no model holds: a part as large
#: as the noise is visible in any plot.
STRUCTURED = 1.0
#: Blocks of the adhesion from one block of the vehicle balance to the next.
_LASTS = math.ceil(VEHICLE_BLOCK_S / BLOCK_S)
_LEAST_PAIRS = 20  # pairs of neighbouring rows of a balance that the estimate needs
_LEAST_MPS2 = 0.1  # lower bound of the mean deceleration to which amplitudes relate


class Structure(NamedTuple):
    """The residual's part that is correlated from row to row."""

    size: float  # over the channels' noise
    balance: str  # the balance with the largest one; balances in which it matters come first
    multiple: float  # of the smallest effect of interest

    @property
    def unexplained(self) -> bool:
        """Whether it is larger than the noise, and matters."""
        return self.size > STRUCTURED and self.multiple > 1.0


def structured(replica: Replica, seen: Screen, weights: Weights) -> Structure:
    """Return the correlated residual of a search's model: the largest that matters, over the balances.

    In the adhesion balance, sliding wheels and wheels that roll under the brake are separate kinds, as their noise is.

    Parameters
    ----------
    weights : of the search

    """
    rows = replica.rows
    rest = weights.projector.rest(weights(seen.base)) * weights.noise
    left, raw = seen.whitening.plain(rest), seen.whitening.back(rest)
    found = [Structure(0.0, BALANCES[0], 0.0)]
    for kind in np.unique(rows.noise):
        one, two = _pairs(rows, kind, 1)
        if len(one) >= _LEAST_PAIRS:
            shared = float(np.mean(left[one] * left[two]))
            multiple = _multiple(replica, seen, raw, weights.noise, int(kind)) if shared > STRUCTURED**2 else 0.0
            found.append(Structure(float(np.sqrt(max(shared, 0.0))), BALANCES[rows.balance[one[0]]], multiple))
    return max(found, key=lambda one: (one.unexplained, one.size))


def _pairs(rows: Rows, kind: int, later: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (m,) of one kind of noise, and the rows `later` rows after them, of the same axle and run."""
    mine = np.flatnonzero(rows.noise == kind)
    order = mine[np.lexsort((rows.time[mine], rows.axle[mine], rows.run[mine]))]
    one, two = order[:-later], order[later:]
    follows = (rows.run[one] == rows.run[two]) & (rows.axle[one] == rows.axle[two])
    return one[follows], two[follows]


def _multiple(replica: Replica, seen: Screen, raw: np.ndarray, noise: np.ndarray, kind: int) -> float:
    """Return the amplitude of the correlated residual in smallest effects of interest; `raw` (n,) in units of the balances."""
    rows = replica.rows
    one, two = _pairs(rows, kind, 1)
    if kind in (ADHESION, KINEMATICS):  # rolling wheels: as an error of slip
        stops = zip(replica.parts, replica.evaluate(seen.model), strict=True)
        slope = np.concatenate([part.joined(part.wheel_rows(stop.stiffness)) for part, stop in stops])
        return _amplitude(float(np.mean(raw[one] * raw[two] / (slope[one] * slope[two])))) / SLIP_MPS
    retarded = max(float(np.mean(rows.deceleration[one])), _LEAST_MPS2)
    if kind == VEHICLE:  # from the mean square of its rate
        square = 2.0 * (_of_speed(seen, raw, noise, rows, 1) - _of_speed(seen, raw, noise, rows, 2)) / VEHICLE_BLOCK_S**2
        return _amplitude(square) / retarded / PUSH
    # Deceleration of the vehicle [m/s2] by one unit on all axles; the same force on one axle turns its wheelset.
    unit = replica.axles / (replica.radius * replica.stops[0].mass) if kind == ACTUATOR else replica.vehicle.gravity_mps2
    turned = unit * replica.stops[0].mass / replica.axles * replica.radius**2 / replica.inertia
    by_axle = np.bincount(rows.axle[one], raw[one] * raw[two]) / np.maximum(np.bincount(rows.axle[one]), 1)
    push = _amplitude(unit**2 * _of_all_axles(raw, rows, kind)) / retarded / PUSH
    return max(push, turned * BLOCK_S * _amplitude(float(by_axle.max())) / SLIP_MPS)


def _of_speed(seen: Screen, raw: np.ndarray, noise: np.ndarray, rows: Rows, later: int) -> float:
    """Mean product [m2/s2] of vehicle rows and rows `later` rows after them, minus the covariance of their noise."""
    one, two = _pairs(rows, VEHICLE, later)
    products, at = raw[one] * raw[two], np.zeros(len(raw), dtype=int)
    for mine, root in seen.whitening.roots:
        half = linalg.solve_triangular(root, np.diag(noise[mine]), lower=True)
        at[mine] = np.arange(len(mine))
        inside = rows.run[one] == rows.run[mine[0]]
        products[inside] -= np.einsum("ij,ij->i", half[at[one[inside]]], half[at[two[inside]]])
    return float(np.mean(products))


def _of_all_axles(raw: np.ndarray, rows: Rows, kind: int) -> float:
    """Mean product of the blocks' means over all axles, whose forces may cancel each other, with those `_LASTS` blocks later.

    Slides that are shorter have fewer blocks; then the latest that are there count.
    """
    mine = rows.noise == kind
    moments, which = np.unique(np.stack([rows.run[mine], rows.time[mine]]), axis=1, return_inverse=True)
    mean = np.bincount(which.ravel(), raw[mine]) / (rows.axle.max() + 1)
    for later in range(_LASTS, 0, -1):
        apart = moments[:, later:] - moments[:, :-later]
        follows = (apart[0] == 0.0) & (apart[1] < (later + 0.5) * BLOCK_S)
        if follows.sum() >= _LEAST_PAIRS:
            return float(np.mean(mean[:-later][follows] * mean[later:][follows]))
    return 0.0


def _amplitude(square: float) -> float:
    """Amplitude of an oscillation with a given mean square."""
    return float(np.sqrt(2.0 * max(square, 0.0)))
