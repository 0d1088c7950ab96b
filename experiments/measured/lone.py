"""One run alone: does the friction change in it, and where; the border as the slip in the other runs shows it; false alarms.

The border is known from nobody. It is derived from slip, of which the finding takes nothing: where the camera's speed falls
behind that of the wheels. The finding takes the motors' currents and a model from one surface.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.measured.robot import Blocks, Surface, beyond, identify
from wsp_env.diagnosis.gls import Projector

#: Distance of the lines [pixel], some 1 cm.
_FINE = 5.0
#: Parts of the runs on one surface that are left out of the identification in turn.
_FOLDS = 4
#: Share of runs on one surface that may pass for a change.
FALSE = 0.05
#: Share of its square that a line must have left off the level of the run.
_LEFT = 1e-6


class Change(NamedTuple):
    """The change in one run that reduces the sum of squares most."""

    run: str
    reduction: float  # of the sum of squares, rows whitened
    line: float  # across x [pixel]
    side: int  # +1 if the other surface lies beyond the line, -1 if below
    change: float  # of the force with all wheels on the other side [N]


def change(run: Blocks, model: Surface) -> Change:
    """Find the line across x that explains best what a model leaves of one run, its level free within the model's scatter."""
    unit = model.row_deviation
    y = (run.force - model.level(run)) / unit
    level = Projector.of(np.full((len(y), 1), model.run_deviation / unit), np.ones(1, dtype=bool))
    x = run.wheels[:, :, 0]
    lines = np.arange(np.floor(x.min() / _FINE), np.ceil(x.max() / _FINE) + 1.0) * _FINE
    best = Change(run.name, 0.0, float("nan"), 0, 0.0)
    for line in lines:
        share = beyond(run, line)
        for side, column in ((1, share), (-1, 1.0 - share)):
            rest = level.rest(column)
            square, product = float(rest @ column), float(rest @ y)
            if square > _LEFT * len(y) and product**2 / square > best.reduction:
                best = Change(run.name, product**2 / square, float(line), side, product / square * unit)
    return best


def null(name: str, runs: Sequence[Blocks]) -> list[Change]:
    """Find the changes in runs on one surface, each run left out of the identification of its model."""
    fold = np.arange(len(runs)) % _FOLDS
    result = []
    for left_out in range(_FOLDS):
        model = identify(name, [one for one, k in zip(runs, fold, strict=True) if k != left_out])
        result += [change(one, model) for one, k in zip(runs, fold, strict=True) if k == left_out]
    return result


def false_alarms(found: Sequence[Change]) -> int:
    """Count the runs on one surface that pass the level taken from the runs of the other folds."""
    values, fold = np.array([one.reduction for one in found]), np.repeat(np.arange(_FOLDS), len(found) // _FOLDS)
    return int(sum((values[fold == k] > np.quantile(values[fold != k], 1.0 - FALSE)).sum() for k in range(_FOLDS)))


def level_of(found: Sequence[Change]) -> float:
    """Return the reduction that `FALSE` of the runs on one surface pass."""
    return float(np.quantile([one.reduction for one in found], 1.0 - FALSE))


def border(runs: Sequence[Blocks], what: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the line across x [pixel] that parts a quantity (n,) of all runs best, and the share of its variance.

    The quantity is one level with all wheels on one side and another with all on the other.
    """
    y = np.concatenate(what)
    y = y - y.mean()
    x = np.concatenate([one.wheels[:, :, 0] for one in runs])
    best = (float("nan"), 0.0)
    for line in np.arange(np.floor(x.min() / _FINE), np.ceil(x.max() / _FINE)) * _FINE:
        share = (x > line).mean(axis=1)
        share = share - share.mean()
        square = float(share @ share)
        if square > _LEFT * len(y):
            best = max(best, (float(line), float((share @ y) ** 2 / square / (y @ y))), key=lambda one: one[1])
    return best


def crossings(run: Blocks, line: float) -> np.ndarray:
    """Path driven (3,) [cm] when each wheel first crosses a line across x; nan where it does not."""
    side = run.wheels[:, :, 0] > line
    crossed = side != side[0]
    result = np.where(crossed.any(axis=0), run.path[crossed.argmax(axis=0)], np.nan)
    return np.asarray(result)
