"""The quality of one recorded channel: what it is like, what is broken, and repair of what can be repaired.

Nothing is repaired in silence: every repair comes with a sentence that says what and where, and the samples concerned are
marked, so that they are never compared with the law.
"""

import dataclasses

import numpy as np

from wsp_env.recordings.channels import channel
from wsp_env.recordings.clock import LONGEST_GAP_S, MOST_REPAIRED, Clock
from wsp_env.recordings.errors import CampaignError

_ABSURD = 1e12  # in SI, no value of any channel in whatever unit: a damaged file's
_SPIKE_S = 0.1  # an impossible excursion up to this long is a fault whatever it looks like; a longer one if it is constant
_SIGMAS = 12.0  # an excursion must stand out of the noise this far
_TAIL = 0.1, 0.03  # shares of a channel's bends from which their tail is known: a few spikes are not in the second
_CHANCE = 1e-3  # probability that the course of a sound speed is taken for a spike (assumption, where its tail is exponential)
_HELD_S = 0.3  # a noisy channel that repeats one value for so long is saturated or frozen
_HELD_SAMPLES = 20
_NOISY = 5e-5  # noise below this share of the range is that of a simulation or of rounding, whose values may repeat
_BLIND = 0.15  # share of the largest value below which a sensor may read nothing (assumption: 10 to 25 km/h)
_MANY_JUMPS = 0.01  # share of samples: so many jumps are no faults but the channel's nature
_BLOCKS, _BLOCK = 20, 10_000  # noise and resolution are estimated on up to so many stretches of so many samples


@dataclasses.dataclass(frozen=True)
class Quality:
    """What a channel is like."""

    noise: float  # standard deviation of white noise, from third differences (robust)
    resolution: float  # smallest difference between two neighbours that differ; 0 for a constant channel
    lowest: float
    highest: float


def describe(values: np.ndarray) -> Quality:
    """Estimate noise, resolution and range of a channel (n,); nan are left out."""
    finite = values[np.isfinite(values)] if np.isnan(np.min(values)) else values
    blocks = _stretches(finite)
    steps = np.abs(np.concatenate([np.diff(block) for block in blocks]))
    moving = steps[steps > 0.0]
    # Rounding of the numbers themselves is no resolution: 1e-9 of the range is the least that counts.
    span = float(finite.max() - finite.min()) if finite.size else 0.0
    moving = moving[moving > 1e-9 * span]
    resolution = float(moving.min()) if moving.size else 0.0
    lowest, highest = (float(finite.min()), float(finite.max())) if finite.size else (np.nan, np.nan)
    return Quality(_noise(blocks), resolution, lowest, highest)


def repair(values: np.ndarray, name: str, clock: Clock, where: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Repair a channel (n,) in SI on its clock's grid: bridge missing samples and impossible excursions.

    Parameters
    ----------
    name : of the channel, see `channels.CHANNELS`
    clock : its clock, whose gaps have been reported already
    where : file and column, with which messages begin

    Returns
    -------
    values, which samples are not as recorded or not to be trusted (n,) bool, and what was found, sentence by sentence

    Raises
    ------
    CampaignError
        for a channel without numbers, or with more missing than can be bridged

    """
    notes: list[str] = []
    bad = ~(np.abs(values) < _ABSURD)
    if bad.all():
        raise CampaignError(
            f"{where}: no sample is a number; correct it, or leave out a dead axle by missing_axles in campaign.toml"
        )
    if bad.any():
        if (unread := bad & ~clock.absent).any():
            absurd = f" or with one beyond {_ABSURD:g}" if np.isfinite(values[unread]).any() else ""
            notes.append(f"{where}: {unread.sum()} samples without a number{absurd}, {_where(unread, clock)}; bridged")
        values = _bridged(values, bad)
    noise = _noise(_stretches(values))
    spikes, whole = _excursions(values, name, max(channel(name).fastest * clock.step_s, _SIGMAS * noise), clock, where, notes)
    if spikes.any():
        notes.append(
            f"{where}: {spikes.sum()} samples jump faster than physically possible and back, {_where(spikes, clock)}; bridged"
        )
        bad |= spikes
        values = _bridged(values, bad)
    if "speed" in name and (lone := _lone(values, _SIGMAS * noise)).any():
        notes.append(f"{where}: {lone.sum()} samples stand out of their neighbours, {_where(lone, clock)}; bridged")
        bad |= lone
        values = _bridged(values, bad)
    _check_bridges(bad, clock, where)
    command = np.isinf(channel(name).fastest)  # it keeps its value as long as the valve stays
    if not command and noise > _NOISY * float(np.ptp(values)) and (held := _held(values, clock.step_s) & ~bad).any():
        notes.append(f"{where}: {held.sum()} samples repeat one value, saturated or frozen, {_where(held, clock)}; not used")
        bad |= held
    return values, bad if whole else np.ones(len(values), dtype=bool), notes


def _stretches(values: np.ndarray) -> list[np.ndarray]:
    starts = np.linspace(0, max(len(values) - _BLOCK, 0), _BLOCKS if len(values) > _BLOCK * _BLOCKS else 1).astype(int)
    length = _BLOCK if len(starts) > 1 else len(values)
    return [values[start : start + length] for start in starts]


def _noise(blocks: list[np.ndarray]) -> float:
    """Return the standard deviation of white noise.

    Third differences take away any smooth course; 20 is the sum of their weights' squares.
    """
    thirds = np.abs(np.concatenate([np.diff(block, n=3) for block in blocks]))
    return float(np.median(thirds) / (0.6745 * np.sqrt(20.0))) if thirds.size else 0.0


def _excursions(
    values: np.ndarray, name: str, threshold: float, clock: Clock, where: str, notes: list[str]
) -> tuple[np.ndarray, bool]:
    """Return the samples between a jump larger than the threshold and the jump back, and whether the others can be trusted."""
    marked: np.ndarray = np.zeros(len(values), dtype=bool)
    whole = True
    if not np.isfinite(threshold):
        return marked, whole
    steps = np.diff(values)
    jumps = np.flatnonzero(np.abs(steps) > threshold)
    if len(jumps) > max(_MANY_JUMPS * len(values), 20):
        notes.append(
            f"{where}: {len(jumps)} jumps faster than physically possible, the first in {clock.row(int(jumps[0]) + 1)}; kept, "
            "not compared with the law"
        )
        return marked, False
    edge = max(round(_SPIKE_S / clock.step_s), 1)
    done = -1
    for i, start in enumerate(jumps):
        if start <= done:
            continue
        end = next((int(end) for end in jumps[i + 1 :] if _returns(values, int(start), int(end), threshold, clock.step_s)), -1)
        if end >= 0:
            marked[start + 1 : end + 1] = True
            done = end
        elif start < edge:
            marked[: start + 1] = True
        elif start >= len(values) - 1 - edge:
            marked[start + 1 :] = True
        else:
            trusted = _may_be(values, int(start), name, clock.step_s)
            row, fate = clock.row(int(start) + 1), "kept" if trusted else "kept, not compared with the law"
            notes.append(f"{where}: jumps by {steps[start]:g} in {row} and stays there; {fate}")
            whole &= trusted
    return marked, whole


def _lone(values: np.ndarray, least: float) -> np.ndarray:
    """Return the single samples (n,) bool that no course explains: inertia keeps a speed from a jump in one sample and back.

    A channel's own bends say how far a sample may be from the middle of its neighbours: their tail, taken as exponential from
    the 90 % and the 97 % quantile, and not less than `least`. Coarsely sampled, this is far less than what physics allows.
    """
    lone: np.ndarray = np.zeros(len(values), dtype=bool)
    if len(values) < _HELD_SAMPLES:
        return lone
    bends = np.abs(_bends(values))
    usual, rare = np.quantile(bends, 1.0 - np.array(_TAIL))
    limit = max(least, rare + (rare - usual) / np.log(_TAIL[0] / _TAIL[1]) * np.log(_TAIL[1] * len(bends) / _CHANCE))
    found = [int(i) + 1 for i in np.flatnonzero(bends > limit) if bends[i] == bends[max(i - 1, 0) : i + 2].max()]
    for i in found if len(found) <= max(_MANY_JUMPS * len(values), 1.0) else ():
        near = values[max(i - 2, 0) : i + 3].copy()
        near[min(i, 2)] = 0.5 * (values[i - 1] + values[i + 1])
        lone[i] = np.abs(_bends(near)).max() <= limit  # a step still bends without it
    return lone


def _bends(values: np.ndarray) -> np.ndarray:
    """Return the distances (n - 2,) of samples from the middle of their neighbours."""
    result: np.ndarray = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    return result


def _may_be(values: np.ndarray, start: int, name: str, step_s: float) -> bool:
    """Whether a jump after `start` has a reason that spoils nothing else.

    A sensor reads nothing below some low speed, as of a wheel that locks or turns again, or from there on; one was frozen
    before. A jump to zero from a higher speed is that of a sensor that failed.
    """
    slow = float(np.abs(values[start : start + 2]).max()) <= _BLIND * float(np.abs(values).max())
    locks = slow and "wheel_speed" in name and 0.0 in values[start : start + 2]
    ends = slow and not values[start + 1 :].any()
    frozen = _held(values[max(start - round(2.0 * _HELD_S / step_s), 0) : start + 1], step_s)[-1:].any()
    return bool(locks or frozen or ends)


def _returns(values: np.ndarray, start: int, end: int, threshold: float, step_s: float) -> bool:
    duration = (end - start) * step_s
    if duration > LONGEST_GAP_S or abs(values[end + 1] - values[start]) > threshold * (1.0 + 0.2 * (end - start)):
        return False
    return duration <= _SPIKE_S + 0.5 * step_s or float(np.ptp(values[start + 1 : end + 1])) == 0.0


def _held(values: np.ndarray, step_s: float) -> np.ndarray:
    """Return samples in long stretches of one value other than zero (a wheel may be locked, a brake released)."""
    least = max(round(_HELD_S / step_s), _HELD_SAMPLES)
    held: np.ndarray = np.zeros(len(values), dtype=bool)
    same = values[1:] == values[:-1]
    if same.sum() < least:
        return held
    for start, end in _runs(same):
        if end - start >= least and values[start] != 0.0:
            held[start : end + 1] = True
    return held


def _check_bridges(bad: np.ndarray, clock: Clock, where: str) -> None:
    if not bad.any():
        return
    runs = _runs(bad)
    start, end = max(runs, key=lambda run: run[1] - run[0])
    if (end - start) * clock.step_s > LONGEST_GAP_S:
        raise CampaignError(
            f"{where}, {clock.row(start)}: {end - start} samples in a row are missing or impossible; more "
            f"than {LONGEST_GAP_S:g} s cannot be bridged: cut the run there or map another column"
        )
    if bad.mean() > MOST_REPAIRED:
        raise CampaignError(
            f"{where}: {bad.sum()} of {len(bad)} samples are missing or impossible, the first {clock.row(start)}; map another"
        )


def _bridged(values: np.ndarray, bad: np.ndarray) -> np.ndarray:
    good = np.flatnonzero(~bad)
    repaired = values.copy()
    repaired[bad] = np.interp(np.flatnonzero(bad), good, values[good])
    return repaired


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return starts and ends (exclusive) of the stretches where the mask holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _where(mask: np.ndarray, clock: Clock) -> str:
    first, last = (int(np.flatnonzero(mask)[end]) for end in (0, -1))
    return f"in {clock.row(first)}" if first == last else f"from {clock.row(first)} to {clock.row(last)}"
