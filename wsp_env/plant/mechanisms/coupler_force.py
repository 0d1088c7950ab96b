"""A neighbouring vehicle pushes and pulls at the coupler, periodically.

A braking train oscillates along its length, at some tenths of a hertz to one hertz with buffers and draw gear between coaches
(Q. Wu, M. Spiryagin, C. Cole, Longitudinal train dynamics: an overview, Vehicle System Dynamics 54 (2016) 1688-1714). The force
is one harmonic. It starts with the first brake application, or at the start of the stop if the train already oscillates. It
acts in full while the brake is applied, and with the share `released` otherwise. Size, and constant amplitude within a stop:
assumptions. A liquid in a tank, or other cargo that swings, is a mass at a spring, too: recordings of one vehicle do not tell
them apart.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import APPLIED_SHARE, Card, Moment, Parameter, Recorded, Said, Signature

#: Shares of the force without an applied brake that are tried in recordings: buffers compressed by the brake only, and a train
#: that always oscillates (assumptions); a refit changes them.
_RELEASED = 0.3, 1.0


class Parameters(NamedTuple):
    """Parameters of the force, see `CARD`."""

    sine_n: float
    cosine_n: float
    frequency_hz: float
    from_start: float
    released: float


class Swing(NamedTuple):
    """State of the oscillation of N trains."""

    since_s: np.ndarray  # (N,) time of the first brake application after the start [s]
    once: np.ndarray  # (N,) 1 after the first application [-]


def memory(n: int, axle_positions_m: Sequence[float]) -> Swing:
    """Return the state of trains that have not braked."""
    return Swing(*(np.zeros(n) for _ in Swing._fields))


@inlined
def force(p: Parameters, swing: Swing, i: int, speed_mps: float, believed_n: float, moment: Moment) -> float:
    """Force against the motion [N]; stores the time of the first application."""
    if p.sine_n == 0.0 and p.cosine_n == 0.0:
        return 0.0
    applied = moment.braking > APPLIED_SHARE
    if p.from_start == 0.0 and swing.once[i] == 0.0:
        if not applied:
            return 0.0
        swing.once[i], swing.since_s[i] = 1.0, moment.time_s
    share = 1.0 if applied else p.released
    phase = 2.0 * math.pi * p.frequency_hz * (moment.time_s - swing.since_s[i])
    return share * (p.sine_n * math.sin(phase) + p.cosine_n * math.cos(phase))


def frequencies(recorded: Recorded) -> list[dict[str, float]]:
    """Return the variants: frequencies of the recorded speed's oscillations, started by the brake or at the start."""
    ways = [(0.0, _RELEASED[0]), *((1.0, share) for share in _RELEASED)]
    return [
        {"frequency_hz": frequency, "from_start": start, "released": share}
        for frequency in recorded.swings_hz
        for start, share in ways
    ]


def _kilo(force_n: float) -> float:
    return 1e-3 * force_n


_SWINGS = "a neighbouring vehicle, or cargo that swings, pushes and pulls at {frequency_hz:.2f} Hz, with {size}"
_FIRST = "as it begins"
_LATER = "a quarter of a period after it begins"

CARD = Card(
    name="coupler_force",
    summary="a neighbouring vehicle, or cargo that swings, pushes and pulls periodically",
    parameters=(
        Parameter("sine_n", "N", 0.0, 3000.0, -5e4, 5e4, "assumption: some 7 % of a coach's braking force"),
        Parameter("cosine_n", "N", 0.0, 2000.0, -5e4, 5e4, "assumption: the same, a quarter of a period earlier"),
        Parameter("frequency_hz", "Hz", 0.3, 0.3, 0.05, 5.0, "Wu, Spiryagin, Cole (2016)", "shape", refit_step=0.005),
        Parameter("from_start", "-", 0.0, 0.0, 0.0, 1.0, "0: the brake sets it off; 1: it goes on from the start", "shape"),
        Parameter("released", "-", 0.3, 0.3, 0.0, 1.0, "assumption: share while no brake is applied", "shape", refit_step=0.05),
    ),
    record=Parameters,
    acts={"force": force},
    memory=memory,
    signature=Signature(
        balances=frozenset({"vehicle"}),
        trace="vehicle: swings at one frequency, from the first application of the brake or from the start on",
        acts_on="vehicle",
        next_test="the same stop with the vehicle alone and empty, or with the coupler's force recorded",
        said=(
            Said("sine_n", "kN", _kilo, f"{_SWINGS} against the motion {_LATER}", f"{_SWINGS} with the motion {_LATER}"),
            Said("cosine_n", "kN", _kilo, f"{_SWINGS} against the motion {_FIRST}", f"{_SWINGS} with the motion {_FIRST}"),
        ),
        over="time",
        swings=True,
        variants=frequencies,
    ),
    study={"sine_n": 6000.0},
)
