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
TERMS = ("stopping_distance", "time", "rest_of_stop", "slip", "large_slip", "locked_wheels", "air")


class Prices(NamedTuple):
    """What the reward is made of, see `wsp_env.envs.task.RewardWeights` and `Task`."""

    stopping_distance: float
    time: float
    rest_of_stop: float
    slip: float
    large_slip: float
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
def note(
    position: np.ndarray, time: np.ndarray, air: np.ndarray, speed: np.ndarray, dry: np.ndarray, before: np.ndarray
) -> None:  # fmt: skip
    """Write position (N,) [m], time (N,) [s], air (N, A) [Nl] summed over the axles and speed (N,) [m/s] before a step.

    They go into `before` (5, N), and so does the deceleration `dry` (N,) [m/s2] of the demanded brake on dry rail.
    """
    for i in range(len(position)):
        before[0, i], before[1, i], before[2, i] = position[i], time[i], _sum(i, air)
        before[3, i], before[4, i] = speed[i], dry[i]


@inlined
def _rest(speed: float, dry: float, p: Prices) -> float:
    """Price of the rest of a stop from `speed` [m/s] with the deceleration `dry` [m/s2]."""
    return (0.5 * p.stopping_distance * speed + p.time) * speed / dry


@loop
def judge(
    before: np.ndarray, position: np.ndarray, time: np.ndarray, air: np.ndarray, speed: np.ndarray, slip: np.ndarray,
    p: Prices, terms: np.ndarray, reward: np.ndarray,
) -> None:  # fmt: skip
    """Write the terms of the reward for a step (7, N), in the order of `TERMS`, and their sum (N,).

    Parameters
    ----------
    before : (5, N) see `note`
    position, time, air : the same after the step
    speed, slip : running speed (N,) and slip speed (N, A) [m/s]
    p : weights and limits

    """
    n, axles = slip.shape
    for i in range(n):
        slid, beyond, locked = 0.0, 0.0, 0.0
        for k in range(axles):
            slid += max(slip[i, k], 0.0)
            if speed[i] > p.slide_limit_speed:
                beyond += max(slip[i, k] - p.slide_limit * speed[i], 0.0)
            if _is_locked(speed[i], speed[i] - slip[i, k]):
                locked += 1.0
        elapsed, travelled = time[i] - before[1, i], position[i] - before[0, i]
        terms[0, i] = -p.stopping_distance * travelled
        terms[1, i] = -p.time * elapsed
        terms[2, i] = p.rest_of_stop * (_rest(before[3, i], before[4, i], p) - _rest(speed[i], before[4, i], p))
        terms[3, i] = -p.slip * (slid / axles) * elapsed
        terms[4, i] = -p.large_slip * (beyond / axles) * elapsed
        terms[5, i] = -p.locked_wheels * (locked / axles) * travelled
        terms[6, i] = -p.air * (_sum(i, air) - before[2, i])
        reward[i] = 0.0
        for k in range(terms.shape[0]):
            reward[i] += terms[k, i]


@loop
def derive(speed: np.ndarray, slip: np.ndarray, air: np.ndarray, locked: np.ndarray, total: np.ndarray) -> None:
    """Write locked wheelsets (N, A) bool and the air of all axles (N,) [Nl]."""
    n, axles = slip.shape
    for i in range(n):
        for k in range(axles):
            locked[i, k] = _is_locked(speed[i], speed[i] - slip[i, k])
        total[i] = _sum(i, air)
