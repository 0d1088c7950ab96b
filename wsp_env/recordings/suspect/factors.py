"""Torques that are recorded by a factor too large or too small: in another unit, per wheel, halved.

An axle's level while all wheels roll says how its brake differs from the others'; only the vehicle's momentum and the wheel's
own balance and creepage say whether the brake does so or the channel alone. A brake that truly brakes less is physics.
"""

import numpy as np

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.momentum import axle_gain
from wsp_env.recordings.suspect.rolled import GAIN, rolled
from wsp_env.recordings.suspect.search import Search, agreed, named, with_column
from wsp_env.recordings.suspect.traces import Traces, rolling

#: Recorded over true -> what was recorded.
_UNITS = {
    1e-3: "kN*m", 1e3: "N*mm", 0.7375621: "lbf*ft", 0.1019716: "kgf*m", 8.850746: "lbf*in", 0.5: "one of two wheels' torque",
    2.0: "twice the torque", 1.355818: "N*m taken for lbf*ft", 9.80665: "N*m taken for kgf*m",
    0.1382550: "lbf*ft taken for kgf*m", 0.1129848: "N*m taken for lbf*in", 7.233014: "kgf*m taken for lbf*ft",
}  # fmt: skip
_REAL_UNITS = ("kN*m", "N*mm", "lbf*ft", "kgf*m", "lbf*in")
_BRAKES = 0.22  # log of the ratio between brakes of one vehicle, at most: gains within 15 %, some more while they fill
_NEAR = 0.12  # to a unit's factor [-]: gains and filling times differ by so much
_BEYOND = 1.4  # log of a ratio that no working brakes have between them: four
_FOLLOWS = 0.7  # correlation of a torque that follows the others': it is alive
_WHOLE = 0.06  # log of the momentum that all torques' common factor leaves: masses are known to some 3 %
_STEADY = 0.04  # log of its scatter between runs: forces that no torque holds change it with the deceleration
_AGREE = 0.5  # log of a factor between rolling and the whole run: friction differs between axles by so much
_APART = 4.0  # deviations between two gains that are told apart: their middle is two from either
_APPLIED = 0.3  # of a run's largest torque
_LEAST_S = 0.2


def find(search: Search) -> None:
    """Find and mend factors: of single axles, then of all torques together."""
    _single_axles(search)
    _all_axles(search)


def level(one: Traces, axle: int, here: list[int]) -> tuple[float, float, bool]:
    """Return an axle's torque over the others' median while all roll and brake, their correlation, and whether they rolled.

    A wheel that slides is vented, which is no fault of its channel. Where they hardly roll while braking, the ratio is that of
    the whole run, which friction changes too; nan of a single axle.
    """
    others = [k for k in here if k != axle]
    if not others:
        return np.nan, np.nan, False
    usual = np.median(one.torque[:, others], axis=1)
    index = np.flatnonzero(rolling(one, here) & (usual > _APPLIED * float(usual.max())))
    rolls = len(index) * one.step >= _LEAST_S
    whole = one.good
    everywhere = _over(usual[whole], one.torque[whole, axle])
    follows = np.corrcoef(usual[whole], one.torque[whole, axle])[0, 1] if np.ptp(one.torque[whole, axle]) > 0.0 else 0.0
    ratio = _over(usual[index], one.torque[index, axle]) if rolls else everywhere
    # A torque that is late is small while the others roll, but not in the whole run.
    agree = everywhere > 0.0 and ratio > 0.0 and abs(np.log(ratio / everywhere)) < _AGREE
    return ratio if agree else np.nan, float(follows), rolls


def _over(usual: np.ndarray, torque: np.ndarray) -> float:
    """Return the best factor between two torques (n,)."""
    return float(usual @ torque) / max(float(usual @ usual), 1e-12)


def _single_axles(search: Search) -> None:
    for axle in range(search.axles):
        seen = {name: value for name in search.traces() if np.isfinite(value := _factor(search, name, axle))}
        size = agreed(seen)
        if not seen or _one_of_many(search, axle, size, len(seen)):
            continue
        factor, words = named("", _UNITS, size, _NEAR)
        channel = f"axle{axle + 1}_brake_torque"
        recorded = f": recorded in {words}" if words in _REAL_UNITS else f": {words}" if words else ""
        remedy = f'give {channel} unit = "{words}" in [channels]' if words in _REAL_UNITS else _scaled(channel, factor, size)
        search.report(
            SuspectChannel(
                channel,
                f"{size:.3g} times what its own wheel and the other axles ask for{where(seen, search.runs)}{recorded}",
                remedy, "factor", axle + 1, size, tuple(seen),
            )
        )  # fmt: skip
        for name, value in seen.items():
            torque = search.runs[name].brake_torque_nm
            search.mend(name, brake_torque_nm=with_column(torque, axle, torque[:, axle] / value))


def _one_of_many(search: Search, axle: int, size: float, seen: int) -> bool:
    """Return whether most runs with the same level of an axle's torque do not show that it is wrong: then its brake differs."""
    levels = [level(one, axle, search.sound(name))[0] for name, one in search.traces().items() if axle in search.sound(name)]
    alike = sum(abs(np.log(one / size)) < np.log1p(_NEAR) for one in levels if one > 0.0)
    return 2 * seen <= alike


def _scaled(channel: str, factor: float, size: float) -> str:
    return f"give {channel} scale = {1.0 / (factor if np.isfinite(factor) else size):.4g} in [channels]"


def _factor(search: Search, name: str, axle: int) -> float:
    """Return recorded over true torque of an axle (from 0) in a run; nan where the channel may be right."""
    one, here = search.traces()[name], search.sound(name)
    if axle not in here:
        return np.nan
    ratio, follows, rolls = level(one, axle, here)
    if not ratio > 0.0 or abs(np.log(ratio)) < _BRAKES:
        return np.nan
    if abs(np.log(ratio)) > _BEYOND:
        return ratio if follows > _FOLLOWS else np.nan
    slowed = _slowed(search, name, axle, ratio)
    if not rolls:
        factor = next((one for one in (slowed, _slope(search, name, axle)) if one > 0.0), np.nan)
        return factor if abs(np.log(factor / ratio)) < _BRAKES < abs(np.log(factor)) else np.nan
    witnesses = (slowed, _slope(search, name, axle), _creepage(one, axle), _momentum(search, name, axle, ratio))
    votes = [vote for vote in witnesses if vote > 0.0]
    # The first that is known decides: they come in the order of what they are worth.
    if not votes or abs(np.log(votes[0] / ratio)) > abs(np.log(votes[0])):
        return np.nan
    return ratio


def _slowed(search: Search, name: str, axle: int, ratio: float) -> float:
    """Return the factor by which the vehicle slows less than the torque promises; nan where 1 and `ratio` are not told apart.

    The runs in which the axle's level is the same speak together.
    """
    gains = [axle_gain(search.runs[name], search.campaign.vehicle, axle)]
    for other, one in search.traces().items():
        here = search.sound(other)
        if other != name and axle in here and abs(np.log(max(level(one, axle, here)[0], 1e-9) / ratio)) < _NEAR:
            gains.append(axle_gain(search.runs[other], search.campaign.vehicle, axle))
    values, deviations = np.array([one for one in gains if np.isfinite(one[0])]).reshape(-1, 2).T
    if not len(values):
        return np.nan
    weights = deviations**-2.0
    gain = float(weights @ values / weights.sum())
    return 1.0 / gain if gain > 0.1 and _APART / np.sqrt(weights.sum()) < abs(1.0 / ratio - 1.0) else np.nan


def _slope(search: Search, name: str, axle: int) -> float:
    """Return the factor that the wheel's own balance gives beside the others'; nan where it says nothing."""
    balances = search.own_balances()[name]
    mine, others = balances[axle], [one.slope for k, one in enumerate(balances) if one is not None and k != axle]
    if mine is None or mine.correlation < 0.8 or not others:
        return np.nan
    return mine.slope / float(np.median(others))


def _creepage(one: Traces, axle: int) -> float:
    """Return the factor that the wheel's creepage while rolling gives; nan where that is not seen to a quarter."""
    compared = rolled(one, axle)
    if compared is None:
        return np.nan
    values, deviations = compared.solved()
    gain = 1.0 + float(values[GAIN])  # true over recorded
    return 1.0 / gain if gain > 0.1 and deviations[GAIN] < 0.1 * gain else np.nan


def _momentum(search: Search, name: str, axle: int, ratio: float) -> float:
    """Return `ratio` where it brings the run's momentum nearer to the other runs', 1 where not, nan where neither."""
    others = agreed({other: search.explained(other) for other in search.runs if other != name})
    torque = search.runs[name].brake_torque_nm
    before, after = search.explained(name), search.explained(name, with_column(torque, axle, torque[:, axle] / ratio))
    if not (others > 0.0 and before > 0.0 and after > 0.0) or abs(np.log(after / before)) < _STEADY:
        return np.nan
    return ratio if abs(np.log(after / others)) < 0.5 * abs(np.log(before / others)) else 1.0


def _all_axles(search: Search) -> None:
    """Find a factor of all torques: of the whole campaign, or of single runs beside the others."""
    momenta = {name: value for name in search.runs if (value := search.explained(name)) > 0.0}
    usual = agreed(momenta)
    if not momenta or not usual > 0.0:
        return
    factor, words = named("", _UNITS, 1.0 / usual, _NEAR)
    scatter = float(np.median([abs(np.log(value / usual)) for value in momenta.values()]))
    if words and abs(np.log(usual * factor)) < _WHOLE and scatter < _STEADY and _slopes_agree(search, factor):
        _tell_all(search, factor, words, list(search.runs))
        return
    for name, value in momenta.items():
        factor, words = named("", _UNITS, usual / value, _NEAR)
        if len(momenta) > 2 and words and abs(np.log(value * factor / usual)) < _NEAR and _slopes_agree(search, factor, name):
            _tell_all(search, factor, words, [name])


def _slopes_agree(search: Search, factor: float, only: str = "") -> bool:
    """Whether the wheels' own balances ask for the factor as well, or say nothing, which is not enough for `only` one run.

    In one run without slides a brake that drags, a gradient or a mass loses as much momentum.
    """
    balances = search.own_balances()
    chosen = [one.slope for name, several in balances.items() if only in ("", name) for one in several if one is not None]
    if not chosen:
        return not only
    return abs(np.log(max(float(np.median(chosen)), 1e-9) / factor)) < abs(np.log(factor)) / 2.0


def _or_the_mass(search: Search, names: list[str]) -> str:
    """Say that it may be the mass, where all runs agree: the vehicle's momentum alone does not tell both apart."""
    return ", or a wrong mass_kg" if len(names) == len(search.runs) else ""


def _tell_all(search: Search, factor: float, words: str, names: list[str]) -> None:
    unit = words in _REAL_UNITS
    remedy = (
        f'give every brake torque unit = "{words}" in [channels]' if unit else _scaled("every brake torque", factor, factor)
    )
    search.report(
        SuspectChannel(
            "axle*_brake_torque",
            f"{factor:.4g} times what the loss of momentum asks for{where(names, search.runs)}: {words}"
            + _or_the_mass(search, names),
            remedy, "factor", 0, factor, tuple(names),
        )
    )  # fmt: skip
    for name in names:
        search.mend(name, brake_torque_nm=search.runs[name].brake_torque_nm / factor)
