"""Friction that turns the wheel: in a closed loop what friction does by itself and the slip go together.

A sliding wheel hardly holds itself: where the load bounces or the rail is better for a moment, the wheel speeds up, and the
anti-slide device answers. So high friction and small slip go together without any law that says so (the bias of simultaneous
equations, Haavelmo, Econometrica 11, 1943). It is over within half a second: how a wheel's slip differs from its own mean over
a second says nothing of the law, and those directions are free.
"""

import numpy as np

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.stops import BLOCK_S

#: Time before and after within which a loop answers [s]: what a device's valves and a wheel take (assumption).
_ANSWER_S = 0.5
_ROWS = round(_ANSWER_S / BLOCK_S)


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


def turns(rows: Rows) -> np.ndarray:
    """Return the slips (n, m) [m/s] of the rows before and after each row of a slide, less their mean; 0 elsewhere."""
    window = 2 * _ROWS + 1
    found = np.zeros((len(rows), window - 1))  # their sum is 0: one is left out
    for part in stretches(rows):
        if len(part) >= window:
            around = np.lib.stride_tricks.sliding_window_view(np.pad(rows.slip[part], _ROWS, "edge"), window)
            found[part] = (around - around.mean(axis=1, keepdims=True))[:, :-1]
    return found
