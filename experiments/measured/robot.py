"""The robot: the force that its motors need on one surface, and what a model of it leaves on runs across a border.

Three omnidirectional wheels push the robot along a set direction. The force of the motors along it is a weighted sum of
their currents; on a carpet it is three to four times what it is on a table. A model of the force on one surface, by direction
and speed, is identified on runs there. That the floor changes is concealed from it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from experiments.measured.files import Run
from wsp_env.diagnosis.terms import Selection, Term, search

#: The robot as the data's repository states it: wheels at these angles, radii [m], gear, torque per current [N m/A].
WHEELS = np.radians([60.0, 180.0, 300.0])
WHEEL_RADIUS, ROBOT_RADIUS, GEAR, TORQUE_PER_CURRENT = 0.040, 0.125, 16.0, 0.0514
NEWTON_PER_AMPERE = TORQUE_PER_CURRENT * GEAR / WHEEL_RADIUS
#: Length of a row [s], some three samples: a wheel moves 1 to 3 cm.
_ROW_S = 0.1
#: Rows over which the camera's speed is taken for slip [s]: its steps of half a pixel are then 1 % of the slowest speed.
_SLIP_S = 0.5
#: Start that is left out [s]: dead time of 0.15 s and the acceleration after it (assumption: seen in all runs to be over).
_START_S = 0.6
#: Waves of the level over the direction: one and two for unequal wheels, three and six for their place at 120 degrees.
_WAVES = (1, 2, 3, 6)
#: Distance of the lines that are tried [pixel], some 4 cm, a third of the robot's radius.
_GRID = 20.0
_TILTS = (-0.2, -0.1, 0.1, 0.2)


class Blocks(NamedTuple):
    """Rows of one run."""

    name: str
    time: np.ndarray  # (n,) [s]
    force: np.ndarray  # (n,) of the motors along the set direction [N]
    place: np.ndarray  # (n, 2) of the robot in the picture [pixel]
    wheels: np.ndarray  # (n, 3, 2) of the wheels there [pixel]
    angle: np.ndarray  # (n,) of the robot there [rad]
    path: np.ndarray  # (n,) driven so far [cm]
    slip: np.ndarray  # (n,) share of the wheels' motion that the robot does not follow
    direction: float  # set [rad]
    speed: float  # set [m/s]


class Surface(NamedTuple):
    """Model of the force on one surface."""

    name: str
    coefficients: np.ndarray
    row_deviation: float  # of a row about the mean of its run [N]
    run_deviation: float  # of a run's mean about the model [N]
    speeds: tuple[float, ...]  # that it was identified at [m/s]

    def level(self, run: Blocks) -> float:
        """Force [N] on this surface."""
        return float(_design(run, len(self.speeds) > 1) @ self.coefficients)


def scale(runs: Sequence[Run]) -> float:
    """Millimetres per pixel, from the files' own steps in mm against the places in pixels."""
    ratios = []
    for run in runs:
        sine, cosine, (x, y) = np.sin(run.angle), np.cos(run.angle), run.steps.T
        moved = np.array([(-sine * x - cosine * y).sum(), (-cosine * x + sine * y).sum()])
        ratios.append(float(np.hypot(*moved) / np.hypot(*(run.place[-1] - run.place[0]))))
    return float(np.median(ratios))


def blocks(run: Run, mm_per_pixel: float) -> Blocks:
    """Average a run into rows."""
    speed = float(np.hypot(*run.set_speed))
    row = np.floor((run.time - _START_S) / _ROW_S).astype(int)
    kept = row >= 0
    row = np.unique(row[kept], return_inverse=True)[1]
    count = np.bincount(row)

    def mean(x: np.ndarray) -> np.ndarray:
        columns = x[kept].reshape(len(row), -1).T
        return np.stack([np.bincount(row, one) / count for one in columns], axis=-1)

    # Share of a wheel's motion in that of the robot; its current counts as much.
    share = np.abs(run.set_wheels) * WHEEL_RADIUS / GEAR / speed
    time, place, angle = mean(run.time)[:, 0], mean(run.place), mean(run.angle)[:, 0]
    steps = np.hypot(*np.diff(place, axis=0).T) * mm_per_pixel / 10.0
    return Blocks(
        run.name,
        time,
        mean(run.currents) @ share * NEWTON_PER_AMPERE,
        place,
        place[:, None, :] + _wheel_places(angle, mm_per_pixel),
        angle,
        np.concatenate([[0.0], np.cumsum(steps)]),
        _slip(time, place * mm_per_pixel / 1e3, mean(run.wheels)),
        float(np.arctan2(run.set_speed[1], run.set_speed[0])),
        speed,
    )


def _wheel_places(angle: np.ndarray, mm_per_pixel: float) -> np.ndarray:
    """Places (n, 3, 2) of the wheels about the robot's [pixel]; its axes are turned and the picture's y points down."""
    x, y = np.cos(WHEELS), np.sin(WHEELS)
    sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
    result: np.ndarray = np.stack([-sine * x - cosine * y, -cosine * x + sine * y], axis=-1)
    return result * ROBOT_RADIUS * 1e3 / mm_per_pixel


def _slip(time: np.ndarray, place: np.ndarray, motors: np.ndarray) -> np.ndarray:
    """Slip (n,) of the robot: one less its speed over that of wheels that roll."""
    wide = max(round(_SLIP_S / _ROW_S / 2.0), 1)
    after, before = np.minimum(np.arange(len(time)) + wide, len(time) - 1), np.maximum(np.arange(len(time)) - wide, 0)
    moved = np.hypot(*(place[after] - place[before]).T) / (time[after] - time[before])
    to_wheels = np.column_stack([-np.sin(WHEELS), np.cos(WHEELS), np.full(3, ROBOT_RADIUS)]) / WHEEL_RADIUS
    rolled = np.hypot(*np.linalg.solve(to_wheels, motors.T / GEAR)[:2])
    smooth = np.convolve(rolled, np.ones(2 * wide + 1), "same") / np.convolve(np.ones(len(time)), np.ones(2 * wide + 1), "same")
    result: np.ndarray = 1.0 - moved / smooth
    return result


def _design(run: Blocks, by_speed: bool) -> np.ndarray:
    waves = [f(k * run.direction) for k in _WAVES for f in (np.cos, np.sin)]
    # Between 0.1 and 0.3 m/s the force hardly depends on speed: a straight line is enough.
    return np.array([1.0, *waves, *([run.speed] if by_speed else [])])


def identify(name: str, runs: Sequence[Blocks]) -> Surface:
    """Fit the force on one surface over direction and speed."""
    speeds = tuple(sorted({round(one.speed, 2) for one in runs}))
    x = np.array([_design(one, len(speeds) > 1) for one in runs])
    y = np.array([one.force.mean() for one in runs])
    coefficients = np.linalg.lstsq(x, y, rcond=None)[0]
    run_deviation = np.sqrt(((y - x @ coefficients) ** 2).sum() / (len(y) - x.shape[1]))
    row_deviation = np.sqrt(np.mean(np.concatenate([one.force - one.force.mean() for one in runs]) ** 2))
    return Surface(name, coefficients, float(row_deviation), float(run_deviation), speeds)


def beyond(run: Blocks, line: float, axis: int = 0, tilt: float = 0.0) -> np.ndarray:
    """Share (n,) of the wheels beyond a line across one axis of the picture [pixel]."""
    across = run.wheels[:, :, axis] + tilt * run.wheels[:, :, 1 - axis]
    result: np.ndarray = (across > line).mean(axis=1)
    return result


def held_out(runs: Sequence[Blocks]) -> np.ndarray:
    """Return which runs (R,) to hold out: every other, in each direction at every other speed."""
    number = np.arange(len(runs))
    directions = len({round(float(np.degrees(one.direction))) % 360 for one in runs})
    result: np.ndarray = (number + number // directions) % 2 == 1
    return result


class Campaign(NamedTuple):
    """Rows of all runs of a campaign about a model, whitened by the deviation of a row."""

    residual: np.ndarray  # (n,)
    terms: list[Term]
    nuisances: tuple[np.ndarray, np.ndarray]
    run: np.ndarray  # (n,) int
    held_out: np.ndarray  # (n,) bool


def campaign(runs: Sequence[Blocks], model: Surface) -> Campaign:
    """Put the rows of some runs together."""
    unit = model.row_deviation
    number = np.repeat(np.arange(len(runs)), [len(one.time) for one in runs])
    residual = np.concatenate([one.force - model.level(one) for one in runs]) / unit
    # Every run lies off the model by what runs on one surface do; and speeds that the model has not seen are free.
    own = (number[:, None] == np.arange(len(runs))) * (model.run_deviation / unit)
    speed = np.array([one.speed for one in runs])[number]
    unseen = [s for s in sorted({round(one.speed, 2) for one in runs}) if s not in model.speeds]
    free = np.array([np.abs(speed - s) < 0.01 for s in unseen], dtype=float).reshape(-1, len(speed)).T
    prior = np.concatenate([np.ones(len(runs), dtype=bool), np.zeros(len(unseen), dtype=bool)])
    held = held_out(runs)[number]
    return Campaign(residual, candidates(runs, unit), (np.column_stack([own, free]), prior), number, held)


def find(data: Campaign, model: Surface, most: int = 3) -> Selection:
    """Search what a model of one surface leaves.

    An effect matters if it is larger than what runs on one surface differ by.
    """
    interest = model.run_deviation / model.row_deviation
    return search(
        data.residual,
        data.terms,
        data.nuisances,
        data.run,
        data.held_out,
        lambda effect: float(np.sqrt(np.mean(effect**2)) / interest),
        most,
    )


def candidates(runs: Sequence[Blocks], unit: float) -> list[Term]:
    """Return what the force may depend on besides; amplitudes in newtons."""

    def all_runs(f: Callable[[Blocks], np.ndarray]) -> np.ndarray:
        result: np.ndarray = np.concatenate([f(one) for one in runs])[:, None] / unit
        return result

    result = [
        Term("time in the run, per s", all_runs(lambda one: one.time)),
        Term("path driven, per m", all_runs(lambda one: one.path / 100.0)),
        Term("place x, per 1000 pixels", all_runs(lambda one: one.place[:, 0] / 1e3)),
        Term("place y, per 1000 pixels", all_runs(lambda one: one.place[:, 1] / 1e3)),
        Term("turned since the start, per rad", all_runs(lambda one: one.angle - one.angle[0])),
        Term("number of the run, per 36", np.repeat(np.arange(len(runs)) / 36.0, [len(r.time) for r in runs])[:, None] / unit),
        Term("heading, sine", all_runs(lambda one: np.sin(one.angle))),
        Term("heading, cosine", all_runs(lambda one: np.cos(one.angle))),
        Term("speed of turning, per rad/s", all_runs(lambda one: np.gradient(one.angle, one.time))),
    ]
    time, path = (np.concatenate([getattr(one, name) for one in runs])[:, None] for name in ("time", "path"))
    result += [Term(f"after {after:g} s", (time > after) / unit, 1) for after in np.arange(1.0, 18.0)]
    result += [Term(f"after {after:g} cm", (path > after) / unit, 1) for after in np.arange(10.0, 140.0, 10.0)]
    for axis in (0, 1):
        for tilt in (0.0, *(_TILTS if axis == 0 else ())):
            result += _across(runs, unit, axis, tilt)
    return [one for one in result if one.columns.any()]


def _across(runs: Sequence[Blocks], unit: float, axis: int, tilt: float) -> list[Term]:
    """Return steps across lines of one direction, of the share of the wheels and of the robot's centre."""
    wheels, centre = (np.concatenate([getattr(one, name) for one in runs]) for name in ("wheels", "place"))
    across, middle = (x[..., axis] + tilt * x[..., 1 - axis] for x in (wheels, centre))
    what = "xy"[axis] + (f" {tilt:+g} y" if tilt else "")
    result = []
    for line in np.arange(np.ceil(across.min() / _GRID), across.max() / _GRID) * _GRID:
        for name, share in (("wheels", (across > line).mean(axis=1)), ("centre", (middle > line).astype(float))):
            # Beyond and below differ: on one side the model of one surface holds.
            for side, column in (("beyond", share), ("below", 1.0 - share)):
                result.append(Term(f"{name} {side} {what} = {line:.0f}", column[:, None] / unit, 2 if tilt else 1))
    return result
