"""The replica of a campaign: what the baseline would have recorded, without noise, on the recorded stops.

Recorded slip and force are noisy, and so is everything computed from them. A change of the model evaluated on noisy channels
shares their noise with the residual, and a fit then explains noise. So the residuals come from the recordings once, at the
baseline, and every change of the model is evaluated on the replica (an instrument in the sense of regression with errors in
variables).

The replica keeps the estimated speed and, where a wheel slides, its creepage. Below that, on the steep part of the creep curve,
its slip is the one at which the baseline gives the recorded force: the measured one is noise there. For the same reason the
residual is taken linear in the measured less the replica's slip.
"""

import dataclasses
import threading
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from wsp_env.contact.degraded import adhesion_slope, degraded_adhesion
from wsp_env.diagnosis.balances import Balances, Rows
from wsp_env.diagnosis.evaluate import Evaluation, Evaluator, Model
from wsp_env.diagnosis.stops import BLOCK_S, ROLLING_SHARE, SLIP_MPS, PreparedStop, least_slip, smooth_wheels
from wsp_env.plant.mechanisms import ALL

_WINDOW_S = 0.25  # over which the kept creepage is smoothed once more: its noise is the recordings' own
_NEWTON = 12
_LEAST_ADHESION = 0.01  # against which an error of slip is compared: hardly braked wheels roll


class Replica:
    """The balances of recorded stops about a baseline; offers what `Balances` does.

    What smoothing leaves in the wheels' rows of the replica it leaves in those of the recordings: it is taken away.
    """

    def __init__(self, recorded: Balances, baseline: Model) -> None:
        self.recorded, self.baseline = recorded, baseline
        larger = _larger_radii(recorded, baseline)
        evaluator = Evaluator(recorded.campaign, recorded.sources)
        found = evaluator(baseline)
        made = [_rolling(recorded, one, baseline, i, larger) for i, one in enumerate(found)]
        forces = Evaluator(recorded.campaign, made)(baseline)
        self._copy = recorded.like([_braked(recorded, stop, one) for stop, one in zip(made, forces, strict=True)])
        self.rows = _rows_of_true_slips(recorded.rows, self._copy.rows, larger)
        self._kept = threading.local()  # every thread keeps its last evaluation
        self._share = [
            # A wheel of another radius is in the replica as it slides, and what its sensor shows is linear in that radius.
            _needed(recorded, stop, one, baseline, i, larger)[1] * (larger == 0.0)
            for i, (stop, one) in enumerate(zip(recorded.stops, recorded.evaluate(baseline), strict=True))
        ]
        self._slopes = [one.slope for one in self._copy.evaluate(baseline)]
        smoothing = self._changed(baseline)  # what smoothing leaves of an exact balance
        self._offset = self._residuals() - smoothing * (1.0 + recorded.rows.wheels)

    def __getattr__(self, name: str) -> Any:
        """Return what the replica's balances have."""
        if name.startswith("__") or name == "_copy":
            raise AttributeError(name)
        return getattr(self._copy, name)

    def evaluate(self, model: Model) -> list[Evaluation]:
        """Return what a model says of every stop of the replica; the last one is kept.

        What a sensor shows of a slip that is hardly there is linear in the slip, as the recordings' residual is.
        """
        last: tuple[Model, list[Evaluation]] | None = getattr(self._kept, "last", None)
        if last is None or last[0] is not model:
            whole = self._copy.evaluate(model)
            sensors = {name for name in model.choice if ALL[name].signature.acts_on == "sensor"}
            if sensors:
                others = {name: values for name, values in model.choice.items() if name not in sensors}
                without = self._copy.evaluate(dataclasses.replace(model, choice=others))
                whole = [_seen(*each) for each in zip(whole, without, self._share, self._slopes, strict=True)]
            last = self._kept.last = (model, whole)
        return last[1]

    def raw(self, model: Model) -> np.ndarray:
        """Residuals (n,) of a model: those of the recordings at the baseline and what the model changes."""
        return self._changed(model) + self._offset

    def _changed(self, model: Model) -> np.ndarray:
        parts = zip(self._copy.parts, self.evaluate(model), strict=True)
        return np.concatenate([part.residuals(one) for part, one in parts])

    def _residuals(self) -> np.ndarray:
        """Residuals (n,) of the recordings at the baseline."""
        result, rows = self.recorded.raw(self.baseline), self.rows
        pairs = zip(self.recorded.evaluate(self.baseline), self.evaluate(self.baseline), strict=True)
        for i, (one, copy) in enumerate(pairs):
            expected = copy.adhesion + copy.slope * (one.slip - copy.slip)
            wheels = self.recorded.parts[i].wheel_rows(one.force / (2.0 * one.load) - expected)
            result[(rows.run == i) & rows.wheels] = wheels
        return result


def _seen(whole: Evaluation, without: Evaluation, share: np.ndarray, slope: np.ndarray) -> Evaluation:
    """Return an evaluation with sensors' errors, which are linear in the slip where little of the measured one is kept.

    The slope is the baseline's, as in the recordings' residual. The wheels slide there as without the errors.
    """
    misread = (1.0 - share) * (whole.slip - without.slip)
    linear = without.adhesion + slope * (whole.slip - without.slip)
    return dataclasses.replace(
        whole,
        adhesion=share * whole.adhesion + (1.0 - share) * linear,
        slope=share * whole.slope + (1.0 - share) * without.slope,
        slip=whole.slip - misread,
        misread=misread,
    )


def _rows_of_true_slips(recorded: Rows, copied: Rows, larger: np.ndarray) -> Rows:
    """Return the recorded rows with the replica's slip and work of wheels of another radius."""
    turned = recorded.wheels & (larger[recorded.axle] != 0.0)
    slip, work = (np.where(turned, copy, own) for copy, own in ((copied.slip, recorded.slip), (copied.work, recorded.work)))
    return dataclasses.replace(recorded, slip=slip, work=work)


def _larger_radii(recorded: Balances, model: Model) -> np.ndarray:
    """Return the shares (A,) by which the wheels' radii are larger than believed, as they roll before they are first braked.

    0 where that looks like no slide, or where less than three blocks of the recordings say so.
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


def _rolling(recorded: Balances, one: Evaluation, model: Model, index: int, larger: np.ndarray) -> PreparedStop:
    """Return a stop with the wheels at the replica's creepage; their torques are still the recorded ones."""
    stop, radius = recorded.sources[index], recorded.radius
    length = 2 * round(0.5 * _WINDOW_S / stop.step_s) + 1
    smooth = savgol_filter(_creepage(recorded, one, model, index, larger), length, 3, axis=0)
    wheel = (one.speed[:, None] - smooth * stop.speed[:, None]) / radius
    return dataclasses.replace(stop, wheel=wheel, wheel_rate=np.gradient(wheel, stop.step_s, axis=0))


def _braked(recorded: Balances, stop: PreparedStop, one: Evaluation) -> PreparedStop:
    """Return the stop with the torques that balance its wheels as the baseline's brakes and wheelsets are, smoothed."""
    torque = stop.torque + (2.0 * one.load * one.adhesion - one.force) * recorded.radius
    wheel, rate, jerk, smooth = smooth_wheels(stop.wheel, torque, stop.step_s)
    return dataclasses.replace(stop, wheel=wheel, wheel_rate=rate, wheel_jerk=jerk, torque=smooth)


def _creepage(balances: Balances, one: Evaluation, model: Model, index: int, larger: np.ndarray) -> np.ndarray:
    """Creepage (T, A) of the stop: as measured where the wheel slides, else as its force needs it."""
    stop = balances.sources[index]
    slip, share = _needed(balances, stop, one, model, index, larger)
    v = np.maximum(stop.speed, 0.1)[:, None]
    result: np.ndarray = np.clip((share * _true_slip(one, v, larger) + (1.0 - share) * slip) / v, -0.2, 0.999)
    return result


def _true_slip(one: Evaluation, v: np.ndarray, larger: np.ndarray) -> np.ndarray:
    """Slip (T, A) of wheels whose radii are larger by a share than believed, at a speed (T, 1)."""
    slip: np.ndarray = one.slip - larger * (v - one.slip)
    return slip


def _needed(
    balances: Balances, stop: PreparedStop, one: Evaluation, model: Model, index: int, larger: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the slip (T, A) that the wheels' forces need on the creep curve's steep part, and the share kept of the measured.

    The measured slip is kept where it is a slide's, and where the curve is so flat at both slips that an error hardly moves the
    adhesion; blended between, so that no wheel jumps. What a wheel of another radius shows while it rolls is no slide.
    """
    law = balances.vehicle.contact.law
    load = stop.mass * balances.vehicle.gravity_mps2 / (2 * balances.axles)
    v = np.maximum(stop.speed, 0.1)[:, None]
    aim = np.clip(one.force / (2.0 * load), -0.05, None)
    slip, most = np.zeros_like(one.slip), least_slip(v)
    for _ in range(_NEWTON):
        f = degraded_adhesion(slip, v, load, model.mu_cd[index], model.tau, law)
        slope = adhesion_slope(slip, v, load, model.mu_cd[index], model.tau, law)
        slip = np.clip(slip + (aim - f) / np.maximum(slope, 0.05 / v), -most, most)
    true = _true_slip(one, v, larger)
    measured = adhesion_slope(np.clip(true, 0.0, None), v, load, model.mu_cd[index], model.tau, law)
    steep = SLIP_MPS * np.maximum(slope, measured) / np.maximum(aim, _LEAST_ADHESION)
    slides = (true / most - 0.7) / 0.6
    share: np.ndarray = np.clip(np.maximum(slides, 2.0 * (1.0 - steep)), 0.0, 1.0)
    return slip, share
