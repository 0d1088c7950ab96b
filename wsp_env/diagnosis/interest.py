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
    most: float = np.inf  # multiple that the samples of a time allow
    push: float = 0.0  # of a force that pushes and pulls: its amplitude over what retards the vehicle, mean of stops [-]

    @property
    def multiple(self) -> float:
        """Size as multiple of the smallest effect of interest [-]."""
        return min(max(abs(self.distance) / DISTANCE, abs(self.slip) / SLIP_MPS, self.push / PUSH, _LEAST), self.most)


def only_sensors(choice: Choice) -> bool:
    """Whether all mechanisms of a choice act on sensors."""
    return all(ALL[name].signature.acts_on == "sensor" for name in choice)


def change(
    replica: Replica, before: Sequence[Evaluation], after: Sequence[Evaluation], sensor: bool = False, swings: bool = False
) -> StopChange:  # fmt: skip
    """Return what one model changes against another, both evaluated along the recorded stops.

    Parameters
    ----------
    sensor : whether only sensors differ
    swings : whether a force differs that pushes and pulls in turn

    """
    distances: dict[bool, list[float]] = {True: [], False: []}
    slips, pushes = [], []
    for stop, one, other in zip(replica.stops, before, after, strict=True):
        slides = one.slip > least_slip(stop.speed)[:, None]
        slips.append(_moved(stop.speed, one, other, slides, None if sensor else replica.radius))
        base, moved = (_retarded(e, slides, replica.radius) for e in (one, other))
        braked = base > _BRAKED_MPS2
        if not sensor and braked.any():
            travelled = stop.speed * stop.step_s
            nearer = -(travelled * (moved - base) / np.maximum(base, _BRAKED_MPS2))[braked].sum()
            distances[bool(slides.mean() > 0.2)].append(float(nearer / travelled[braked].sum()))
            pushes.append(float(np.sqrt(2.0) * np.std((moved - base)[braked]) / base[braked].mean()))
    means = [float(np.mean(kind)) for kind in distances.values() if kind]
    slip = float(np.ma.masked_invalid(slips).mean(axis=0).filled(0.0).max())
    push = float(np.mean(pushes)) if swings and pushes else 0.0
    return StopChange(max(means, key=abs, default=0.0), slip, push=push)


def _moved(speed: np.ndarray, one: Evaluation, other: Evaluation, slides: np.ndarray, radius: float | None) -> np.ndarray:
    """Change (2, A) of each axle's slip [m/s] over the upper and lower half of the speeds; nan where it never slides.

    `radius` None: of the slip as it is measured.
    """
    fast = speed > 0.5 * speed[0]
    shown = other.slip + other.misread - one.slip - one.misread
    result: np.ndarray = np.full((2, slides.shape[1]), np.nan)
    for i, half in enumerate((fast, ~fast)):
        for k in range(slides.shape[1]):
            used = half if radius is None else half & slides[:, k]
            if used.sum() >= _LEAST_SAMPLES:
                if radius is None:
                    result[i, k] = float(np.quantile(np.abs(shown[used, k]), _PEAKS))
                else:
                    steepness = max(float(np.abs(one.slope[used, k]).mean()), _LEAST_STEEPNESS)
                    moved = (_unbalanced(other, radius) - _unbalanced(one, radius)) / steepness
                    result[i, k] = float(np.sqrt(np.mean(moved[used, k] ** 2)))
    return result


def _unbalanced(one: Evaluation, radius: float) -> np.ndarray:
    """Adhesion (T, A) [-] that a wheel's balance asks for with the model's brake, less what the contact gives."""
    result: np.ndarray = (one.force + (one.braking - one.torque) / radius) / (2.0 * one.load) - one.adhesion
    return result


def _retarded(one: Evaluation, slides: np.ndarray, radius: float) -> np.ndarray:
    """Deceleration (T,) [m/s2] that brakes, contacts and resistances give at the measured slip."""
    force = np.where(slides, 2.0 * one.load * one.adhesion, one.braking / radius).sum(axis=1) + one.resistance
    result: np.ndarray = force / one.mass
    return result
