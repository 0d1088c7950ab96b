"""Friction that turns the wheel: in a closed loop what friction does by itself and the slip go together.

A sliding wheel hardly holds itself: where the load bounces or the rail is better for a moment, the wheel speeds up, and the
anti-slide device answers. So high friction and small slip go together without any law that says so (the bias of simultaneous
equations, Haavelmo, Econometrica 11, 1943). The slip that a law is asked at must therefore not know the friction that it is to
explain. What one knows before a block of time begins is the slip until then, and the torque; from these the wheel's own
equation foresees the slip within the block (the prediction error method, L. Ljung, System identification, 1999, chapters 7 and
13: in closed loop it has no such bias where the noise's colour is known, see `wsp_env.diagnosis.colour`). It begins one block
earlier, as a slip that was smoothed knows a little of what follows. What friction was beside the law in the block before that
is taken to go on, so that a large effect that is missing does not mislead. What holds for a slip holds for how fast a wheel
turns: what reads a wheel late, or gives it another inertia, acts by its rates, and these know the friction just as well.

And the recorded torque within the block knows the friction, too, as the device answers within it. So the slip is foreseen under
the torque that was to be expected before, by a regression over all blocks of a stop (the first of two stages of least squares,
Theil 1953, in Economic forecasts and policy, 1961, chapter 6). Only what a time does, a late sensor or brake, is seen by the
torque's own course; for that the torque stays the recorded one.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.stops import PreparedStop, least_slip

_PAST_S = (0.04, 0.08, 0.16)  # before a block begins, over which it counts how the torque moved: some steps of a valve


def stretches(rows: Rows) -> list[np.ndarray]:
    """Return the rows (m,) of every wheel's slides without a gap, in the order of time."""
    found = []
    for run in np.unique(rows.run):
        for axle in range(int(rows.axle.max(initial=-1)) + 1):
            mine = np.flatnonzero((rows.run == run) & (rows.axle == axle) & rows.wheels)
            slides, apart = rows.slides[mine], np.diff(rows.time[mine])
            ends = (apart > 1.5 * apart.min(initial=np.inf)) | (slides[1:] != slides[:-1])
            parts = np.split(mine, np.flatnonzero(ends) + 1) if len(mine) else []
            found += [part for part in parts if rows.slides[part[0]]]
    return found


def foreseen(
    stop: PreparedStop, torque: np.ndarray, holds: np.ndarray, block: int, radius: float, inertia: float
) -> tuple[PreparedStop, PreparedStop]:
    """Return a stop whose sliding wheels turn in each block as it is foreseen at the beginning of the one before, twice.

    First under the torques that were to be expected, with torques at which the law's friction gives the foreseen rates; then
    under the recorded torques, with the stop's own. A wheel that does not slide throughout both blocks stays as it is.

    Parameters
    ----------
    stop : with the torques at which a law's friction gives its wheels' rates
    torque : (T, A) recorded [N m]: where it is less, friction was less than the law's, and the wheel slower for it
    holds : (T, A) the law's torque on a wheel by its slip [N m s/m]: what brings a wheel back on the creep curve's steep part
    block : samples of a block
    radius, inertia : of a wheelset [m], [kg m2]

    """
    slip, least = stop.speed[:, None] - radius * stop.wheel, least_slip(stop.speed)[:, None]
    throughout: np.ndarray = np.asarray(_blocks(slip > least, block).all(axis=1))
    both = throughout & _before(throughout)
    pushes = _blocks(torque - stop.torque, block)
    by_moment = radius * stop.step_s / inertia  # slip [m/s] in a sample by 1 N m
    known = _before(_before(pushes.mean(axis=1) * throughout))  # what friction was beside the law goes on
    keeps = _with_before(np.exp(-_blocks(holds, block) * by_moment))
    moments = _with_before(pushes) - known[:, None]
    surprise = _with_before(_blocks(torque, block)) - _expected(torque, (slip, stop.wheel_rate), both, block, stop.step_s)

    def within(values: np.ndarray) -> np.ndarray:
        """Return the second blocks (T, A) of values (B, 2 block, A)."""
        result: np.ndarray = (values[:, block:] * both[:, None]).reshape(-1, slip.shape[1])[: len(slip)]
        return result

    def turned(moments: np.ndarray) -> PreparedStop:
        """Return the wheels without what moments (B, 2 block, A) [N m] did to them."""
        less = np.zeros((len(moments), 2 * block + 1, slip.shape[1]))  # slip that they took [m/s]
        for i in range(2 * block):
            less[:, i + 1] = keeps[:, i] * less[:, i] + by_moment * moments[:, i]
        rate = np.diff(less, axis=1) / stop.step_s
        slid_on = np.clip(stop.wheel - within(less[:, :-1]) / radius, 0.0, (stop.speed[:, None] - least) / radius)
        return dataclasses.replace(
            stop,
            wheel=np.where(slip > least, slid_on, stop.wheel),
            wheel_rate=stop.wheel_rate - within(rate) / radius,
            wheel_jerk=stop.wheel_jerk - within(np.gradient(rate, stop.step_s, axis=1)) / radius,
        )

    expected = moments - surprise
    return dataclasses.replace(turned(expected), torque=stop.torque + within(expected)), turned(moments)


def _expected(
    torque: np.ndarray, states: Sequence[np.ndarray], both: np.ndarray, block: int, step_s: float
) -> np.ndarray:  # fmt: skip
    """Return the torques (B, 2 block, A) [N m] that were to be expected over every block and the one before.

    A regression says so of all blocks `both` (B, A), by what was known as the first one began: the torque until then, and
    `states` (T, A) of the wheel. Its prior is worth one block, and says that the torque stays (Kass and Wasserman, J. Am. Stat.
    Assoc. 90, 1995). Other blocks have the recorded torques.
    """
    result = _with_before(_blocks(torque, block))
    blocks, axle = np.nonzero(both)
    if not len(blocks):
        return result
    begins = (blocks - 1) * block

    def before(values: np.ndarray, seconds: float = 0.0) -> np.ndarray:
        return values[np.clip(begins - 1 - round(seconds / step_s), 0, None), axle]

    stays = before(torque)
    known = [stays, *(stays - before(torque, seconds) for seconds in _PAST_S), *map(before, states)]
    x = np.column_stack([np.ones(len(stays)), *known])
    x /= np.maximum(np.linalg.norm(x, axis=0), 1e-12)
    moves = result[blocks, :, axle] - stays[:, None]
    prior = np.eye(x.shape[1]) / np.sqrt(len(x))
    weights = np.linalg.lstsq(np.vstack([x, prior]), np.vstack([moves, np.zeros((len(prior), moves.shape[1]))]), rcond=None)[0]
    result[blocks, :, axle] = stays[:, None] + x @ weights
    return result


def _with_before(values: np.ndarray) -> np.ndarray:
    """Return of every block (B, block, A) the one before and itself (B, 2 block, A)."""
    return np.concatenate([_before(values), values], axis=1)


def _before(values: np.ndarray) -> np.ndarray:
    """Return of every block (B, ...) the one before; of the first zeros."""
    return np.concatenate([np.zeros_like(values[:1]), values[:-1]])


def _blocks(values: np.ndarray, block: int) -> np.ndarray:
    """Return values (T, A) by blocks (B, block, A); the last one is filled up by its last sample."""
    blocks = -(-len(values) // block)
    filled = np.pad(values, ((0, blocks * block - len(values)), (0, 0)), "edge")
    return filled.reshape(blocks, block, values.shape[1])
