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
"""

import dataclasses

import numpy as np

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.stops import PreparedStop, least_slip


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
) -> PreparedStop:
    """Return a stop whose sliding wheels turn in each block as it is foreseen at the beginning of the one before.

    Torques stay as they are; so does a wheel that does not slide throughout both.

    Parameters
    ----------
    stop : with the torques at which a law's friction gives its wheels' rates
    torque : (T, A) recorded [N m]: where it is less, friction was less than the law's, and the wheel slower for it
    holds : (T, A) the law's torque on a wheel by its slip [N m s/m]: what brings a wheel back on the creep curve's steep part
    block : samples of a block
    radius, inertia : of a wheelset [m], [kg m2]

    """
    slip, least = stop.speed[:, None] - radius * stop.wheel, least_slip(stop.speed)[:, None]
    pushes, slides = (_blocks(values, block) for values in (torque - stop.torque, slip > least))
    pushes, keeps = pushes * (radius * stop.step_s / inertia), np.exp(-_blocks(holds, block) * (radius * stop.step_s / inertia))
    more = np.zeros((len(pushes), block + 1, slip.shape[1]))  # slip that friction would have left to the wheel [m/s]
    throughout = np.asarray(slides.all(axis=1, keepdims=True))
    known = pushes.mean(axis=1) * throughout[:, 0]  # what friction was beside the law goes on
    for _ in range(2):  # from the beginning of the block; then from that of the block before
        more[1:, 0] = more[:-1, block]
        known = np.vstack([np.zeros_like(known[:1]), known[:-1]])
        for i in range(block):
            more[:, i + 1] = keeps[:, i] * more[:, i] + pushes[:, i] - known
    both = np.concatenate([np.zeros_like(throughout[:1]), throughout[1:] & throughout[:-1]])
    rate = np.diff(more, axis=1) / stop.step_s
    lost = [
        (values * both).reshape(-1, slip.shape[1])[: len(slip)] / radius
        for values in (more[:, :block], rate, np.gradient(rate, stop.step_s, axis=1))
    ]
    slid_on = np.clip(stop.wheel - lost[0], 0.0, (stop.speed[:, None] - least) / radius)
    return dataclasses.replace(
        stop,
        wheel=np.where(slip > least, slid_on, stop.wheel),
        wheel_rate=stop.wheel_rate - lost[1],
        wheel_jerk=stop.wheel_jerk - lost[2],
    )


def _blocks(values: np.ndarray, block: int) -> np.ndarray:
    """Return values (T, A) by blocks (B, block, A); the last one is filled up by its last sample."""
    blocks = -(-len(values) // block)
    filled = np.pad(values, ((0, blocks * block - len(values)), (0, 0)), "edge")
    return filled.reshape(blocks, block, values.shape[1])
