"""The slip with the least cost on the estimated rail.

At slip speed s and adhesion f(s), a wheelset slows the vehicle by f g and slides s metres per second. The slip with the least
(v + c s) / f(s) costs the least distance, travelled and priced for sliding, per loss of speed. The rail estimates, one for each
recovery rate (`wsp_env.observer.rail`), are weighted by their fit.
"""

from typing import Any

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.contact.degraded import adhesion
from wsp_env.contact.traction import Surface
from wsp_env.observer.rail import RECOVERY_M_PER_J, RailEstimate, RailEstimateConstants

#: Tried slips as shares of the running speed, and the lowest [m/s] (assumptions: up to below the slide limit of 0.3, down to
#: the slip of wheels that roll under brake).
SHARES = tuple(0.003 * (0.25 / 0.003) ** (j / 15.0) for j in range(16))
LEAST_MPS = 0.05

#: Sliding time [s] whose data count as one independent reading of the rail (assumption: slow changes within a slide).
READING_S = 0.5


@inlined
def believe(i: int, r: RailEstimate, weights: np.ndarray) -> None:
    """Write the weights (N, K) of the estimates of rail i: likelihoods of normal readings with unknown standard deviation."""
    readings, total = r.seen[i] / READING_S, 0.0
    least = 1e9
    for j in range(len(RECOVERY_M_PER_J)):
        least = min(least, r.deviation[i, j])
    for j in range(len(RECOVERY_M_PER_J)):
        weights[i, j] = (max(least, 1e-3) / max(r.deviation[i, j], 1e-3)) ** readings
        total += weights[i, j]
    for j in range(len(RECOVERY_M_PER_J)):
        weights[i, j] /= total


@inlined
def slip_worth_its_price(
    i: int, speed: float, offered: float, price: float, r: RailEstimate, weights: np.ndarray, c: RailEstimateConstants
) -> float:
    """Return the slip [m/s] with the least (v + c s) / f(s) on the estimated rail i.

    Parameters
    ----------
    speed : v, running speed [m/s]
    offered : largest adhesion [-] that the brake can use
    price : c, metres travelled per metre of sliding of equal cost
    weights : (N, K), see `believe`

    """
    least, best, before = 1e30, LEAST_MPS, 0.0
    for share in SHARES:
        slip = max(share * speed, LEAST_MPS)
        if slip == before:
            continue
        before, carried = slip, 0.0
        for j in range(len(RECOVERY_M_PER_J)):
            if weights[i, j] > 0.01:
                on = Surface(r.friction[i, j], c.law.mu_cr, 1.0, 0.0)
                carried += weights[i, j] * adhesion(slip, max(speed, slip), c.load, on, RECOVERY_M_PER_J[j], c.law).f
        cost = (speed + price * slip) / max(min(carried, offered), 1e-4)
        if cost < least:
            least, best = cost, slip
    return best


def weights_of(n: int) -> Any:
    """Allocate the weights (N, K) of n rails."""
    return np.zeros((n, len(RECOVERY_M_PER_J)))
