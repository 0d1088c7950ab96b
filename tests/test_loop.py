"""Friction that turns the wheel: which directions of the slip are left to a closed loop."""

import numpy as np
from numpy.testing import assert_allclose

from wsp_env.diagnosis.loop import stretches, turns
from wsp_env.diagnosis.stops import BLOCK_S


class Rows:
    """The rows of one wheel in one run."""

    def __init__(self, slip: np.ndarray, slides: np.ndarray | None = None) -> None:
        n = len(slip)
        self.wheels, self.run, self.axle = np.ones(n, dtype=bool), np.zeros(n, dtype=int), np.zeros(n, dtype=int)
        self.slides, self.time, self.slip = self.wheels if slides is None else slides, BLOCK_S * np.arange(n), slip

    def __len__(self) -> int:
        return len(self.slip)


def test_a_steady_slip_turns_nothing_and_a_gap_parts_slides():
    slides = np.ones(40, dtype=bool)
    slides[15:17] = False
    rows = Rows(np.full(40, 1.5), slides)
    assert [len(part) for part in stretches(rows)] == [15, 23]
    assert_allclose(turns(rows), 0.0, atol=1e-12)


def test_what_is_slower_than_a_loop_keeps_its_trace():
    """A slip that rises by 1 m/s in 10 s: the directions hold a step of the slope, not the level."""
    rising = np.linspace(0.5, 4.0, 220)
    columns = turns(Rows(rising))
    level = rising - rising.mean()
    left = level - columns @ np.linalg.lstsq(columns, level, rcond=None)[0]
    assert left @ left > 0.9 * (level @ level)  # the ends are short of rows before or after
