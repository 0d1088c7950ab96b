"""The slips and torques of a replica's wheels (see `wsp_env.diagnosis.replica`): measured where they slide, else required."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.denoise import denoised
from wsp_env.diagnosis.evaluate import Evaluation, Evaluator, Model
from wsp_env.diagnosis.stops import (
    BLOCK_S,
    ROLLING_SHARE,
    SLIP_MPS,
    PreparedStop,
    least_slip,
    smooth_wheels,
    wheel_filter,
)

_NEWTON, _CONVERGED = 12, 1e-6  # iterations of the required slip, and its change [m/s] at which it has converged
_FLAT_S = 0.5  # averaging time of the curve's flatness [s], so that it does not follow noise
_LEAST_ADHESION = 0.01  # lower bound of the adhesion with which a slip error is compared: hardly braked wheels roll


def larger_radii(recorded: Balances, model: Model) -> np.ndarray:
    """Return the relative excess (A,) of the wheel radii over the believed ones, from rolling before the first braking.

    It is 0 if the resulting slip error is below the smallest one of interest, or if there are fewer than three blocks of data.
    """
    found: list[list[np.ndarray]] = [[] for _ in range(recorded.axles)]
    for stop, one in zip(recorded.stops, recorded.evaluate(model), strict=True):
        braked = np.abs(stop.torque) > ROLLING_SHARE * np.abs(stop.torque).max()
        before = ~np.logical_or.accumulate(braked, axis=0) & stop.usable
        for axle, mine in enumerate(before.T):
            found[axle].append(one.slip[mine, axle] / (stop.speed[mine] - one.slip[mine, axle]))
    least = 3.0 * BLOCK_S / max(stop.step_s for stop in recorded.stops)
    every = [np.concatenate(one) for one in found]
    larger = np.array([np.median(one) if len(one) >= least else 0.0 for one in every])
    fastest = max(float(stop.speed.max()) for stop in recorded.stops)
    result: np.ndarray = np.where(np.abs(larger) * fastest > SLIP_MPS, larger, 0.0)
    return result


def rolling(
    recorded: Balances, one: Evaluation, index: int, needed: np.ndarray, share: np.ndarray, true: np.ndarray, wrong: np.ndarray
) -> PreparedStop:
    """Return a stop with the wheels at the replica's slip and the recorded torques.

    The slip is the measured one where the wheel slides (the true one of wheels (A,) bool with a wrong reading), else the one
    that its force requires.
    """
    stop, radius, noise = recorded.sources[index], recorded.radius, recorded.sources[index].noise
    v = np.maximum(stop.speed, 0.1)[:, None]
    creepage = np.clip((share * np.where(wrong, true, one.slip) + (1.0 - share) * needed) / v, -0.2, 0.999)
    slip = creepage * stop.speed[:, None]
    smooth = denoised(slip, share, radius * noise.wheel, wheel_filter(noise.step_s), stop.step_s, noise.step_s)
    wheel = (one.speed[:, None] - smooth) / radius
    return dataclasses.replace(stop, wheel=wheel, wheel_rate=np.gradient(wheel, stop.step_s, axis=0))


def braked(recorded: Balances, stop: PreparedStop, one: Evaluation) -> PreparedStop:
    """Return the stop with the torques that balance its wheels with the baseline's brakes and wheelsets, smoothed."""
    torque = stop.torque + (2.0 * one.load * one.adhesion - one.force) * recorded.radius
    wheel, rate, jerk, smooth = smooth_wheels(stop.wheel, torque, stop.step_s)
    return dataclasses.replace(stop, wheel=wheel, wheel_rate=rate, wheel_jerk=jerk, torque=smooth)


def true_slips(
    read: Sequence[Evaluation], evaluations: Sequence[Evaluation], stops: Sequence[PreparedStop], larger: np.ndarray
) -> list[np.ndarray]:
    """Return the true slips (T, A) of every stop: from a model's sensors, or from the measured radii if these are wrong."""
    true = []
    for one, other, stop in zip(read, evaluations, stops, strict=True):
        v = np.maximum(stop.speed, 0.1)[:, None]
        true.append(np.where(larger != 0.0, one.slip - larger * (v - one.slip), other.slip))
    return true


def required_slips(
    balances: Balances, evaluator: Evaluator, model: Model, found: Sequence[Evaluation], true: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:  # fmt: skip
    """Return the slips (T, A) required by the wheels' forces on the steep part, and the share kept of the measured slips.

    The measured slip is kept where the true slip (T, A) is a slide, and where the curve is so flat at both slips that a slip
    error hardly changes the adhesion. The transition is gradual, so that no wheel jumps. A sensor's error of a rolling wheel is
    no slide: the true slips decide. The curve includes the model's loads and friction.
    """
    speeds = [np.maximum(stop.speed, 0.1)[:, None] for stop in balances.sources]

    def at(slips: Sequence[np.ndarray]) -> list[Evaluation]:
        return evaluator(model, [(one.slip - slip) / balances.radius for one, slip in zip(found, slips, strict=True)])

    slips = [np.zeros_like(one.slip) for one in found]
    for _ in range(_NEWTON):
        there, before = at(slips), slips
        slips = [
            np.clip(
                one.slip + (_required_adhesion(one) - one.adhesion) / np.maximum(one.slope, 0.05 / v),
                -least_slip(v),
                least_slip(v),
            )
            for one, v in zip(there, speeds, strict=True)
        ]
        if max(float(np.abs(new - old).max()) for new, old in zip(slips, before, strict=True)) < _CONVERGED:
            break
    measured = at([np.clip(slip, 0.0, None) for slip in true])
    shares = []
    for one, other, slip, v, stop in zip(there, measured, true, speeds, balances.sources, strict=True):
        steep = SLIP_MPS * np.maximum(one.slope, other.slope) / np.maximum(_required_adhesion(one), _LEAST_ADHESION)
        slides = (slip / least_slip(v) - 0.7) / 0.6
        flat = uniform_filter1d(np.clip(2.0 * (1.0 - steep), 0.0, 1.0), 2 * round(0.5 * _FLAT_S / stop.step_s) + 1, axis=0)
        shares.append(np.clip(np.maximum(slides, flat), 0.0, 1.0))
    return slips, shares


def _required_adhesion(one: Evaluation) -> np.ndarray:
    """Return the adhesion (T, A) that a wheel's force requires."""
    return np.clip(one.force / (2.0 * one.load), -0.05, None)
