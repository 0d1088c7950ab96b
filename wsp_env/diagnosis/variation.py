"""What sound vehicles, tracks and models vary by: the law's free parameters and the discrepancies beside it.

Every group of columns has a size that is expected of sound recordings (`_EXPECTED`). What differs between runs, places and
times is only begun with: how large it is the recordings at hand say themselves, by their disagreement
(`wsp_env.diagnosis.covariance`). What is common to all runs stays at the expected size: no disagreement tells it.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import ACTUATOR, Balances, Rows, Whitening
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.forces import Forces
from wsp_env.diagnosis.replica import Replica

#: Lengths over which mu_cd is alike along the track [m]. The short one is, of those tried, the likeliest on a campaign of 2 %
#: over 5 to 20 m; how large it is the recordings say, as a wheel passes many such lengths. The long one is that of rails of
#: different history; what is as long as that and large is a finding, so its size is the expected one (assumption). Leaves and
#: water also lie differently in each run, where all its wheels pass; a wheel passes 10 m in two to six rows (6 m: the same).
_SHORT_M, _LONG_M, _RUN_M = 3.0, 30.0, 10.0
_APART = 8.0  # lengths beyond which places are not alike at all: exp(-32)
_COURSE_NODE_S = 4.0  # of what varies in time
_ONSET_NODE_S, _ONSET_NODES = 0.4, 4  # of a torque from its brake's first application on: how it comes about is in no model
_SHAPE_NODES = 6  # of what varies over slip, speed or work, at quantiles
MU_CD = 0.15  # [-] of a run's, about the believed one: assumption
LOG_TAU = 1.0  # [-] about where the search starts: says next to nothing
_FREE = 1e3  # deviation of a free column, in its own unit of whitened rows of length 1
_UNIFORM = 1.0 / np.sqrt(3.0)
WHEEL_TIME, TORQUE_TIME, ONSET = "time of a wheel speed", "time of a torque", "torque as a brake is applied"

#: Deviation expected of sound vehicles and tracks [-]: assumptions, from tolerances of brakes, wheels and test tracks.
_EXPECTED = {
    "gain": 0.01 * _UNIFORM,  # of an axle's torque, where it comes from the cylinder pressure
    "measured gain": 0.001,  # of a torque that is itself measured
    "spring": 0.05,  # of what a brake's return spring, and a pressure's zero, take off, over the largest torque
    "zero": 0.001 * _UNIFORM,  # of a torque over the largest: sensors are set to zero before a test
    "inertia": 0.03,  # of a wheelset: wheels wear
    "radius": 0.0005 * _UNIFORM,  # of an axle's wheels
    "turn": 0.001 * _UNIFORM,  # of a wheel speed, once a turn: a pulse wheel a tenth of a millimetre off its centre
    "stiffness": 0.03 * _UNIFORM,  # of the creep curve
    "track": 0.02 * _UNIFORM,  # of mu_cd along the track
    "friction": 0.008,  # of an axle's friction: from run to run, in time
    "law": 0.002,  # of friction over slip, speed and work: the law's own form
    "torque": 0.003 * _UNIFORM,  # of a brake's torque in time
    "onset": 0.003,  # of a brake's torque, over the largest, as it is first applied: pads come to bear, a rigging gives
    "force": 0.0005,  # of the vehicle in time, over its weight
}


class Group(NamedTuple):
    """Columns that share one size."""

    name: str
    columns: np.ndarray  # (n, p) change of the residuals by a deviation of 1
    expected: float  # deviation; inf: free
    fixed: bool = False  # whether the size is known and not estimated
    mean_of: str = ""  # the group of the same thing's differences between runs: their mean adds to what is common


def whitened(
    groups: Sequence[Group], whitening: Whitening, noise: np.ndarray | None = None, sizes: np.ndarray | None = None
) -> np.ndarray:  # fmt: skip
    """Return the columns (n, p) of all groups, whitened and scaled by their deviations; a free one by as good as infinite.

    Parameters
    ----------
    noise : (n,) factor of each row's deviation; None: 1
    sizes : (G,) of the groups over the expected; None: 1

    """
    white = whitening(np.column_stack([group.columns for group in groups]))
    if noise is not None:
        white /= noise[:, None]
    scales, first = [np.zeros(0)], 0
    for i, group in enumerate(groups):
        mine = white[:, first : first + group.columns.shape[1]]
        first += mine.shape[1]
        size = group.expected * (1.0 if sizes is None else float(sizes[i]))
        free = np.isinf(group.expected)
        scales.append(_FREE / np.maximum(np.linalg.norm(mine, axis=0), 1e-12) if free else np.full(mine.shape[1], size))
    white *= np.concatenate(scales)
    return white


def law_columns(balances: Balances | Replica, model: Model, base: np.ndarray) -> np.ndarray:
    """Columns (n, 1 + runs): derivative of the residuals by log tau, and by log mu_cd of each run."""
    step = 1e-3
    tau = (balances.raw(dataclasses.replace(model, tau=model.tau * np.exp(step))) - base) / step
    moved = dataclasses.replace(model, mu_cd=tuple(mu * float(np.exp(step)) for mu in model.mu_cd))
    friction = (balances.raw(moved) - base) / step
    runs = balances.rows.run[:, None] == np.arange(len(balances.stops))
    return np.column_stack([tau, friction[:, None] * runs])


def segment_columns(balances: Balances | Replica) -> np.ndarray:
    """Columns (n, segments): 1 in the rows of a stretch, whose speed has an offset of its own."""
    segment = balances.rows.segment
    result: np.ndarray = (segment[:, None] == np.arange(segment.max(initial=-1) + 1)).astype(float)
    return result


class Net:
    """Takes from columns what the law's parameters do as well.

    Parameters
    ----------
    law : (n, l) columns of what is free, of tau and of mu_cd

    """

    def __init__(self, whitening: Whitening, law: np.ndarray) -> None:
        self._whitening, self._law = whitening, law
        white = whitening(law)
        self._scale = np.maximum(np.linalg.norm(white, axis=0), 1e-12)
        self._inverse = np.linalg.pinv(white / self._scale, rcond=1e-6)

    def __call__(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left of columns (n, k), and the parameters' amplitudes (l, k) that do the rest."""
        amplitudes = (self._inverse @ self._whitening(columns)) / self._scale[:, None]
        return columns - self._law @ amplitudes, amplitudes


def nuisances(balances: Balances | Replica, model: Model, base: np.ndarray, whitening: Whitening) -> tuple[Group, ...]:
    """Return all nuisances of a model whose residuals are `base` (n,)."""
    rows, axles = balances.rows, balances.axles
    law = law_columns(balances, model, base)
    friction: np.ndarray = law[:, 1:].sum(axis=1)
    by_run = (rows.run[:, None] == np.arange(len(balances.stops))).astype(float)
    own = (rows.axle[:, None] == np.arange(axles)).astype(float)
    forces = Forces(balances, model)
    # Times are seen by the recorded torques, and by wheels as they slide, whatever sensors show.
    timed = Forces(balances.timed, balances.physical(model)) if isinstance(balances, Replica) else forces
    steepness, radius, uncertain = _slips(balances, model)
    turning = forces.turning()
    slides = (friction * rows.slides)[:, None]

    between = by_run @ contrasts(by_run.shape[1])

    def each(columns: np.ndarray) -> np.ndarray:
        """Return what differs between runs; what is common to them is a column of its own."""
        return np.column_stack([np.zeros((len(rows), 0)), *(columns[:, [k]] * between for k in range(columns.shape[1]))])

    segments = segment_columns(balances)
    clock = _hats(rows.time, _COURSE_NODE_S)
    shapes = [_interpolation(values, slides[:, 0] != 0.0) for values in (rows.slip, rows.speed, rows.work)]
    apart = contrasts(axles)  # of axles from each other: what is common to them is the law's, or a finding
    differs = own @ apart
    lines = [_line(values, slides[:, 0] != 0.0) for values in (rows.slip, rows.speed, rows.work)]
    gain = _EXPECTED["measured gain" if balances.campaign.vehicle.torque_is_measured else "gain"]
    sample = balances.sample_s * _UNIFORM  # in which channels are read: within one of each other
    groups = [
        Group("offset", segments, np.inf, True),
        Group("tau", law[:, :1], LOG_TAU, True),
        Group("mu_cd", law[:, 1:], MU_CD, True),
        Group("speed", uncertain, 1.0, True),
        Group("gain", forces.gain, gain, True, "gain of a run"),
        Group("gain of a run", each(forces.gain), gain),
        Group("zero of the torque", forces.zeros(), _EXPECTED["zero"], True),
        Group("torque in time", forces.courses(_COURSE_NODE_S), _EXPECTED["torque"]),
        Group(ONSET, forces.onsets(_ONSET_NODE_S, _ONSET_NODES), _EXPECTED["onset"]),
        Group(WHEEL_TIME, timed.late_wheels() @ apart, sample, True),
        Group("once a turn of a wheel sensor", timed.unround_wheels(), _EXPECTED["turn"]),
        Group(TORQUE_TIME, timed.late_torques() @ apart, sample, True),
        Group("inertia", np.column_stack([turning, turning.sum(axis=1)]), _EXPECTED["inertia"], True),
        Group("radius", radius[:, None] * own, _EXPECTED["radius"], True, "radius of a run"),
        Group("radius of a run", each(radius[:, None] * own), _EXPECTED["radius"]),
        Group("stiffness", np.column_stack([steepness[:, None] * own, steepness]), _EXPECTED["stiffness"], True,
              "stiffness of a run"),
        Group("stiffness of a run", each(steepness[:, None] * own), _EXPECTED["stiffness"]),
        Group("track", friction[:, None] * _track(rows.place, rows.wheels, _SHORT_M), _EXPECTED["track"]),
        Group("track of a run", _track_of_runs(friction, rows), _EXPECTED["friction"]),
        Group("track over long", friction[:, None] * _track(rows.place, rows.wheels, _LONG_M), _EXPECTED["track"], True),
        Group("friction of an axle", friction[:, None] * own, _EXPECTED["friction"], True, "friction of an axle in a run"),
        Group("form of an axle's friction", np.column_stack([slides * differs * line[:, None] for line in lines]),
              0.5 * _EXPECTED["friction"], True),
        Group("friction of an axle in a run", each(friction[:, None] * own), _EXPECTED["friction"]),
        Group("friction in time", _in_time(slides, by_run, own, clock), _EXPECTED["friction"]),
        # Net: what tau and mu_cd do is no discrepancy of the law.
        Group("law", Net(whitening, np.column_stack([segments, law]))(np.column_stack([slides * s for s in shapes]))[0],
              _EXPECTED["law"], True),
        Group("force in time", forces.on_vehicle(_COURSE_NODE_S), _EXPECTED["force"]),
    ]  # fmt: skip
    if (rows.balance == ACTUATOR).any():
        brake = forces.nominal[:, None]
        groups += [
            Group("nominal gain of the brakes", brake, np.inf, True),
            Group("return springs of the brakes", forces.springs, _EXPECTED["spring"], True),
            Group("gain of a brake", brake * own, _EXPECTED["gain"], True, "gain of a brake in a run"),
            Group("gain of a brake in a run", each(brake * own), _EXPECTED["gain"]),
        ]
    return tuple(_present(group) for group in groups)


def shapes(balances: Balances | Replica) -> np.ndarray:
    """Weights (n, k) over slip, speed and friction work, and of every axle and run."""
    rows = balances.rows
    vehicle = (rows.axle < 0)[:, None]
    over = [_interpolation(values, rows.slides) * ~vehicle for values in (rows.slip, rows.work)]
    own = (rows.axle[:, None] == np.arange(balances.axles)).astype(float)
    by_run = (rows.run[:, None] == np.arange(len(balances.stops))).astype(float)
    return np.column_stack([*over, _interpolation(rows.speed, rows.speed > 0.0), own, by_run])


def contrasts(several: int) -> np.ndarray:
    """Return an orthonormal basis (m, m - 1) of what sums to zero over several runs or axles."""
    return np.linalg.svd(np.eye(several) - 1.0 / several)[0][:, : several - 1]


def _in_time(column: np.ndarray, by_run: np.ndarray, own: np.ndarray, clock: np.ndarray) -> np.ndarray:
    return np.column_stack([column * run[:, None] * axle[:, None] * clock for run in by_run.T for axle in own.T])


def _present(group: Group) -> Group:
    """Leave out columns that touch no row."""
    touches = group.columns.any(axis=0)
    return group if touches.all() else group._replace(columns=group.columns[:, touches])


def _slips(balances: Balances | Replica, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the change of the residuals by stiffness (n,), by a wheel's radius (n,) and by the speed's directions (n, m)."""
    steepness, radius, uncertain = [], [], []
    sizes = [stop.uncertain.shape[1] for stop in balances.stops]
    for i, (part, one) in enumerate(zip(balances.parts, balances.evaluate(model), strict=True)):
        # A stiffer contact acts as more slip: df/dlog k is about s df/ds (exact at small creepage, where alone it counts).
        steepness.append(-part.joined(part.wheel_rows(one.slope * one.slip)))
        # A larger radius: less slip, so less adhesion expected of the law.
        radius.append(part.joined(part.wheel_rows(one.slope * balances.radius * part.stop.wheel)))
        mine = [part.joined(-part.wheel_rows(one.slope * mode[:, None])) for mode in balances.stops[i].uncertain.T]
        wide = np.zeros((len(steepness[-1]), sum(sizes)))
        if mine:
            wide[:, sum(sizes[:i]) : sum(sizes[: i + 1])] = np.column_stack(mine)
        uncertain.append(wide)
    return np.concatenate(steepness), np.concatenate(radius), np.vstack(uncertain)


def _track_of_runs(friction: np.ndarray, rows: Rows) -> np.ndarray:
    """Change of the residuals (n, m) by friction along the track in one run, where all wheels pass and other runs do not."""
    return np.column_stack(
        [friction[:, None] * _track(rows.place, rows.wheels & (rows.run == run), _RUN_M) for run in range(rows.run.max() + 1)]
    )


def _track(place: np.ndarray, used: np.ndarray, length_m: float) -> np.ndarray:
    """Weights (n, m) of the directions in which friction varies along the track, alike over a length."""
    return _kept_track(place.tobytes(), used.tobytes(), length_m)


@functools.lru_cache(maxsize=64)  # every replica of a campaign has the same places
def _kept_track(place: bytes, used: bytes, length_m: float) -> np.ndarray:
    places, inside = np.frombuffer(place), np.frombuffer(used, dtype=bool)
    order = np.flatnonzero(inside)[np.argsort(places[inside])]
    # Stretches far from each other (runs of unknown places, say) have nothing to do with each other.
    stretches = np.split(order, np.flatnonzero(np.diff(places[order]) > _APART * length_m) + 1)
    found = [_of_stretch(places, one, length_m) for one in stretches if len(one)]
    return np.column_stack([np.zeros((len(places), 0)), *found])


def _of_stretch(place: np.ndarray, used: np.ndarray, length_m: float) -> np.ndarray:
    """Weights (n, m) of the rows (k,) that a stretch uses; 0 for the others."""
    hats = _hats(place[used], 0.5 * length_m)
    node = np.arange(hats.shape[1])
    values, vectors = np.linalg.eigh(np.exp(-0.5 * (0.5 * np.subtract.outer(node, node)) ** 2))
    kept = values > 0.01 * values.max(initial=0.0)
    result = np.zeros((len(place), int(kept.sum())))
    result[used] = hats @ (vectors[:, kept] * np.sqrt(values[kept]))
    return result


def _hats(values: np.ndarray, apart: float) -> np.ndarray:
    """Linear interpolation (n, nodes) between nodes `apart`."""
    x = (values - values.min()) / apart
    nodes = int(x.max()) + 2
    weights: np.ndarray = np.clip(1.0 - np.abs(x[:, None] - np.arange(nodes)), 0.0, None)
    return weights


def _line(values: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Straight line (n,) over the used values, of mean 0 and deviation 1 there."""
    if not used.any():
        return np.zeros(len(values))
    result: np.ndarray = (values - values[used].mean()) / max(float(values[used].std()), 1e-12)
    return result


def _interpolation(values: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Linear interpolation (n, nodes) between quantiles of the used values."""
    if not used.any():
        return np.zeros((len(values), 0))
    nodes = np.unique(np.quantile(values[used], np.linspace(0.0, 1.0, _SHAPE_NODES)))
    return np.column_stack([np.interp(values, nodes, unit) for unit in np.eye(len(nodes))])
