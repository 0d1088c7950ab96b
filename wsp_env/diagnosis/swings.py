"""Frequencies at which the recorded speed oscillates about its prediction by the wheels' balances, as candidates for a force.

Each stop has a free phase here. The search decides whether one force explains all stops.
"""

from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.stops import PreparedStop
from wsp_env.plant.card import LOCKED_MPS

_MOST = 3  # number of proposed frequencies
_LOWEST_HZ, _HIGHEST_HZ, _STEP_HZ = 0.15, 1.5, 0.01  # train oscillations have some tenths of a hertz to one hertz
_SLOW_S = 6.0  # distance of the nodes of the slow course that is removed
_NODE_S = 0.1
_FEWEST = 40  # smallest number of nodes of a usable stop


def swings(stops: Sequence[PreparedStop], radius_m: float, inertia_kgm2: float) -> tuple[float, ...]:
    """Return the frequencies [Hz] that explain most of the recorded speeds, best first; empty if no stop is long enough."""
    tried = np.arange(_LOWEST_HZ, _HIGHEST_HZ, _STEP_HZ)
    explained = np.zeros(len(tried))
    for stop in stops:
        time, rest = _rest(stop, radius_m, inertia_kgm2)
        if len(time) < _FEWEST:
            continue
        place = (time - time[0]) / _SLOW_S
        slow = np.clip(1.0 - np.abs(place[:, None] - np.arange(int(place[-1]) + 2)), 0.0, None)
        basis = np.linalg.qr(slow)[0]
        left = rest - basis @ (basis.T @ rest)
        phase = 2.0 * np.pi * tried * time[:, None]
        pair = np.stack([np.sin(phase), np.cos(phase)])  # (2, n, F)
        pair -= basis @ (basis.T @ pair)
        gram, against = np.einsum("anf,bnf->fab", pair, pair), np.einsum("anf,n->fa", pair, left)
        removed = np.einsum("fa,fa->f", against, np.linalg.solve(gram, against[..., None])[..., 0])
        explained -= 0.5 * len(time) * np.log(np.maximum(1.0 - removed / (left @ left), 1e-9))
    peaks = 1 + np.flatnonzero((explained[1:-1] > explained[:-2]) & (explained[1:-1] >= explained[2:]))
    best = sorted(peaks, key=lambda i: -explained[i])[:_MOST]
    return tuple(round(float(tried[i]), 3) for i in best if explained[i] > 0.0)


def _rest(stop: PreparedStop, radius_m: float, inertia_kgm2: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] and recorded minus predicted speed [m/s], as means over `_NODE_S`."""
    turning = radius_m * stop.wheel > LOCKED_MPS
    moment = np.where(turning, stop.torque + inertia_kgm2 * stop.wheel_rate, 0.0).sum(axis=1)
    predicted = -np.cumsum(moment) * stop.step_s / (radius_m * stop.mass)
    length = max(round(_NODE_S / stop.step_s), 1)
    nodes = len(stop.time) // length

    def mean(values: np.ndarray) -> np.ndarray:
        result: np.ndarray = values[: nodes * length].reshape(nodes, length).mean(axis=1)
        return result

    return mean(stop.time), mean(stop.recorded_speed - predicted)
