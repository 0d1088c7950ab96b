"""The smallest effect of interest: a change of 1 % in stopping distance or of 0.1 m/s in a measured slip.

One function serves all mechanisms. A change of the retarding force, at the measured slip, changes the distance by the integral
of v delta_a / a dt. A change of an axle's balance, at the measured force, changes its slip by delta_f over the slope of the
creep curve. A fault of a speed sensor retards nothing and changes the measured slip itself. An alternating force changes
neither distance nor slip in the mean; its amplitude counts, with 1 % of the retarding force as smallest effect of interest.

Sizes are net: they compare with the model whose tau and mu_cd were refitted without the mechanism.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.evaluate import Choice, Evaluation
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import SLIP_MPS, least_slip
from wsp_env.plant.mechanisms import ALL

DISTANCE = 0.01  # [-]
PUSH = DISTANCE  # [-]; a constant force of this share changes the distance by `DISTANCE`
_LEAST_SAMPLES = 50  # samples of sliding that a mean needs
_LEAST_STEEPNESS = 0.01  # [s/m] lower bound of the curve's slope; below, the force does not determine the slip: assumption
_BRAKED_MPS2 = 0.2  # deceleration from which on a vehicle counts as braked
PEAKS = 0.95  # quantile at which a sensor's error counts: a WSP reacts to peaks of slip, not to the mean (assumption)
_LEAST = 1e-6  # in smallest effects of interest: size of a mechanism without any effect


@dataclasses.dataclass(frozen=True)
class StopChange:
    """Change of the recorded stops by a mechanism."""

    distance: float  # relative change of stopping distance [-]; mean of stops without slides or of sliding ones, the larger
    slip: float  # largest change of an axle's slip in the upper or lower half of the speeds, mean of the stops [m/s]
    push: float = 0.0  # of an alternating force: amplitude over the retarding force, mean of the stops [-]
    stops: tuple[float, ...] = ()  # relative change of each stop's distance [-]; nan: it does not brake

    @property
    def multiple(self) -> float:
        """Size in smallest effects of interest [-]."""
        return max(abs(self.distance) / DISTANCE, abs(self.slip) / SLIP_MPS, self.push / PUSH, _LEAST)


def only_sensors(choice: Choice) -> bool:
    """Whether all mechanisms of a choice act on sensors."""
    return all(ALL[name].signature.acts_on == "sensor" for name in choice)


class Compared:
    """Compares a reference model along the recorded stops with others; holds what depends on the reference only."""

    def __init__(self, replica: Replica, before: Sequence[Evaluation]) -> None:
        self.before, self._radius = before, replica.radius
        pairs = zip(replica.stops, before, strict=True)
        self._parts = [_Part.of(stop.speed, one, replica.radius) for stop, one in pairs]

    def change(self, after: Sequence[Evaluation], sensor: bool = False, swings: bool = False) -> StopChange:
        """Return the change of the stops by another model, evaluated along the same stops.

        Parameters
        ----------
        sensor : whether only sensors differ
        swings : whether an alternating force differs

        """
        distances: dict[bool, list[float]] = {True: [], False: []}
        slips, pushes, stops = [], [], []
        for part, one, other in zip(self._parts, self.before, after, strict=True):
            if sensor:
                slips.append(_reading_change(part, one, other))
                stops.append(0.0)
                continue
            slips.append(_slip_change(part, _unbalanced(other, self._radius) - part.unbalanced))
            stops.append(np.nan)
            if part.braked.any():
                more = _retarded(other, part.slides, self._radius) - part.retarded
                stops[-1] = -float(part.travelled @ more)
                distances[part.slid].append(stops[-1])
                if swings:
                    pushes.append(float(np.sqrt(2.0) * np.std(more[part.braked]) / part.retarded[part.braked].mean()))
        means = [float(np.mean(kind)) for kind in distances.values() if kind]
        slip = float(np.ma.masked_invalid(slips).mean(axis=0).filled(0.0).max())
        push = float(np.mean(pushes)) if pushes else 0.0
        return StopChange(max(means, key=abs, default=0.0), slip, push, tuple(stops))


class _Part(NamedTuple):
    """Quantities of the reference model along one stop, T samples; "halves" are those of the speed range."""

    halves: np.ndarray  # (2, T) 1 or 0
    slides: np.ndarray  # (T, A) bool
    slid: bool  # whether the stop is a sliding one
    unbalanced: np.ndarray  # (T, A), see `_unbalanced`
    flat: np.ndarray  # (2, A) factor from the root sum of squares of changes to a change of slip [m/s]; nan: hardly slides
    retarded: np.ndarray  # (T,), see `_retarded`
    braked: np.ndarray  # (T,) bool
    travelled: np.ndarray  # share of braked distance over deceleration [s2/m]; 0 if not braked

    @classmethod
    def of(cls, speed: np.ndarray, one: Evaluation, radius: float) -> "_Part":
        fast = speed > 0.5 * speed[0]
        halves, slides = np.array([fast, ~fast], dtype=float), one.slip > least_slip(speed)[:, None]
        counts = halves @ slides
        steepness = np.maximum(halves @ (np.abs(one.slope) * slides) / np.maximum(counts, 1.0), _LEAST_STEEPNESS)
        retarded = _retarded(one, slides, radius)
        braked = retarded > _BRAKED_MPS2
        travelled = np.where(braked, speed, 0.0) / np.maximum(retarded, _BRAKED_MPS2)
        return cls(
            halves, slides, bool(slides.mean() > 0.2), _unbalanced(one, radius),
            np.where(counts >= _LEAST_SAMPLES, 1.0 / (np.sqrt(np.maximum(counts, 1.0)) * steepness), np.nan),
            retarded, braked, travelled / max(float(speed[braked].sum()), 1e-12),
        )  # fmt: skip


def _slip_change(part: _Part, unbalanced: np.ndarray) -> np.ndarray:
    """Change (2, A) of each axle's slip [m/s] in the halves of the speeds, for a change (T, A) of its balance."""
    result: np.ndarray = np.sqrt(part.halves @ (unbalanced**2 * part.slides)) * part.flat
    return result


def _reading_change(part: _Part, one: Evaluation, other: Evaluation) -> np.ndarray:
    """Change (2, A) of each axle's measured slip [m/s]; nan for a half with too few samples."""
    shown = np.abs(other.slip + other.misread - one.slip - one.misread)
    result: np.ndarray = np.full((2, shown.shape[1]), np.nan)
    for i, half in enumerate(part.halves):
        if half.sum() >= _LEAST_SAMPLES:
            result[i] = np.quantile(shown[half > 0.0], PEAKS, axis=0)
    return result


def _unbalanced(one: Evaluation, radius: float) -> np.ndarray:
    """Adhesion (T, A) [-] needed for the wheel's balance with the model's brake, minus the adhesion of the contact."""
    result: np.ndarray = (one.force + (one.braking - one.torque) / radius) / (2.0 * one.load) - one.adhesion
    return result


def _retarded(one: Evaluation, slides: np.ndarray, radius: float) -> np.ndarray:
    """Deceleration (T,) [m/s2] by contacts, brakes and resistances at the measured slip."""
    force = np.where(slides, 2.0 * one.load * one.adhesion, one.braking / radius) @ np.ones(slides.shape[1]) + one.resistance
    result: np.ndarray = force / one.mass
    return result
