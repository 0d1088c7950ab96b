"""Whether the recorded speed of the vehicle wanders: the error that all gripping wheels show alike.

A receiver whose reading wanders slowly changes no force and no stop. The estimate of the vehicle's speed
(`wsp_env.diagnosis.speed`) takes its wandering as coloured noise, and every balance fits. But the slip that is computed from
such a reading is wrong, and a slide protection brakes by it. A wheel that grips slips by no more than its force requires, so
that its speed tells the vehicle's. What the recorded speed differs from it, in the mean over some seconds and on all axles
alike, is the reading's error. It has no equation and cannot be predicted for another stop. Whether it is the vehicle's reading
that errs is told by the axles: the error of each must be that of the others, in the runs held out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.answer import Discovered, Estimate, Location, RunTrace
from wsp_env.diagnosis.interest import PEAKS
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import SLIP_MPS, PreparedStop
from wsp_env.diagnosis.thinning import cut
from wsp_env.diagnosis.trials import MATTERS

#: Time over which errors are averaged [s]: several correlation times of a receiver's noise, 0.2 to 0.5 s (assumption).
_MEAN_S = 2.0
#: Least number of means, in multiples of the number of features that are fitted to them.
_MEANS = 2
#: Largest share of its measured slip that a replica keeps of a wheel that grips, and least share of a mean's samples that grip.
_GRIPS, _LEAST = 0.2, 0.3
#: Least share of an axle's error that the others predict (assumption): a fault of one axle's torque or sensor is its own.
_COMMON = 0.75
#: Notes to an answer with this finding.
NOTES = (
    "removed is the share of a gripping wheel's slip error that the other axles predict; the error has no equation, so that no "
    "other balance fits better",
    "other physics was not looked for: with a speed that wanders, slips are not known well enough",
)
_Z90 = 1.645  # two-sided 90 % quantile of the normal distribution


class Wander(NamedTuple):
    """Error of the recorded speed, from means over some seconds."""

    size: float  # bound of 95 % of the means over the axles [m/s]
    of_runs: np.ndarray  # (R,) root mean square of each run [m/s]; nan: fewer than two axles grip in it
    common: float  # share of each axle's mean square that the mean of the others predicts, in the runs held out [-]
    gain: float  # mean square over that of the axles' own errors, times the number of means, in all runs
    held_out_gain: float  # the same in the runs held out

    @property
    def multiple(self) -> float:
        """Size in smallest effects of interest [-]."""
        return self.size / SLIP_MPS

    @property
    def matters(self) -> bool:
        """Whether the vehicle's reading errs, and by enough to matter."""
        return self.multiple >= MATTERS and self.common >= _COMMON


class Wandering(NamedTuple):
    """The finding that the recorded speed wanders."""

    term: Discovered
    location: Location
    course: RunTrace  # the recorded speed's error before, and what the other axles leave of the first one's after


def wander(errors: Sequence[np.ndarray], held_out: Sequence[bool]) -> Wander:
    """Return how the recorded speed wanders, from its errors (M, A) in each run; nan where a wheel does not grip.

    Parameters
    ----------
    errors : means over some seconds [m/s]
    held_out : of each run, whether it is held out; if none or all are, all count

    """
    held = np.array(held_out, dtype=bool)
    held = held if held.any() and not held.all() else np.ones(len(errors), dtype=bool)
    of_runs, parts = np.full(len(errors), np.nan), np.zeros((len(errors), 3))
    shared: list[np.ndarray] = []
    for i, every in enumerate(errors):
        mine = every[np.isfinite(every).sum(axis=1) > 1]
        if not len(mine):
            continue
        known = np.isfinite(mine)
        count, total = known.sum(axis=1, keepdims=True), np.nansum(mine, axis=1, keepdims=True)
        others = (total - mine) / (count - 1)
        shared.append(np.abs(total / count).ravel())
        of_runs[i] = np.sqrt(np.mean(shared[-1] ** 2))
        parts[i] = np.nansum(mine**2), np.nansum((mine - others) ** 2), known.sum()

    def gain(of: np.ndarray) -> float:
        square, rest, number = parts[of].sum(axis=0)
        return float(number * max(square - rest, 0.0) / max(rest, 1e-12))

    square, rest, _ = parts[held].sum(axis=0)
    common = float(1.0 - rest / square) if square > 0.0 else 0.0
    size = float(np.quantile(np.concatenate(shared), PEAKS)) if shared else 0.0
    return Wander(size, of_runs, common, gain(np.ones(len(held), dtype=bool)), gain(held))


def errors_of(replica: Replica) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return for each run the errors (M, A) [m/s] that its wheels show in the recorded speed, and features (M, A, F).

    The errors are nan where a wheel does not grip, or seems not to because the error is large. The features are those of the
    vehicle's motion, and the slip that a wheel's force requires. The replica is one of the law alone: what sensors do is not
    undone.
    """
    errors, features = [], []
    recorded, required = replica.recorded.evaluate(replica.baseline), replica.evaluate(replica.baseline)
    for stop, share, read, own in zip(replica.recorded.stops, replica.kept_slips, recorded, required, strict=True):
        error = (stop.recorded_speed - stop.speed)[:, None] + read.slip - own.slip
        v, a, t = stop.speed, stop.acceleration, stop.time - stop.time[0]
        motion = np.stack([np.ones_like(v), v, v**2, a, v * a, t, v * t], axis=-1)
        every = np.concatenate([np.repeat(motion[:, None], error.shape[1], axis=1), own.slip[..., None]], axis=-1)
        inside = cut((share < _GRIPS) & stop.usable, max(round(_MEAN_S / stop.step_s), 1))
        known = inside.mean(axis=1) >= _LEAST
        errors.append(np.where(known, _mean(error, inside), np.nan))
        features.append(np.stack([_mean(one, inside) for one in np.moveaxis(every, -1, 0)], axis=-1))
    return errors, features


def _mean(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return the means (M, A) of values (T, A) over the samples `inside` (M, length, A) of each group."""
    total = np.where(inside, cut(values, inside.shape[1]), 0.0).sum(axis=1)
    result: np.ndarray = total / np.maximum(inside.sum(axis=1), 1)
    return result


def beyond_motion(errors: Sequence[np.ndarray], features: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return errors (M, A) of each run less what their features (M, A, F) explain in all runs alike; nan: too few of them.

    A late clock, a scale, a radar that pitches and a soft contact repeat from run to run. They have names or terms.
    """
    y, x = np.concatenate([one.ravel() for one in errors]), np.concatenate([one.reshape(-1, one.shape[-1]) for one in features])
    known = np.isfinite(y)
    width = x.shape[1]
    means = sum(int((np.isfinite(one).sum(axis=1) > 1).sum()) for one in errors)
    if means < (1 + _MEANS) * width:
        return [np.full_like(one, np.nan) for one in errors]
    scale = np.maximum(np.abs(x[known]).max(axis=0), 1e-12)
    fitted = np.linalg.lstsq(x[known] / scale, y[known], rcond=1e-9)[0] / scale
    wider = np.sqrt(means / (means - width))  # a fit leaves less than there is
    return [wider * (one - of @ fitted) for one, of in zip(errors, features, strict=True)]


def wandering(replica: Replica) -> Wandering | None:
    """Return the finding that the recorded speed wanders and where; None if it does not, or too little to matter."""
    names = [stop.name for stop in replica.recorded.stops]
    errors, held_out = beyond_motion(*errors_of(replica)), [stop.group == "validate" for stop in replica.recorded.stops]
    found = wander(errors, held_out)
    if not found.matters:
        return None
    squares = found.of_runs[np.isfinite(found.of_runs)] ** 2
    spread = _Z90 * float(squares.std(ddof=1) / np.sqrt(len(squares)) / squares.mean()) if len(squares) > 1 else 1.0
    low, high = found.size * np.sqrt(np.clip([1.0 - spread, 1.0 + spread], 0.0, None))
    runs = [name for name, one in zip(names, found.of_runs, strict=True) if one >= np.sqrt(squares.mean())]
    said = f"the recorded speed of the vehicle wanders, by up to {found.size:.2f} m/s against all wheels that grip"
    term = Discovered(
        "sensor", (), (), (), said, (), {"wander": Estimate(found.size, "m/s", (float(low), float(high)))}, (),
        found.common, found.multiple, found.gain, found.held_out_gain,
    )  # fmt: skip
    shown = max(
        (i for i, held in enumerate(held_out) if held or not any(held_out)), key=lambda i: np.nan_to_num(found.of_runs)[i]
    )
    return Wandering(
        term, Location("kinematics", (), tuple(runs), "everywhere", 1.0), _course(replica.recorded.stops[shown], errors[shown])
    )


def _course(stop: PreparedStop, errors: np.ndarray) -> RunTrace:
    """Return the course of the errors (M, A) in a run: the mean over the axles, and an axle's less that of the others."""
    known = np.isfinite(errors)
    count = known.sum(axis=1)
    at = np.flatnonzero(count > 1)
    mine, place = errors[at], known[at].argmax(axis=1)
    first = mine[np.arange(len(at)), place]
    total = np.nansum(mine, axis=1)
    after = first - (total - first) / (count[at] - 1)
    time = stop.time[0] + _MEAN_S * (at + 0.5)
    speed, left = tuple((total / count[at]).tolist()), tuple(after.tolist())
    return RunTrace(stop.name, stop.group, 1, (), (), (), (), tuple(time.tolist()), speed, left, "speed")
