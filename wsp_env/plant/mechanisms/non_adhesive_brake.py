"""A brake that does not need the wheels: magnetic or eddy-current track brake, within its band of speed.

A constant force between two speeds, with edges of `EDGE_MPS`, from the first application of the brake on (magnetic track
brakes of coaches are let down in emergency stops and lifted at low speed; size: assumption).
"""

import math
from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter

#: Width of the band's edges [m/s] (assumption).
EDGE_MPS = 0.5

#: Share of the largest torque of one axle from which on the brake counts as applied (assumption).
APPLIED_SHARE = 0.05


class Parameters(NamedTuple):
    """Parameters of the track brake, see `MECHANISM`."""

    force_n: float
    lowest_mps: float
    highest_mps: float


MECHANISM = Mechanism(
    name="non_adhesive_brake",
    summary="a track brake acts within a band of speed",
    parameters=(
        Parameter("force_n", "N", 0.0, 5000.0, 0.0, 2e5, "assumption: a tenth of a coach's braking force"),
        Parameter("lowest_mps", "m/s", 10.0, 10.0, -10.0, 100.0, "assumption: lifted at low speed", "shape"),
        Parameter("highest_mps", "m/s", 100.0, 100.0, 0.0, 200.0, "assumption: no upper limit", "shape"),
    ),
    record=Parameters,
    trace="vehicle: deceleration beyond the wheels' sum, within its band of speed",
)


@inlined
def applied(p: Parameters, before: float, torque_nm: float, full_torque_nm: float) -> float:
    """1 from the first application of the brake on, else 0, from one axle's torque [N m] and its largest."""
    if p.force_n != 0.0 and torque_nm > APPLIED_SHARE * full_torque_nm:
        return 1.0
    return before


@inlined
def force(p: Parameters, speed_mps: float, applied: float) -> float:
    """Force against the motion [N]."""
    if p.force_n == 0.0:
        return 0.0
    above = math.tanh((speed_mps - p.lowest_mps) / EDGE_MPS)
    beyond = math.tanh((speed_mps - p.highest_mps) / EDGE_MPS)
    return 0.5 * applied * p.force_n * (above - beyond)
