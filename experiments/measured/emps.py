"""The drive: a model of mass and viscous friction, from which dry friction, offset and the rest are left out.

The force of the motor is M a + F_v v + what is missing. Speed and acceleration come from the measured position by a filter
without phase and central differences, and all rows pass the same decimation, as Janot, Gautier and Brunot (2019) identify
their model. The first file is to tune on, the second is held out; the runs are the cycles of the reference.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, decimate, filtfilt

from experiments.measured.files import Drive
from wsp_env.diagnosis.terms import Selection, Term, search

#: Values of the benchmark's own simulation (Janot, Gautier, Brunot 2019): kg, N s/m, N, N.
LITERATURE = {"M": 95.1089, "F_v": 203.5034, "F_c": 20.3935, "offset": -3.1648}
#: Cut-off of the filter of the position [Hz] and its order: five times the bandwidth of the loop, 20 Hz, as in the benchmark.
_CUT_OFF_HZ = 100.0
_ORDER = 4
#: The rows are decimated to twice the loop's bandwidth [Hz]: what is above is no motion of the drive.
_ROWS_HZ = 40.0
#: Rows at each end of a recording that the filters' edges reach, in seconds.
_EDGE_S = 0.25
#: An effect matters if it is 1 % of the force, as 1 % of the stopping distance does in the diagnosis of recorded stops.
INTEREST = 0.01
#: Speeds at which a smoothed sign or a Stribeck curve bends [m/s]; the drive reaches 0.13 m/s.
_BENDS = (0.003, 0.01, 0.03, 0.1)
#: Lags of the force [s].
_LAGS = (0.01, 0.03, 0.1)


class Rows(NamedTuple):
    """Rows of both files."""

    force: np.ndarray  # (n,) [N]
    baseline: np.ndarray  # (n, 2) acceleration [m/s2] and speed [m/s]
    terms: list[Term]
    cycle: np.ndarray  # (n,) int, one number for each cycle of each file
    held_out: np.ndarray  # (n,) bool, the second file
    time: np.ndarray  # (n,) [s]
    speed: np.ndarray  # (n,) [m/s]


class Step(NamedTuple):
    """The model after a number of terms."""

    added: str
    values: dict[str, float]  # mass, viscous friction and the terms' amplitudes, on the file to tune on
    error_tune: float  # [%] of the force
    error_held_out: float


def rows(recordings: Sequence[Drive]) -> Rows:
    """Make the rows of a file to tune on and a file to hold out."""
    parts = [_rows(one) for one in recordings]
    names = [name for name, _, _ in parts[0][2]]
    terms = [Term(name, np.concatenate([part[2][i][1] for part in parts]), parts[0][2][i][2]) for i, name in enumerate(names)]
    count = [len(part[0]) for part in parts]
    offset = np.cumsum([0, *(int(part[3].max()) + 1 for part in parts)])
    return Rows(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        terms,
        np.concatenate([part[3] + start for part, start in zip(parts, offset, strict=False)]),
        np.repeat([False, True], count),
        np.concatenate([part[4] for part in parts]),
        np.concatenate([part[1][:, 1] for part in parts]),
    )


def find(data: Rows, most: int = 6) -> Selection:
    """Search what mass and viscous friction leave."""
    nuisances = data.baseline, np.zeros(2, dtype=bool)
    force = float(np.sqrt(np.mean(data.force**2)))

    def least(effect: np.ndarray) -> float:
        return float(np.sqrt(np.mean(effect**2)) / (INTEREST * force))

    return search(data.force, data.terms, nuisances, data.cycle, data.held_out, least, most)


def steps(data: Rows, selection: Selection) -> list[Step]:
    """Return the errors of the model after each term, all amplitudes from the file to tune on."""
    names = [one.term.name for one in selection.chosen]
    return [fitted(data, names[:count]) for count in range(len(names) + 1)]


def remains(data: Rows, selection: Selection) -> list[np.ndarray]:
    """Return the force (n,) [N] that is left after each term."""
    names = [one.term.name for one in selection.chosen]
    return [_fit(data, names[:count])[1] for count in range(len(names) + 1)]


def fitted(data: Rows, names: Sequence[str]) -> Step:
    """Fit mass, viscous friction and some terms to the file to tune on."""
    amplitude, rest = _fit(data, names)
    parts = (~data.held_out, data.held_out)
    errors = [100.0 * float(np.linalg.norm(rest[k]) / np.linalg.norm(data.force[k])) for k in parts]
    widths = [next(one for one in data.terms if one.name == name).columns.shape[1] for name in names]
    every = ["M", "F_v", *(name for name, width in zip(names, widths, strict=True) for _ in range(width))]
    added = names[-1] if names else "mass, viscous friction"
    return Step(added, dict(zip(every, map(float, amplitude), strict=True)), *errors)


def _fit(data: Rows, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    by_name = {one.name: one.columns for one in data.terms}
    x = np.column_stack([data.baseline, *(by_name[name] for name in names)])
    amplitude = np.linalg.lstsq(x[~data.held_out], data.force[~data.held_out], rcond=None)[0]
    return amplitude, data.force - x @ amplitude


def literature_error(data: Rows) -> float:
    """Relative error [%] on the held-out file of the model with the benchmark's own values."""
    by_name = {one.name: one.columns for one in data.terms}
    model = np.column_stack([data.baseline, by_name["sign(v)"], by_name["offset"]]) @ np.array(list(LITERATURE.values()))
    held = data.held_out
    return 100.0 * float(np.linalg.norm((data.force - model)[held]) / np.linalg.norm(data.force[held]))


def _rows(one: Drive) -> tuple[np.ndarray, np.ndarray, list[tuple[str, np.ndarray, int]], np.ndarray, np.ndarray]:
    """Return force (m,), baseline (m, 2), terms [(name, (m, k), parameters of form)], cycle (m,), time (m,)."""
    step = float(np.median(np.diff(one.time)))
    smooth = butter(_ORDER, 2.0 * step * _CUT_OFF_HZ)
    q = filtfilt(*smooth, one.position)
    v = np.gradient(q, step)
    a = np.gradient(v, step)
    factor = round(1.0 / (step * _ROWS_HZ))
    edge = round(_EDGE_S * _ROWS_HZ)

    def thin(x: np.ndarray) -> np.ndarray:
        result: np.ndarray = decimate(x, factor, axis=0)[edge:-edge]
        return result

    cycle = _cycles(one.reference)[::factor][edge:-edge]
    plain = [(name, thin(np.column_stack([column])), 0) for name, column in _plain(one, q, v, a, step)]
    formed = [(name, thin(np.column_stack(columns)), 1) for name, columns in _formed(one, q, v, step)]
    terms = plain + formed
    time = one.time[::factor][edge:-edge]
    return thin(one.force), thin(np.column_stack([a, v])), terms, cycle - cycle.min(), time


def _cycles(reference: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the cycle: one begins where the reference sets out forward after it went backward."""
    speed = np.gradient(reference)
    moving = np.abs(speed) > 1e-3 * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), 0))
    way = np.sign(speed[last])
    result: np.ndarray = np.concatenate([[0], np.cumsum(np.diff(way) > 1.0)])
    return result


def _plain(one: Drive, q: np.ndarray, v: np.ndarray, a: np.ndarray, step: float) -> list[tuple[str, np.ndarray]]:
    """Return what may be missing and has no parameter but its amplitude, at the full sampling rate."""
    sign, size = np.sign(v), np.abs(v)
    return [
        ("sign(v)", sign),
        ("offset", np.ones(len(v))),
        ("sign(v), forward only", (v > 0.0).astype(float)),
        ("sign(v), backward only", -(v < 0.0).astype(float)),
        ("viscous, forward only", np.maximum(v, 0.0)),
        ("|v| v", size * v),
        ("v^2", v**2),
        ("v^3", v**3),
        ("sign(v) sqrt|v|", sign * np.sqrt(size)),
        ("position", q),
        ("position^2", q**2),
        ("sign(v) position", sign * q),
        ("v position", v * q),
        ("time", one.time),
        ("sign(v) time", sign * one.time),
        ("a sign(v)", a * sign),
        ("a forward only", np.where(v > 0.0, a, 0.0)),
        ("power of the motor", one.force * v),
        ("|force| sign(v)", np.abs(one.force) * sign),
        ("change of acceleration", np.gradient(a, step)),
        ("pulses_N", one.pulses),
    ]


def _formed(one: Drive, q: np.ndarray, v: np.ndarray, step: float) -> list[tuple[str, list[np.ndarray]]]:
    """Return what may be missing and has a parameter of its form, several values of it."""
    result = []
    for bend in _BENDS:
        result.append((f"tanh(v / {bend:g} m/s)", [np.tanh(v / bend)]))
        result.append((f"Stribeck, {bend:g} m/s", [np.sign(v) * np.exp(-((v / bend) ** 2))]))
    for lag in _LAGS:
        result.append((f"force, low-passed at {lag:g} s", [_low_pass(one.force, lag, step)]))
    span = float(np.ptp(q))
    # From one wave over the travel to forty, each half a wave from the next: nothing falls between two of them.
    for waves in np.arange(1.0, 40.5, 0.5):
        phase = 2.0 * np.pi * waves * (q - q.min()) / span
        result.append((f"swing over position, {1e3 * span / waves:.1f} mm", [np.sin(phase), np.cos(phase)]))
    return result


def _low_pass(x: np.ndarray, lag: float, step: float) -> np.ndarray:
    """First-order lag of x (n,), less x."""
    share, state, result = step / (lag + step), float(x[0]), np.empty(len(x))
    for i, value in enumerate(x):
        state += share * (value - state)
        result[i] = state
    return result - x
