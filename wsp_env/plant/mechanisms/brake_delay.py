"""The brakes of one axle or all axles follow the recorded pressure, or the believed torque, with a first-order lag.

lag dC/dt + C = believed C. Causes: clearance of the calipers, pressure measured upstream of a hose, a logger whose clock is
early. Exact for a torque that changes linearly between samples or substeps. Form and size: assumption.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Doing, Parameter, Passage, Said, Signature, all_or_each_axle, concerns, never, whose


class Parameters(NamedTuple):
    """Parameters of the delay, see `CARD`."""

    lag_s: float
    axle: float


class Lagging(NamedTuple):
    """Brake torques of N vehicles with A axles at the last update."""

    torque_nm: np.ndarray  # (N, A) actual torque [N m]
    believed_nm: np.ndarray  # (N, A) believed torque [N m]
    begun: np.ndarray  # (N, A) 1 after the first update [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Lagging:
    """Return the state before the first update."""
    return Lagging(*(np.zeros((n, len(axle_positions_m))) for _ in Lagging._fields))


@inlined
def _lagged(lag_s: float, given: float, before: float, now: float, duration_s: float) -> float:
    """Torque [N m] after `duration_s`, in which the believed torque changed linearly from `before` to `now`."""
    if duration_s <= 0.0:
        return given
    steady = lag_s * (now - before) / duration_s
    return now - steady + (given - before + steady) * math.exp(-duration_s / lag_s)


@inlined
def torque(p: Parameters, lagging: Lagging, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]; at the start of a stop, it is the believed one."""
    if p.lag_s == 0.0 or not concerns(p.axle, k):
        return torque_nm
    believed = doing.believed_torque
    if lagging.begun[i, k] == 0.0:
        lagging.begun[i, k] = 1.0
        lagging.torque_nm[i, k] = lagging.believed_nm[i, k] = believed
    given = _lagged(p.lag_s, lagging.torque_nm[i, k], lagging.believed_nm[i, k], believed, doing.duration_s)
    return torque_nm + given - believed


@inlined
def follow(p: Parameters, lagging: Lagging, i: int, k: int, passage: Passage) -> None:
    """Update the state with the believed torque of axle k."""
    if p.lag_s == 0.0 or lagging.begun[i, k] == 0.0:
        return
    given, before, now = lagging.torque_nm[i, k], lagging.believed_nm[i, k], passage.torque_nm
    lagging.torque_nm[i, k] = _lagged(p.lag_s, given, before, now, passage.duration_s)
    lagging.believed_nm[i, k] = now


CARD = Card(
    name="brake_delay",
    summary="the brakes of one axle, or of all, follow their pressure with a lag",
    parameters=(
        Parameter("lag_s", "s", 0.0, 0.1, 0.0, 2.0, "assumption: time constant; some of a dump valve's 0.15 s"),
        Parameter("axle", "-", 0.0, 0.0, 0.0, 64.0, "assumption: which wheelset, from 1; 0: all", "axle"),
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
        variants=all_or_each_axle,
        words=whose,
    ),
    study={"lag_s": 0.2},
)
