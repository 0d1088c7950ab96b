"""Channels of one axle that are late beside the other axles'.

Three witnesses: the wheel's own balance in a slide under a WSP tells to a hundredth of a second by how much torque and wheel
are apart, but not which is late; the moment at which the brakes apply tells the torque; rolling together the wheel. A brake
itself may lag: then its torque was computed from a pressure that is early beside its wheel and yet on time beside the others,
or was measured late and the wheel says so too. Both are physics.
"""

import dataclasses

import numpy as np

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.own_balance import LONGEST_S, OwnBalance
from wsp_env.recordings.suspect.rolled import GAIN, TORQUE_LATE, WHEEL_LATE, rolled
from wsp_env.recordings.suspect.search import Search, with_column
from wsp_env.recordings.suspect.traces import Traces, rolling

_LEAST_S = 0.03  # of a delay: three samples
#: The same in one of several runs: a logger is late in all of them. Of 20 sound campaigns of two hard stops two had a channel
#: that seemed late by less in one run (`experiments/wrong_units.py`, "nothing wrong").
_LEAST_ALONE_S = 0.1
_FITS = 0.7  # correlation from which a wheel's own balance tells a delay
_BRAKE_LAG_S = 0.2  # by which a brake may lag its pressure, or one brake the others: assumption
_APPLIES = 0.15  # of a torque's largest: early in filling, where times of filling hardly matter
_MORE = 2.0  # times what the wheels' own balances usually leave
_LEAST_LEFT = 0.01  # share that they leave by the filters alone: assumption
_LATE = 0.6  # share of the torque's delay that the creepage must confirm where no slide tells
_FORM = 0.08  # [s] error of a wheel's delay by rolling, per error of its brake's gain by the same: from simulated sound stops
_FLOOR_S = 0.006  # the same that nothing else shows: from simulated sound stops
_SURE = 4.0  # deviations
_COARSE_S = 0.05
_SMOOTHER = 0.5  # of the scatter of its ratio to the others that moving a wheel must leave at most
_LONG_S = 5.0  # of rolling from which that is tried


@dataclasses.dataclass(frozen=True)
class _Witnesses:
    """What is known of one axle in one run [s]; nan: nothing."""

    apart: float  # torque late beside its own wheel, less the other axles' median
    onset: float  # torque late beside the others' as the brakes apply
    wheel: float  # wheel late beside the others, by rolling
    wheel_error: float
    torque: float  # torque late beside what the wheel's creepage says
    torque_error: float


def find(search: Search) -> None:
    """Find and mend delays: those in all runs first, then those of single ones; the largest first, which spoils the others."""
    names = list(search.traces())
    heard: dict[str, dict[int, _Witnesses]] = {}
    for group in [names, *([name] for name in names if len(names) > 1)]:
        left = set(range(search.axles))
        while left:
            for name in names:
                if name not in heard:
                    heard[name] = _witnesses(search, name)
            least = _LEAST_ALONE_S if len(group) < len(names) else 0.0
            usual = _SURE * _scatter([abs(one.onset) for name in names if name not in group for one in heard[name].values()])
            told = {axle: _delay([heard[name] for name in group], axle, usual) for axle in left}
            late = {axle: one for axle, one in told.items() if one is not None and abs(one[1]) >= least}
            if not late:
                break
            axle = max(late, key=lambda k: abs(late[k][1]))
            _tell(search, group, axle, *late[axle])
            left.remove(axle)
            for name in group:
                del heard[name]


def _tell(search: Search, names: list[str], axle: int, channel: str, seconds: float) -> None:
    full = f"axle{axle + 1}_{channel}"
    names = list(search.runs) if len(names) == len(search.traces()) else names
    search.report(
        SuspectChannel(
            full,
            f"{abs(seconds):.2g} s {'late' if seconds > 0.0 else 'early'} beside the other channels{where(names, search.runs)}",
            f"shift {full} by {-seconds:+.2g} s, or give it its own clock (`time`) in [channels]",
            "delay", axle + 1, seconds, tuple(names),
        )
    )  # fmt: skip
    field = {"wheel_speed": "wheel_speed_radps", "brake_torque": "brake_torque_nm"}[channel]
    for name in names:
        run = search.runs[name]
        values = getattr(run, field)
        moved = np.interp(run.time_s + seconds, run.time_s, values[:, axle])
        search.mend(name, **{field: with_column(values, axle, moved)})


def _delay(runs: list[dict[int, "_Witnesses"]], axle: int, usual: float = 0.0) -> tuple[str, float] | None:
    """Return the channel of an axle (from 0) that is late in some runs, and by how much [s]; None where none is.

    Parameters
    ----------
    usual : by which the brakes of sound axles may apply late [s], as those of the other runs do

    """
    heard = [by_axle[axle] for by_axle in runs if axle in by_axle]
    if not heard:
        return None
    onset = _median([one.onset for one in heard])
    apart = _shared([one.apart for one in heard])
    wheel, error, scatter = _weighed([(one.wheel, one.wheel_error) for one in heard])
    torque, torque_error, other_scatter = _weighed([(one.torque, one.torque_error) for one in heard])
    # Both come from one comparison: where the runs contradict each other in either, a brake does what no record tells.
    scatter = max(scatter, other_scatter)
    # The same holds where a torque is surely further off than its wheel: only one of the two may be late.
    of_brake = abs(torque) > max(abs(wheel), _SURE * scatter * torque_error)
    wheel_is_late = abs(wheel) > max(_LEAST_S, _SURE * scatter * error) and not of_brake
    if np.isfinite(apart):
        return _told_apart(apart, onset, wheel, wheel_is_late)
    if wheel_is_late:
        return "wheel_speed", wheel
    if abs(onset) > max(_BRAKE_LAG_S, usual):
        return "brake_torque", onset
    confirmed = bool(onset) and torque / onset > _LATE and abs(torque) > _SURE * scatter * torque_error
    # The creepage of rolling wheels is a poor witness: noise moves the onsets of two gentle stops alike by some hundredths.
    return ("brake_torque", onset) if abs(onset) > max(0.5 * _BRAKE_LAG_S, usual) and confirmed else None


def _told_apart(apart: float, onset: float, wheel: float, wheel_is_late: bool) -> tuple[str, float] | None:
    """Which of the two is late, where torque and wheel are known to be apart."""
    if abs(apart) < _LEAST_S:
        return None
    if wheel_is_late and abs(apart + wheel) < 0.5 * abs(apart):
        return "wheel_speed", wheel
    by_torque = abs(onset - apart) < abs(onset)  # false where the onset is not known
    if by_torque:
        return "brake_torque", apart
    if apart > 0.0:
        return ("wheel_speed", -apart) if np.isfinite(onset) else ("brake_torque", apart)
    return ("wheel_speed", -apart) if apart < -_BRAKE_LAG_S else None


def _witnesses(search: Search, name: str) -> dict[int, _Witnesses]:
    """Return what is known of every axle (from 0) that is there."""
    one, here, own = search.traces()[name], search.sound(name), search.own_balances()[name]
    lags = {k: b.lag_s for k in here if (b := own[k]) is not None and b.correlation > _FITS}
    several = len(here) > 2  # of two nobody says which is late
    onsets = {k: _onset(one, k) if several else (np.nan, np.nan) for k in here}
    rolls = {k: late for k in here if (late := _late(one, k)) is not None} if several else {}
    found = {}
    for axle in here:
        apart = _apart(own, lags, axle) if len(lags) > 1 or search.axles == 1 else np.nan
        begun = [onsets[axle][i] - _median([value[i] for k, value in onsets.items() if k != axle]) for i in (0, 1)]
        onset = min(begun, key=abs)  # a brake that rises more slowly than the others is not late
        nothing = (np.nan, np.nan, np.nan, np.nan)
        wheel, error, torque, torque_error = rolls.get(axle, nothing) if len(rolls) > 2 else nothing
        others = [abs(np.array(late)) for k, late in rolls.items() if k != axle]
        error = float(np.hypot(error, _scatter([one[0] for one in others])))
        torque_error = float(np.hypot(torque_error, _scatter([one[2] for one in others])))
        found[axle] = _Witnesses(apart, onset, wheel, error, torque, torque_error)
    return found


def _apart(own: list[OwnBalance | None], lags: dict[int, float], axle: int) -> float:
    """Return by how much a torque is late beside its wheel [s], less the others' median; 0: may be chance, nan: unseen.

    Where contact forces change about as fast as the brakes, lags are off on sound wheels: then the others' usual lag leaves
    hardly more of the torque than their own balances leave of theirs.
    """
    mine = own[axle]
    if axle not in lags or mine is None:
        return np.nan
    usual = _median([lag for k, lag in lags.items() if k != axle]) if len(lags) > 1 else 0.0
    leave = [one.left() for k, one in enumerate(own) if one is not None and k in lags]
    return lags[axle] - usual if mine.left(usual) > _MORE * max(float(np.median(leave)), _LEAST_LEFT) else 0.0


def _onset(one: Traces, axle: int) -> tuple[float, float]:
    """Return when a torque first passes a share of its largest [s], and when it begins by a straight line through half of it.

    Both nan where it does so from the start.
    """
    torque = one.torque[:, axle] - float(np.median(one.torque[: max(round(0.3 / one.step), 1), axle]))
    inside = one.good | (np.arange(len(torque)) < np.argmax(one.good))
    least = _APPLIES * float(torque[inside].max(initial=0.0))
    passed = []
    for level in (least, 0.5 * least):
        after = np.flatnonzero(torque > level)
        if level <= 0.0 or not after.size or after[0] * one.step < 0.3:
            return np.nan, np.nan
        i = int(after[0])
        passed.append(float(one.time[i] - one.step * (torque[i] - level) / max(torque[i] - torque[i - 1], 1e-9)))
    return passed[0], 2.0 * passed[1] - passed[0]


def _late(one: Traces, axle: int) -> tuple[float, float, float, float] | None:
    """Return the delay of an axle's wheel and its error, and those of its torque, in one run [s]."""
    coarse = _coarse_wheel(one, axle)
    compared = rolled(one, axle, coarse)
    if compared is None:
        return None
    values, deviations = compared.solved()
    if abs(values[TORQUE_LATE]) > LONGEST_S + _SURE * deviations[TORQUE_LATE]:
        return None  # no logger is so late: the linear model does not hold in this run
    # Where brakes bite fast the creepage is not in proportion: its gain then looks wrong, and so does the delay.
    error = float(np.hypot(_FLOOR_S, _FORM * (abs(values[GAIN]) + deviations[GAIN])))
    return coarse + float(values[WHEEL_LATE]), error, float(values[TORQUE_LATE]), float(deviations[TORQUE_LATE])


def _coarse_wheel(one: Traces, axle: int) -> float:
    """Return a delay of a wheel [s] in coarse steps: 0 unless another makes it go far better with the others."""
    index = np.flatnonzero(rolling(one, [k for k in range(one.axles) if k != axle]))
    furthest = round(LONGEST_S / one.step)
    index = index[(index >= furthest) & (index < len(one.time) - furthest)]
    if len(index) * one.step < _LONG_S:
        return 0.0
    turning = np.median(np.delete(one.smooth_wheel, axle, axis=1)[index], axis=1)
    size = {}
    for shift in range(-furthest, furthest + 1, max(round(_COARSE_S / one.step), 1)):
        ratio = one.smooth_wheel[index + shift, axle] / turning
        size[shift] = float(np.median(np.abs(ratio - np.median(ratio))))
    best = min(size, key=size.__getitem__)
    return best * one.step if size[best] < _SMOOTHER * size[0] else 0.0


def _scatter(others: list[float]) -> float:
    """Return the deviation that as many others' values say, which should be none; 0 where there are none."""
    return 1.5 * _median(others) if np.isfinite(others).any() else 0.0


def _median(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan


def _shared(values: list[float]) -> float:
    """Return what several runs have in common: of two the smaller, nan where only one of several says anything."""
    known = sorted((value for value in values if np.isfinite(value)), key=abs)
    return known[(len(known) - 1) // 2] if len(known) > 1 or (known and len(values) == 1) else np.nan


def _weighed(values: list[tuple[float, float]]) -> tuple[float, float, float]:
    """Return the mean of values with errors, its error, and the factor by which these are too small, at least 1.

    The factor is what the values' scatter asks for (R. T. Birge, Physical Review 40, 1932). Of none the mean is nan.
    """
    known = np.array([one for one in values if np.isfinite(one).all()]).reshape(-1, 2)
    if not len(known):
        return np.nan, np.inf, 1.0
    weights = known[:, 1] ** -2.0
    mean, error = float(weights @ known[:, 0] / weights.sum()), float(weights.sum() ** -0.5)
    missed = float(weights @ (known[:, 0] - mean) ** 2) / max(len(known) - 1, 1)
    return mean, error, max(1.0, missed**0.5)
