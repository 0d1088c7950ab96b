"""The smallest effect of interest: what moves a stop by 1 % in distance or a measured slip by 0.1 m/s.

One function for all mechanisms. A change of what retards the vehicle, at the slip that was measured, changes the distance by
the integral of v delta_a / a dt. A change of an axle's balance, at the force that was measured, moves its slip by delta_f over
the steepness of the creep curve. A fault of a speed sensor retards nothing and changes the measured slip itself. A force that
pushes and pulls in turn changes neither in the mean: of it the largest push matters, from 1 % of what retards the vehicle on.

Sizes are net: against the model that was tuned anew without the mechanism. What another tau and other mu_cd do as well
matters to nobody.
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
PUSH = DISTANCE  # [-]; as much, without a pause, would be that in distance
_LEAST_SAMPLES = 50  # of sliding, for a mean
_LEAST_STEEPNESS = 0.01  # [s/m] of a creep curve; flatter, an axle has no slip of its own: assumption
_BRAKED_MPS2 = 0.2  # deceleration from which on a vehicle counts as braked
_PEAKS = 0.95  # quantile at which a sensor's error counts: a protection acts on peaks of slip, not on their mean (assumption)
_LEAST = 1e-6  # of the smallest effect of interest: what has no effect at all


@dataclasses.dataclass(frozen=True)
class StopChange:
    """What a mechanism does to the recorded stops."""

    distance: float  # relative change of the stopping distance [-], mean of the stops that it changes most, gentle or sliding
    slip: float  # largest change of an axle's slip, upper or lower half of speeds, mean of stops [m/s]
    push: float = 0.0  # of a force that pushes and pulls: its amplitude over what retards the vehicle, mean of stops [-]

    @property
    def multiple(self) -> float:
        """Size as multiple of the smallest effect of interest [-]."""
        return max(abs(self.distance) / DISTANCE, abs(self.slip) / SLIP_MPS, self.push / PUSH, _LEAST)


def only_sensors(choice: Choice) -> bool:
    """Whether all mechanisms of a choice act on sensors."""
    return all(ALL[name].signature.acts_on == "sensor" for name in choice)


class Compared:
    """A model along the recorded stops that others are compared with: what of the comparison is its alone."""

    def __init__(self, replica: Replica, before: Sequence[Evaluation]) -> None:
        self.before, self._radius = before, replica.radius
        pairs = zip(replica.stops, before, strict=True)
        self._parts = [_Part.of(stop.speed, one, replica.radius) for stop, one in pairs]

    def change(self, after: Sequence[Evaluation], sensor: bool = False, swings: bool = False) -> StopChange:
        """Return what another model changes, evaluated along the same stops.

        Parameters
        ----------
        sensor : whether only sensors differ
        swings : whether a force differs that pushes and pulls in turn

        """
        distances: dict[bool, list[float]] = {True: [], False: []}
        slips, pushes = [], []
        for part, one, other in zip(self._parts, self.before, after, strict=True):
            if sensor:
                slips.append(_shown(part, one, other))
                continue
            slips.append(_moved(part, _unbalanced(other, self._radius) - part.unbalanced))
            if part.braked.any():
                more = _retarded(other, part.slides, self._radius) - part.retarded
                distances[part.slid].append(-float(part.travelled @ more))
                if swings:
                    pushes.append(float(np.sqrt(2.0) * np.std(more[part.braked]) / part.retarded[part.braked].mean()))
        means = [float(np.mean(kind)) for kind in distances.values() if kind]
        slip = float(np.ma.masked_invalid(slips).mean(axis=0).filled(0.0).max())
        push = float(np.mean(pushes)) if pushes else 0.0
        return StopChange(max(means, key=abs, default=0.0), slip, push=push)


class _Part(NamedTuple):
    """What the comparison asks of one stop, T samples, in the upper and the lower half of its speeds."""

    halves: np.ndarray  # (2, T) 1 or 0
    slides: np.ndarray  # (T, A) bool
    slid: bool  # whether the stop is a sliding one
    unbalanced: np.ndarray  # (T, A), see `_unbalanced`
    flat: np.ndarray  # (2, A) what makes a mean change of slip [m/s] of sums over squares of changes of it; nan: hardly slides
    retarded: np.ndarray  # (T,), see `_retarded`
    braked: np.ndarray  # (T,) bool
    travelled: np.ndarray  # (T,) share of the distance braked over what retards [s2/m]; 0 where it is not braked

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


def _moved(part: _Part, unbalanced: np.ndarray) -> np.ndarray:
    """Change (2, A) of each axle's slip [m/s] over the halves of the speeds, by one (T, A) of its balance."""
    result: np.ndarray = np.sqrt(part.halves @ (unbalanced**2 * part.slides)) * part.flat
    return result


def _shown(part: _Part, one: Evaluation, other: Evaluation) -> np.ndarray:
    """Change (2, A) of each axle's slip as it is measured [m/s]; nan where a half is short."""
    shown = np.abs(other.slip + other.misread - one.slip - one.misread)
    result: np.ndarray = np.full((2, shown.shape[1]), np.nan)
    for i, half in enumerate(part.halves):
        if half.sum() >= _LEAST_SAMPLES:
            result[i] = np.quantile(shown[half > 0.0], _PEAKS, axis=0)
    return result


def _unbalanced(one: Evaluation, radius: float) -> np.ndarray:
    """Adhesion (T, A) [-] that a wheel's balance asks for with the model's brake, less what the contact gives."""
    result: np.ndarray = (one.force + (one.braking - one.torque) / radius) / (2.0 * one.load) - one.adhesion
    return result


def _retarded(one: Evaluation, slides: np.ndarray, radius: float) -> np.ndarray:
    """Deceleration (T,) [m/s2] that brakes, contacts and resistances give at the measured slip."""
    force = np.where(slides, 2.0 * one.load * one.adhesion, one.braking / radius) @ np.ones(slides.shape[1]) + one.resistance
    result: np.ndarray = force / one.mass
    return result
