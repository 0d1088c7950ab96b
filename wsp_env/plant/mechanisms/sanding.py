"""A sander blows sand before a sliding axle; the sand removes a share of the contaminant layer.

It starts when the axle's slip has exceeded a threshold for some time, as triggered by a WSP, and stops when the slip falls
below the threshold. With a threshold of 0 it works without a slide, as in an emergency brake. Above a running speed it does
not work. The sand between wheel and rail builds up and decays with time constants. Later axles find the sand that
earlier ones leave. Full-scale tests: S. R. Lewis, S. Riley, D. I. Fletcher, R. Lewis, International Journal of Railway
Technology 6 (2017) 87-98. On track: RSSB's trials of 2017 at Melton; at an adhesion of 0.02, one sander with a fixed rate
shortened a stop from over 1200 m to 800 m. The mean adhesion of all axles rose by about 0.01, a twentieth of the way to a dry
rail. Form and times: assumptions.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.card import Card, Parameter, Passage, Recorded, Said, Signature, never, percent

#: Share of the sand at one axle that reaches the next one (assumption: each wheel crushes and throws off some of it).
BEHIND = 0.7

#: Slip thresholds [m/s] and delay [s] that are tried in recordings (assumption); a refit changes them.
_THRESHOLDS_MPS = (0.7, 1.5, 3.0)
_DELAY_S = 0.8
#: The same of sanders that work without a slide: below a running speed [m/s], or some time after the start [s] (assumption).
_BELOW_MPS, _LATE_S = 20.0, 5.0
#: Initial time constants of a refit [s], see `CARD`.
_BUILD_UP_S, _DECAY_S = 0.5, 1.5


#: Above any running speed [m/s].
_ANY_MPS = 200.0


class Parameters(NamedTuple):
    """Parameters of the sanders, see `CARD`."""

    share: float
    axle: float
    threshold_mps: float
    delay_s: float
    build_up_s: float
    decay_s: float
    below_mps: float


class Bogies(NamedTuple):
    """Positions of the sanders if every bogie has one."""

    leads: np.ndarray  # (A,) 1 for the leading axle of a bogie [-]


class Sand(NamedTuple):
    """State of the sanders of N vehicles with A axles."""

    slid_s: np.ndarray  # (N, A) time for which the slip has exceeded the threshold [s]
    built: np.ndarray  # (N, A) sand at an axle over that at full rate [-]


def derive(vehicle: Vehicle) -> Bogies:
    """Return the leading axles of a vehicle's bogies."""
    return Bogies(np.array([float(k == 0) for body in vehicle.running_gear for count in body for k in range(count)]))


def memory(n: int, axle_positions_m: Sequence[float]) -> Sand:
    """Return the state of sanders that have not worked."""
    return Sand(*(np.zeros((n, len(axle_positions_m))) for _ in Sand._fields))


@inlined
def layer_left(
    p: Parameters, bogies: Bogies, sand: Sand, i: int, k: int, place_m: float, rolled_m: float, layer: float, held: float
) -> tuple[float, float]:  # fmt: skip
    """Shares of the contaminant layer [-], free and lagging, that the sand of axle k and of the axles ahead leaves."""
    if p.share == 0.0:
        return layer, held
    found = 0.0
    for ahead in range(k + 1):
        found = max(BEHIND * found, sand.built[i, ahead])
    left = 1.0 - p.share * found
    return left * layer, left * held


@inlined
def work(p: Parameters, bogies: Bogies, sand: Sand, i: int, k: int, passage: Passage) -> None:
    """Update the sand at axle k, if it has a sander; the sander works during slides."""
    if p.share == 0.0 or not (p.axle == k + 1.0 or (p.axle == 0.0 and bogies.leads[k] > 0.0)):
        return
    slow = passage.after_m - passage.before_m < p.below_mps * passage.duration_s
    slides = p.threshold_mps == 0.0 or passage.slip_mps > p.threshold_mps
    sand.slid_s[i, k] = sand.slid_s[i, k] + passage.duration_s if slides and slow else 0.0
    works = sand.slid_s[i, k] > p.delay_s
    aim = 1.0 if works else 0.0
    past = math.exp(-passage.duration_s / (p.build_up_s if works else p.decay_s))
    sand.built[i, k] = aim + (sand.built[i, k] - aim) * past


def sanders(recorded: Recorded) -> list[dict[str, float]]:
    """Return the variants: a sander for every bogie, or on one axle; with a slip threshold, or without, slow or late."""
    axles = range(recorded.axles + 1) if recorded.axles > 1 else (0,)
    times = {"delay_s": _DELAY_S, "build_up_s": _BUILD_UP_S, "decay_s": _DECAY_S}
    starts: list[dict[str, float]] = [{"threshold_mps": slip} for slip in _THRESHOLDS_MPS]
    starts += [{"threshold_mps": 0.0, "below_mps": _BELOW_MPS}, {"threshold_mps": 0.0, "delay_s": _LATE_S}]
    return [{"axle": float(axle)} | times | start for axle in axles for start in starts]


def where(values: Mapping[str, float]) -> dict[str, str]:
    """Return position and time of the sander in words, for the sentence."""
    where = f"axle {values['axle']:.0f}" if values["axle"] else "each bogie's leading axle"
    when = "while it slides" if values["threshold_mps"] else f"from {values['delay_s']:.1f} s on"
    if values.get("below_mps", _ANY_MPS) < _ANY_MPS:
        when += f", below {3.6 * values['below_mps']:.0f} km/h"
    return {"where": where, "when": when}


CARD = Card(
    name="sanding",
    summary="sanders before axles that slide take away a share of the contaminant layer",
    parameters=(
        Parameter("share", "-", 0.0, 0.1, 0.0, 1.0, "size: RSSB's trials at Melton (2017), some 0.05 as mean of all axles"),
        Parameter("axle", "-", 0.0, 0.0, 0.0, 64.0, "assumption: which, from 1; 0: the leading one of each bogie", "axle"),
        Parameter(
            "threshold_mps", "m/s", 1.5, 1.5, 0.0, 50.0, "assumption: slip beyond which it starts", "shape", refit_step=0.1
        ),
        Parameter(
            "delay_s", "s", _DELAY_S, _DELAY_S, 0.0, 10.0, "assumption: logic, valve, way to the rail", "shape", refit_step=0.05
        ),
        Parameter(
            "build_up_s",
            "s",
            _BUILD_UP_S,
            _BUILD_UP_S,
            0.01,
            10.0,
            "assumption: time constant of the rate of sand",
            "shape",
            refit_step=0.05,
        ),
        Parameter(
            "decay_s",
            "s",
            1.5,
            1.5,
            0.01,
            60.0,
            "assumption: time constant of what clings to the wheel",
            "shape",
            refit_step=0.15,
        ),
        Parameter(
            "below_mps", "m/s", _ANY_MPS, _ANY_MPS, 0.0, _ANY_MPS, "assumption: speed of its sander", "shape", refit_step=0.5
        ),
    ),
    record=Parameters,
    acts={"layer": layer_left, "after_passage": work},
    derive=derive,
    memory=memory,
    recalls=never,
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: rises about a second after a slide has begun, on one axle and less on those behind it",
        acts_on="contact",
        next_test="the same stop with the sanders cut out",
        said=(Said("share", "%", percent, "sand at {where} takes away {size} of the contaminant layer {when}"),),
        over="time",
        variants=sanders,
        words=where,
    ),
    study={"share": 0.2},
)
