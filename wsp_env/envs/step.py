"""What a step of the environments computes beside plant and observer: the reward and what is true; compiled."""

from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.envs.task import Task

#: A wheelset counts as locked below this wheel speed [m/s] while the vehicle runs above `LOCKED_RUNNING_MPS` (assumption: the
#: cut-out speed of a WSP, 5 km/h).
LOCKED_WHEEL_MPS = 0.3
LOCKED_RUNNING_MPS = 5.0 / 3.6

#: Terms of the reward, in the order of `judge`.
TERMS = ("stopping_distance", "slip", "locked_wheels", "air")

#: Below this running speed [m/s] the creepage is that at this speed: it is undefined at rest.
_SLOWEST_MPS = 1e-3


class Prices(NamedTuple):
    """What the reward is made of, see `wsp_env.envs.task.RewardWeights` and `Task`."""

    stopping_distance: float
    slip: float
    locked_wheels: float
    air: float
    slide_limit: float  # creepage [-]
    slide_limit_speed: float  # [m/s]


def prices(task: Task) -> Prices:
    """Return what the reward of a task is made of."""
    weights = task.weights
    terms = {name: float(getattr(weights, name)) for name in TERMS}
    return Prices(**terms, slide_limit=float(task.slide_limit), slide_limit_speed=float(task.slide_limit_speed_mps))


@inlined
def _is_locked(speed: float, wheel: float) -> bool:
    """Whether a wheelset with this circumferential speed stands while the vehicle runs at `speed`, both [m/s]."""
    return wheel < LOCKED_WHEEL_MPS and speed > LOCKED_RUNNING_MPS


@inlined
def _sum(i: int, values: np.ndarray) -> float:
    total = 0.0
    for k in range(values.shape[1]):
        total += values[i, k]
    return total


@loop
def note(position: np.ndarray, time: np.ndarray, air: np.ndarray, before: np.ndarray) -> None:
    """Write position (N,) [m], time (N,) [s] and air (N, A) [Nl] before a step, summed over the axles, into `before` (3, N)."""
    for i in range(len(position)):
        before[0, i], before[1, i], before[2, i] = position[i], time[i], _sum(i, air)


@loop
def judge(
    before: np.ndarray, position: np.ndarray, time: np.ndarray, air: np.ndarray, speed: np.ndarray, slip: np.ndarray,
    p: Prices, terms: np.ndarray, reward: np.ndarray,
) -> None:  # fmt: skip
    """Write the terms of the reward for a step (4, N), in the order of `TERMS`, and their sum (N,).

    Parameters
    ----------
    before : (3, N) see `note`
    position, time, air : the same after the step
    speed, slip : running speed (N,) and slip speed (N, A) [m/s]
    p : weights and limits

    """
    n, axles = slip.shape
    for i in range(n):
        beyond, locked = 0.0, 0.0
        for k in range(axles):
            if speed[i] > p.slide_limit_speed:
                beyond += max(slip[i, k] / max(speed[i], _SLOWEST_MPS) - p.slide_limit, 0.0)
            if _is_locked(speed[i], speed[i] - slip[i, k]):
                locked += 1.0
        elapsed = time[i] - before[1, i]
        terms[0, i] = -p.stopping_distance * (position[i] - before[0, i])
        terms[1, i] = -p.slip * (beyond / axles) * elapsed
        terms[2, i] = -p.locked_wheels * (locked / axles) * elapsed
        terms[3, i] = -p.air * (_sum(i, air) - before[2, i])
        reward[i] = terms[0, i] + terms[1, i] + terms[2, i] + terms[3, i]


@loop
def derive(speed: np.ndarray, slip: np.ndarray, air: np.ndarray, locked: np.ndarray, total: np.ndarray) -> None:
    """Write locked wheelsets (N, A) bool and the air of all axles (N,) [Nl]."""
    n, axles = slip.shape
    for i in range(n):
        for k in range(axles):
            locked[i, k] = _is_locked(speed[i], speed[i] - slip[i, k])
        total[i] = _sum(i, air)
