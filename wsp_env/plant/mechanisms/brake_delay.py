"""The brakes of one axle or all axles follow the recorded pressure, or the believed torque, later: dead time and time constant.

T dC/dt + C = C_believed(t - dead time), the usual model of a brake's response (delay and build-up of EN 14531-1; in control,
first order plus dead time). `lag_s` is the sum of both, by which a slow change is late; `rise_share` is the time constant's
share of it. Causes: clearance of the calipers, pressure measured upstream of a hose, a logger whose clock is early (dead time
alone). Exact for a torque that changes linearly between samples or substeps, but that of longer ago is kept at some instants
only. Size: assumption.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import (
    Card,
    Doing,
    Parameter,
    Passage,
    Recorded,
    Said,
    Signature,
    all_or_each_axle,
    concerns,
    never,
    whose,
)

#: Number of instants of the dead time at which the believed torque is kept (assumption: 6 ms apart in a dead time of 0.2 s).
_KEPT = 32


class Parameters(NamedTuple):
    """Parameters of the delay, see `CARD`."""

    lag_s: float
    axle: float
    rise_share: float


class Lagging(NamedTuple):
    """Brake torques of N vehicles with A axles at the last update."""

    torque_nm: np.ndarray  # (N, A) actual torque [N m]
    believed_nm: np.ndarray  # (N, A) believed torque [N m]
    late_nm: np.ndarray  # (N, A) believed torque before the dead time [N m]
    begun: np.ndarray  # (N, A) 1 after the first update [-]
    clock_s: np.ndarray  # (N, A) since the first update [s]
    newest: np.ndarray  # (N, A) index of the last instant that was kept [-]
    kept_s: np.ndarray  # (N, A, K) instants that were kept [s]
    kept_nm: np.ndarray  # (N, A, K) believed torque then [N m]


def memory(n: int, axle_positions_m: Sequence[float]) -> Lagging:
    """Return the state before the first update."""
    each = (n, len(axle_positions_m))
    return Lagging(*(np.zeros((*each, _KEPT) if name.startswith("kept") else each) for name in Lagging._fields))


@inlined
def _between(instant: float, first: float, value: float, last: float, other: float) -> float:
    """Value at an instant on a straight line through two points, `first` before `last`."""
    return value + (other - value) * (instant - first) / (last - first)


@inlined
def _believed_at(lagging: Lagging, i: int, k: int, instant_s: float, now_s: float, now_nm: float) -> float:
    """Believed torque [N m] of axle k at an instant up to `now_s`, when it is `now_nm`."""
    after_s, after_nm = now_s, now_nm
    before_s, before_nm = lagging.clock_s[i, k], lagging.believed_nm[i, k]
    at = int(lagging.newest[i, k])
    for _ in range(_KEPT):
        if before_s <= instant_s:
            break
        after_s, after_nm = before_s, before_nm
        before_s, before_nm = lagging.kept_s[i, k, at], lagging.kept_nm[i, k, at]
        at = at - 1 if at > 0 else _KEPT - 1
    if before_s > instant_s or after_s <= before_s:
        return before_nm
    return _between(instant_s, before_s, before_nm, after_s, after_nm)


@inlined
def _late(p: Parameters, lagging: Lagging, i: int, k: int, now_nm: float, duration_s: float) -> float:
    """Believed torque [N m] of axle k before the dead time, `duration_s` after the last update, when it is `now_nm`."""
    now = lagging.clock_s[i, k] + duration_s
    return _believed_at(lagging, i, k, now - p.lag_s * (1.0 - p.rise_share), now, now_nm)


@inlined
def _lagged(constant_s: float, given: float, before: float, now: float, duration_s: float) -> float:
    """Torque [N m] after `duration_s`, in which what it follows changed linearly from `before` to `now`."""
    if duration_s <= 0.0:
        return given
    if constant_s <= 0.0:
        return now
    steady = constant_s * (now - before) / duration_s
    return now - steady + (given - before + steady) * math.exp(-duration_s / constant_s)


@inlined
def torque(p: Parameters, lagging: Lagging, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]; at the start of a stop, it is the believed one."""
    if p.lag_s == 0.0 or not concerns(p.axle, k):
        return torque_nm
    believed = doing.believed_torque
    if lagging.begun[i, k] == 0.0:
        lagging.begun[i, k] = 1.0
        lagging.torque_nm[i, k] = lagging.believed_nm[i, k] = lagging.late_nm[i, k] = believed
        lagging.kept_nm[i, k, :] = believed
    late = _late(p, lagging, i, k, believed, doing.duration_s)
    given = _lagged(p.lag_s * p.rise_share, lagging.torque_nm[i, k], lagging.late_nm[i, k], late, doing.duration_s)
    return torque_nm + given - believed


@inlined
def follow(p: Parameters, lagging: Lagging, i: int, k: int, passage: Passage) -> None:
    """Update the state with the believed torque of axle k."""
    if p.lag_s == 0.0 or lagging.begun[i, k] == 0.0:
        return
    now, duration = passage.torque_nm, passage.duration_s
    late = _late(p, lagging, i, k, now, duration)
    constant = p.lag_s * p.rise_share
    lagging.torque_nm[i, k] = _lagged(constant, lagging.torque_nm[i, k], lagging.late_nm[i, k], late, duration)
    lagging.believed_nm[i, k], lagging.late_nm[i, k] = now, late
    lagging.clock_s[i, k] += duration
    newest = int(lagging.newest[i, k])
    # So far apart that all of them together span the dead time.
    if (lagging.clock_s[i, k] - lagging.kept_s[i, k, newest]) * (_KEPT - 2) >= p.lag_s - constant:
        newest = newest + 1 if newest + 1 < _KEPT else 0
        lagging.newest[i, k] = newest
        lagging.kept_s[i, k, newest], lagging.kept_nm[i, k, newest] = lagging.clock_s[i, k], now


def _delays(recorded: Recorded) -> list[dict[str, float]]:
    """Return the variants: all axles or one, each half dead time; a refit finds the share."""
    return [one | {"rise_share": 0.5} for one in all_or_each_axle(recorded)]


CARD = Card(
    name="brake_delay",
    summary="the brakes of one axle, or of all, follow their pressure late",
    parameters=(
        Parameter("lag_s", "s", 0.0, 0.1, 0.0, 2.0, "assumption: dead time and time constant; some of a dump valve's 0.15 s"),
        Parameter("axle", "-", 0.0, 0.0, 0.0, 64.0, "assumption: which wheelset, from 1; 0: all", "axle"),
        Parameter(
            "rise_share",
            "-",
            1.0,
            1.0,
            0.0,
            1.0,
            "assumption: share of the time constant in it; 0: dead time alone",
            "shape",
            refit_step=0.2,
        ),
    ),
    record=Parameters,
    acts={"torque": torque, "after_passage": follow},
    memory=memory,
    recalls=never,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion", "actuator"}),
        trace="actuator and adhesion: in proportion to dC/dt, on one axle or on all alike; nothing at a steady torque",
        acts_on="brake",
        next_test="steps of the brake demand at standstill or while rolling, with the torque measured at the calipers",
        said=(Said("lag_s", "ms", lambda lag: 1e3 * lag, "{whose} brake torque lags the believed one by {size}"),),
        over="time",
        normal={"lag_s": 0.02},  # assumption: a sample of a usual logger
        variants=_delays,
        words=whose,
    ),
    study={"lag_s": 0.2},
)
