"""The smallest effect of interest: what moves a reference stop by 1 % in distance or a measured slip by 0.1 m/s.

Two kinds of reference stops: one brakes so gently that no wheel slides, in the others the WSP works nearly all the time on
a rail that gives less than is asked for. There a stable slide between the two would not do: it magnifies a fourth of a
percent of friction to 0.1 m/s of slip, which is less than the normal variation. The slip is an axle's mean as measured, over
the upper or the lower half of a stop's speeds. What reaches its mark first, in either kind, decides; one function for
all effects. The results stand in smallest.json; `python -m experiments.concealed interest` computes them anew.
"""

import functools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from experiments.concealed.effects import ALL, ConcealedEffect, Place
from experiments.concealed.sensors import record
from experiments.concealed.setup import RADIUS_M, Setup, reference
from experiments.concealed.truth import simulate

DISTANCE_SHARE = 0.01  # [-]
SLIP_MPS = 0.1
TABLE = Path(__file__).with_name("smallest.json")
_LEAST_SPEED_MPS = 5.0  # below, slip is small whatever happens
_STEP = 1.05  # the search ends at this ratio of its bounds
_DECADES = 1e-5  # smallest size looked at, as share of the largest

ANYWHERE = Place()

#: Distance [m] and mean slip (2, A) [m/s] of a stop, at its upper and at its lower speeds.
Outcome = tuple[float, np.ndarray]


def drive(setup: Setup, rng: np.random.Generator) -> dict[str, tuple[dict[str, np.ndarray], float]]:
    """Drive every run; returns its columns and its stopping distance [m] from the call of the brake."""
    driven = {}
    for name, run in setup.runs.items():
        history = simulate(setup.vehicle, setup.law, setup.brake, run, setup.profile, setup.effects)
        distance = float(history.position[-1] - run.position - run.speed * run.coast)
        driven[name] = record(history, setup, rng), distance
    return driven


def outcomes(setup: Setup) -> dict[str, Outcome]:
    """Drive without noise and sum up every stop."""
    return {
        name: (distance, _mean_slip(columns)) for name, (columns, distance) in drive(setup, np.random.default_rng(0)).items()
    }


def _mean_slip(columns: dict[str, np.ndarray]) -> np.ndarray:
    wheels = np.stack([values for name, values in columns.items() if name.endswith("wheel_speed_radps")], axis=1)
    speed = columns["vehicle_speed_mps"]
    slip = speed[:, None] - RADIUS_M * wheels
    fast = speed > 0.5 * speed[0]
    halves = fast, ~fast & (speed > _LEAST_SPEED_MPS)
    # A stop that ends before its lower speeds says nothing of them.
    return np.stack([slip[half].mean(axis=0) if half.any() else np.zeros(slip.shape[1]) for half in halves])


def change(effect: ConcealedEffect, size: float, place: Place = ANYWHERE) -> tuple[float, float]:
    """Return the effect's change of the reference stops, of the kind that it changes most.

    The relative change of the distance [-], signed, and the change of an axle's mean slip [m/s]; the sliding stops are
    averaged, as a WSP's cycles make a single one depend on trifles.
    """
    base = _reference()
    return compared(
        base, outcomes(effect.apply(reference(), size, place)), [["gentle"], [name for name in base if name != "gentle"]]
    )


def compared(base: Mapping[str, Outcome], moved: Mapping[str, Outcome], kinds: Sequence[Sequence[str]]) -> tuple[float, float]:
    """Return the mean relative change of the distance [-] and of an axle's slip [m/s], of the kind of stops that moves most."""
    distances = {name: moved[name][0] / base[name][0] - 1.0 for name in base}
    slips = {name: moved[name][1] - base[name][1] for name in base}
    distance = max((float(np.mean([distances[n] for n in kind])) for kind in kinds), key=abs)
    slip = max(float(np.abs(np.mean([slips[n] for n in kind], axis=0)).max()) for kind in kinds)
    return distance, slip


@functools.cache
def _reference() -> dict[str, Outcome]:
    return outcomes(reference())


def key(name: str, variant: int) -> str:
    """Return the key of an effect's variant in the table of sizes."""
    return f"{name}/{variant % len(ALL[name].variants)}"


def smallest(name: str, variant: int = 0) -> float:
    """Return the smallest size of interest of an effect in its unit, by bisection of its logarithm."""
    effect = ALL[name]
    if effect.assumed:
        return effect.assumed
    low, high = _DECADES * effect.largest, effect.largest
    while high / low > _STEP:
        middle = float(np.sqrt(low * high))
        distance, slip = change(effect, middle, Place(variant=variant))
        reached = abs(distance) >= DISTANCE_SHARE or slip >= SLIP_MPS
        low, high = (low, middle) if reached else (middle, high)
    if high == effect.largest:
        raise ValueError(f"{name}: no size up to {high:g} {effect.unit} moves a reference stop; state an assumed one")
    return float(f"{np.sqrt(low * high):.3g}")


def smallest_size(one: tuple[str, int]) -> bytes:
    """Return the smallest size of interest of an effect's variant, as JSON."""
    return json.dumps(smallest(*one)).encode()


def sizes() -> dict[str, float]:
    """Return the table of smallest sizes of interest, by `key`, in the effects' units."""
    table: dict[str, float] = json.loads(TABLE.read_text(encoding="utf-8"))
    return table
