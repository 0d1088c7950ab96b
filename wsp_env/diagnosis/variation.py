"""Normal variation of sound vehicles, tracks and models: the law's free parameters and the discrepancies beside it.

Each group of columns has a size that is expected of sound recordings (`_EXPECTED`). For differences between runs, places and
times, this size is only a starting value: the scatter of the recordings determines the size (`wsp_env.diagnosis.covariance`).
For what is common to all runs, the expected size is kept, because no scatter shows it.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.arrow import ByRun, rows_of
from wsp_env.diagnosis.balances import ACTUATOR, Balances, Rows, Whitening
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.forces import Forces
from wsp_env.diagnosis.interest import PUSH
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.stops import gain_is_stated
from wsp_env.diagnosis.zeros import usual_zero

#: Correlation lengths of mu_cd along the track [m]. Short: the likeliest of the tried lengths, on a campaign with 2 % variation
#: over 5 to 20 m; its size is estimated, because a wheel passes many such lengths. Long: rails of different history; a large
#: change over this length is a finding, so its size is fixed (assumption). Of one run: leaves and water lie differently in each
#: run, for all its wheels; a wheel passes 10 m in two to six rows (6 m gives the same results).
_SHORT_M, _LONG_M, _RUN_M = 3.0, 30.0, 10.0
_APART = 8.0  # distance in lengths beyond which places are uncorrelated: exp(-32)
_COURSE_NODE_S = 4.0  # distance of the nodes of variation in time
_ONSET_NODE_S, _ONSET_NODES = 0.4, 4  # nodes after a brake's first application, whose course no model describes
_SHAPE_NODES = 6  # nodes of variation over slip, speed or work, at quantiles
MU_CD = 0.15  # [-] prior deviation of a run's log mu_cd about the believed one: assumption
LOG_TAU = 1.0  # [-] prior deviation of log tau about the start value: carries almost no information
_FREE = 1e3  # standard deviation of a free column, after scaling its whitened rows to length 1
_UNIFORM = 1.0 / np.sqrt(3.0)
WHEEL_TIME, TORQUE_TIME, ONSET = "time of a wheel speed", "time of a torque", "torque as a brake is applied"
FORCE = "force in time"

#: Standard deviations expected of sound vehicles and tracks [-]: assumptions, from tolerances of brakes, wheels and test
#: tracks.
_EXPECTED = {
    "gain": 0.01 * _UNIFORM,  # of an axle's torque, if computed from the cylinder pressure
    "measured gain": 0.001,  # of a measured torque
    "nominal gain": 0.1,  # of all brakes together, if the nominal one is stated: batches of pads differ
    "spring": 0.05,  # effect of a brake's return spring, and zero error of a pressure, over the largest torque
    "zero": 0.001 * _UNIFORM,  # offset of a torque over the largest: sensors are zeroed before a test; or what they read then
    "inertia": 0.03,  # of a wheelset: wheels wear
    "radius": 0.0005 * _UNIFORM,  # of an axle's wheels
    "turn": 0.001 * _UNIFORM,  # of a wheel speed, once per turn: a pulse wheel a tenth of a millimetre off its centre
    "stiffness": 0.03 * _UNIFORM,  # of the creep curve
    "track": 0.02 * _UNIFORM,  # of mu_cd along the track
    "friction": 0.008,  # of an axle's friction: from run to run, and in time
    "recovery": 0.025 * _UNIFORM,  # of tau from axle to axle: treads and their contacts clean differently
    "law": 0.002,  # of friction over slip, speed and work: form of the law
    "torque": 0.003 * _UNIFORM,  # of a brake's torque in time
    "onset": 0.003,  # of a brake's torque at its first application, over the largest: pads make contact, rigging yields
    "force": 0.0005,  # on the vehicle in time, over its weight
}


class Group(NamedTuple):
    """Columns with a common size."""

    name: str
    columns: np.ndarray  # (n, p) change of the residuals per unit of the amplitude
    expected: float  # standard deviation; inf: free
    fixed: bool = False  # whether the size is known and not estimated
    mean_of: str = ""  # group of this quantity's differences between runs; their mean adds to the common value
    most: float = np.inf  # largest size, over the expected one: more would matter in a stop


def whitened(
    groups: Sequence[Group], whitening: Whitening, run: np.ndarray, noise: np.ndarray | None = None,
    sizes: np.ndarray | None = None,
) -> ByRun:  # fmt: skip
    """Return the columns (n, p) of all groups, whitened and scaled by their standard deviations; `_FREE` for free ones.

    Parameters
    ----------
    run : (n,) the run of each row
    noise : (n,) factor on each row's standard deviation; None: 1
    sizes : (G,) of the groups over the expected sizes; None: 1

    """
    counts = [group.columns.shape[1] for group in groups]
    runs = rows_of(run)

    def of_run(rows: slice | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = [group.columns[rows] for group in groups]
        touched = [part.any(axis=0) for part in parts]
        raw = np.column_stack([part[:, mine] for part, mine in zip(parts, touched, strict=True)])
        white = whitening.of(rows)(raw)
        return np.flatnonzero(np.concatenate(touched)), white if noise is None else white / noise[rows, None]

    used, blocks = zip(*side_by_side(of_run, runs), strict=True)
    every = ByRun(sum(counts), tuple(runs), used, blocks)
    scales = np.repeat([group.expected for group in groups], counts)
    free = np.isinf(scales)
    if free.any():
        scales[free] = _FREE / np.maximum(np.sqrt(every.squares()[free]), 1e-12)
    if sizes is not None:
        scales *= np.where(free, 1.0, np.repeat(sizes, counts))
    return every.scaled(scales)


def law_columns(balances: Balances | Replica, model: Model, base: np.ndarray) -> np.ndarray:
    """Columns (n, 1 + runs): derivative of the residuals by log tau, and by log mu_cd of each run."""
    step = 1e-3
    tau = (balances.raw(dataclasses.replace(model, tau=model.tau * np.exp(step)), model) - base) / step
    moved = dataclasses.replace(model, mu_cd=tuple(mu * float(np.exp(step)) for mu in model.mu_cd))
    friction = (balances.raw(moved, model) - base) / step
    runs = balances.rows.run[:, None] == np.arange(len(balances.stops))
    return np.column_stack([tau, friction[:, None] * runs])


def segment_columns(balances: Balances | Replica) -> np.ndarray:
    """Columns (n, segments): 1 in the rows of a stretch, because the initial speed of each stretch is free."""
    segment = balances.rows.segment
    result: np.ndarray = (segment[:, None] == np.arange(segment.max(initial=-1) + 1)).astype(float)
    return result


class Net:
    """Projects columns off the free parameters: offsets, tau and mu_cd.

    Parameters
    ----------
    law : (n, l) columns of these parameters

    """

    def __init__(self, whitening: Whitening, law: np.ndarray) -> None:
        self._whitening, self._law = whitening, law
        white = whitening(law)
        self._scale = np.maximum(np.linalg.norm(white, axis=0), 1e-12)
        self._inverse = np.linalg.pinv(white / self._scale, rcond=1e-6)

    def __call__(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the projected columns (n, k), and the parameters' amplitudes (l, k) in the removed part."""
        amplitudes = (self._inverse @ self._whitening(columns)) / self._scale[:, None]
        return columns - self._law @ amplitudes, amplitudes


def nuisances(balances: Balances | Replica, model: Model, base: np.ndarray, whitening: Whitening) -> tuple[Group, ...]:
    """Return all nuisances of a model with residuals `base` (n,)."""
    rows, axles = balances.rows, balances.axles
    law = law_columns(balances, model, base)
    friction: np.ndarray = law[:, 1:].sum(axis=1)
    by_run = (rows.run[:, None] == np.arange(len(balances.stops))).astype(float)
    own = (rows.axle[:, None] == np.arange(axles)).astype(float)
    forces = Forces(balances, model)
    # Channel times are evaluated with the recorded torques and the true slips, whatever the sensors show.
    timed = Forces(balances.timed, balances.physical(model)) if isinstance(balances, Replica) else forces
    steepness, radius, uncertain = _slips(balances, model)
    turning = forces.turning()
    slides = (friction * rows.slides)[:, None]

    between = by_run @ contrasts(by_run.shape[1])

    def each(columns: np.ndarray) -> np.ndarray:
        """Return the differences of columns between runs; the common part has a column of its own."""
        return np.column_stack([np.zeros((len(rows), 0)), *(columns[:, [k]] * between for k in range(columns.shape[1]))])

    segments = segment_columns(balances)
    clock = _hats(rows.time, _COURSE_NODE_S)
    shapes = [_interpolation(values, slides[:, 0] != 0.0) for values in (rows.slip, rows.speed, rows.work)]
    apart = contrasts(axles)  # differences between axles; their common part belongs to the law or is a finding
    differs = own @ apart
    lines = [_line(values, slides[:, 0] != 0.0) for values in (rows.slip, rows.speed, rows.work)]
    gain = _EXPECTED["measured gain" if balances.campaign.vehicle.torque_is_measured else "gain"]
    sample = balances.sample_s * _UNIFORM  # channels are read within a sample of each other
    # The contacts' common stiffness grows with their area, which may belong to another load.
    load = balances.vehicle.gravity_mps2 * float(np.mean([stop.mass for stop in balances.stops])) / (2.0 * axles)
    wider = np.hypot(1.0, balances.campaign.contact.ellipse_uncertainty(load) / _EXPECTED["stiffness"])
    groups = [
        Group("offset", segments, np.inf, True),
        Group("tau", law[:, :1], LOG_TAU, True),
        Group("mu_cd", law[:, 1:], MU_CD, True),
        Group("speed", uncertain, 1.0, True),
        Group("gain", forces.gain, gain, True, "gain of a run"),
        Group("gain of a run", each(forces.gain), gain),
        Group("zero of the torque", forces.zeros(), max(_EXPECTED["zero"], usual_zero(balances.campaign)), True),
        Group("torque in time", forces.courses(_COURSE_NODE_S), _EXPECTED["torque"], most=_most_torque(axles)),
        Group(ONSET, forces.onsets(_ONSET_NODE_S, _ONSET_NODES), _EXPECTED["onset"]),
        Group(WHEEL_TIME, timed.late_wheels() @ apart, sample, True),
        Group("once a turn of a wheel sensor", timed.unround_wheels(), _EXPECTED["turn"]),
        Group(TORQUE_TIME, timed.late_torques() @ apart, sample, True),
        Group("inertia", np.column_stack([turning, turning.sum(axis=1)]), _EXPECTED["inertia"], True),
        Group("radius", radius[:, None] * own, _EXPECTED["radius"], True, "radius of a run"),
        Group("radius of a run", each(radius[:, None] * own), _EXPECTED["radius"]),
        Group("stiffness", np.column_stack([steepness[:, None] * own, wider * steepness]), _EXPECTED["stiffness"], True,
              "stiffness of a run"),
        Group("stiffness of a run", each(steepness[:, None] * own), _EXPECTED["stiffness"]),
        Group("track", friction[:, None] * _track(rows.place, rows.wheels, _SHORT_M), _EXPECTED["track"]),
        Group("track of a run", _track_of_runs(friction, rows), _EXPECTED["friction"]),
        Group("track over long", friction[:, None] * _track(rows.place, rows.wheels, _LONG_M), _EXPECTED["track"], True),
        Group("friction of an axle", friction[:, None] * own, _EXPECTED["friction"], True, "friction of an axle in a run"),
        Group("recovery of an axle", law[:, :1] * differs, _EXPECTED["recovery"], True),
        Group("form of an axle's friction", np.column_stack([slides * differs * line[:, None] for line in lines]),
              0.5 * _EXPECTED["friction"], True),
        Group("friction of an axle in a run", each(friction[:, None] * own), _EXPECTED["friction"]),
        Group("friction in time", _in_time(slides, by_run, own, clock), _EXPECTED["friction"]),
        # Net: tau and mu_cd are no discrepancy of the law.
        Group("law", Net(whitening, np.column_stack([segments, law]))(np.column_stack([slides * s for s in shapes]))[0],
              _EXPECTED["law"], True),
        Group(FORCE, forces.on_vehicle(_COURSE_NODE_S), _EXPECTED["force"], most=_most_force(balances)),
    ]  # fmt: skip
    if (rows.balance == ACTUATOR).any():
        brake = forces.nominal[:, None]
        nominal = _EXPECTED["nominal gain"] if gain_is_stated(balances.campaign) else np.inf
        groups += [
            Group("nominal gain of the brakes", brake, nominal, True),
            Group("return springs of the brakes", forces.springs, _EXPECTED["spring"], True),
            Group("gain of a brake", brake * own, _EXPECTED["gain"], True, "gain of a brake in a run"),
            Group("gain of a brake in a run", each(brake * own), _EXPECTED["gain"]),
        ]
    return tuple(_present(group) for group in groups)


def shapes(balances: Balances | Replica) -> np.ndarray:
    """Weights (n, k) of form errors: over slip, friction work, speed and time, and for each axle and run."""
    rows = balances.rows
    vehicle = (rows.axle < 0)[:, None]
    over = [_interpolation(values, rows.slides) * ~vehicle for values in (rows.slip, rows.work)]
    own = (rows.axle[:, None] == np.arange(balances.axles)).astype(float)
    by_run = (rows.run[:, None] == np.arange(len(balances.stops))).astype(float)
    over += [_interpolation(values, rows.speed > 0.0) for values in (rows.speed, rows.time)]
    return np.column_stack([*over, own, by_run])


def contrasts(several: int) -> np.ndarray:
    """Return an orthonormal basis (m, m - 1) of the vectors over m runs or axles that sum to zero."""
    return np.linalg.svd(np.eye(several) - 1.0 / several)[0][:, : several - 1]


def _most_force(balances: Balances | Replica) -> float:
    """Return the largest size of forces in time, over the expected one: together, what moves a stop by 1 %."""
    deceleration = float(np.mean(balances.rows.deceleration))
    return max(PUSH * deceleration / (balances.vehicle.gravity_mps2 * _EXPECTED["force"]), 1.0)


def _most_torque(axles: int) -> float:
    """Return the largest size of torques in time, over the expected one: of all axles together, what moves a stop by 1 %.

    Brakes that wander by more are a finding. Without the bound they take up friction that fluctuates, and hide from the
    vehicle's balance what contradicts it.
    """
    return PUSH * float(np.sqrt(axles)) / _EXPECTED["torque"]


def _in_time(column: np.ndarray, by_run: np.ndarray, own: np.ndarray, clock: np.ndarray) -> np.ndarray:
    return np.column_stack([column * run[:, None] * axle[:, None] * clock for run in by_run.T for axle in own.T])


def _present(group: Group) -> Group:
    """Remove columns without any nonzero row."""
    touches = group.columns.any(axis=0)
    return group if touches.all() else group._replace(columns=group.columns[:, touches])


def _slips(balances: Balances | Replica, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the change of the residuals by stiffness (n,), by a wheel's radius (n,) and by the speed's uncertainty (n, m)."""
    steepness, radius, uncertain = [], [], []
    sizes = [stop.uncertain.shape[1] for stop in balances.stops]
    for i, (part, one) in enumerate(zip(balances.parts, balances.evaluate(model), strict=True)):
        # A stiffer contact acts like more slip: df/dlog k is about s df/ds (exact at small creepage, where the stiffness
        # matters).
        steepness.append(-part.joined(part.wheel_rows(one.stiffness * one.slip)))
        # With a larger radius the slip is smaller, so the law predicts less adhesion.
        radius.append(part.joined(part.wheel_rows(one.stiffness * balances.radius * part.stop.wheel)))
        mine = [part.joined(-part.wheel_rows(one.stiffness * mode[:, None])) for mode in balances.stops[i].uncertain.T]
        wide = np.zeros((len(steepness[-1]), sum(sizes)))
        if mine:
            wide[:, sum(sizes[:i]) : sum(sizes[: i + 1])] = np.column_stack(mine)
        uncertain.append(wide)
    return np.concatenate(steepness), np.concatenate(radius), np.vstack(uncertain)


def _track_of_runs(friction: np.ndarray, rows: Rows) -> np.ndarray:
    """Change of the residuals (n, m) by friction along the track that varies in one run only, alike for all its wheels."""
    return np.column_stack(
        [friction[:, None] * _track(rows.place, rows.wheels & (rows.run == run), _RUN_M) for run in range(rows.run.max() + 1)]
    )


def _track(place: np.ndarray, used: np.ndarray, length_m: float) -> np.ndarray:
    """Weights (n, m) of the independent directions in which friction varies along the track, with a correlation length."""
    return _kept_track(place.tobytes(), used.tobytes(), length_m)


@functools.lru_cache(maxsize=64)  # all replicas of a campaign have the same places
def _kept_track(place: bytes, used: bytes, length_m: float) -> np.ndarray:
    places, inside = np.frombuffer(place), np.frombuffer(used, dtype=bool)
    order = np.flatnonzero(inside)[np.argsort(places[inside])]
    # Distant stretches (as runs with unknown places) are uncorrelated.
    stretches = np.split(order, np.flatnonzero(np.diff(places[order]) > _APART * length_m) + 1)
    found = [_of_stretch(places, one, length_m) for one in stretches if len(one)]
    return np.column_stack([np.zeros((len(places), 0)), *found])


def _of_stretch(place: np.ndarray, used: np.ndarray, length_m: float) -> np.ndarray:
    """Weights (n, m) in the rows (k,) of a stretch; 0 in the others."""
    hats = _hats(place[used], 0.5 * length_m)
    node = np.arange(hats.shape[1])
    values, vectors = np.linalg.eigh(np.exp(-0.5 * (0.5 * np.subtract.outer(node, node)) ** 2))
    kept = values > 0.01 * values.max(initial=0.0)
    result = np.zeros((len(place), int(kept.sum())))
    result[used] = hats @ (vectors[:, kept] * np.sqrt(values[kept]))
    return result


def _hats(values: np.ndarray, apart: float) -> np.ndarray:
    """Linear interpolation weights (n, nodes) between nodes at distance `apart`."""
    x = (values - values.min()) / apart
    nodes = int(x.max()) + 2
    weights: np.ndarray = np.clip(1.0 - np.abs(x[:, None] - np.arange(nodes)), 0.0, None)
    return weights


def _line(values: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Straight line (n,) over the used values, with mean 0 and standard deviation 1 there."""
    if not used.any():
        return np.zeros(len(values))
    result: np.ndarray = (values - values[used].mean()) / max(float(values[used].std()), 1e-12)
    return result


def _interpolation(values: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Linear interpolation weights (n, nodes) between quantiles of the used values."""
    if not used.any():
        return np.zeros((len(values), 0))
    nodes = np.unique(np.quantile(values[used], np.linspace(0.0, 1.0, _SHAPE_NODES)))
    return np.column_stack([np.interp(values, nodes, unit) for unit in np.eye(len(nodes))])
