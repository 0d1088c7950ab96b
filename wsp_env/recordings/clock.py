"""Clocks of recordings: repairing them, and bringing channels to a common one without aliasing."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline

from wsp_env.compiled import kernel
from wsp_env.recordings.errors import CampaignError

#: Longest gap [s] that is bridged; what was bridged is never compared with the law. Assumption: the wheel slides on in about
#: the same way for that long, so that the filter's neighbourhood of the gap is all that is lost.
LONGEST_GAP_S = 1.0

#: A sample may stand this share of a step beside its place on an even clock: rounded times of a logger.
JITTER = 0.1

#: Share of a file's rows that may be repaired before it counts as unusable.
MOST_REPAIRED = 0.2

_FEW_ROWS = 10  # so many rows, or a hundredth of all, may stand in the wrong order or twice
_PASS_BAND = 0.8  # cut-off of the anti-aliasing filter as a share of the new Nyquist frequency
_HALF_WIDTH = 8  # lobes of the sinc on each side under the Hann window
_EVEN = 1e-6  # of a step: deviations below are of rounding
_TABLE = 512  # tabulated points per lobe; linear between them: error below 1e-5


@dataclasses.dataclass(frozen=True)
class Clock:
    """A repaired clock: which rows of the file it keeps, and where they stand on its even steps."""

    time_s: np.ndarray  # (m,) of the kept rows, rising
    step_s: float
    kept: np.ndarray | None  # (m,) rows of the file, None: all in order
    slots: np.ndarray | None  # (m,) number of each row's step on the even clock; None: it is not even
    rows: int  # in the file
    first_line: int = 2  # of the file that holds the first row, where the file is text

    @property
    def grid_s(self) -> np.ndarray:
        """Times of all even steps, those without a row included."""
        if self.slots is None or self.slots[-1] == len(self.slots) - 1:
            return self.time_s
        grid: np.ndarray = self.time_s[0] + self.step_s * np.arange(self.slots[-1] + 1)
        grid[self.slots] = self.time_s
        return grid

    @property
    def absent(self) -> np.ndarray:
        """Which samples of `grid_s` have no row in the file, bool."""
        mask: np.ndarray = np.zeros(len(self.grid_s), dtype=bool)
        if self.slots is not None:
            mask[:] = True
            mask[self.slots] = False
        return mask

    def row(self, sample: int) -> str:
        """Name the file's row of a sample of `grid_s` (of the next one where it has none)."""
        position = sample if self.slots is None else int(np.searchsorted(self.slots, sample))
        return row(position if self.kept is None else int(self.kept[position]), self.first_line)

    def lay(self, values: np.ndarray) -> np.ndarray:
        """Lay a channel's rows on `grid_s`; nan where there is no row."""
        if self.kept is not None:
            values = values[self.kept]
        if self.slots is None or self.slots[-1] == len(self.slots) - 1:
            return values
        grid = np.full(self.slots[-1] + 1, np.nan)
        grid[self.slots] = values
        return grid


def repair(time_s: np.ndarray, where: str, first_line: int = 2) -> tuple[Clock, list[str]]:
    """Repair a clock [s] (n,): leave out rows without time and doubled ones, sort a few that are out of order.

    Parameters
    ----------
    where : file and column, with which messages begin
    first_line : of the file that holds the first row, see `Table`

    Raises
    ------
    CampaignError
        naming the row, for a clock that cannot be repaired without guessing

    """
    rows = len(time_s)
    notes: list[str] = []
    known = np.isfinite(time_s)
    if not known.any():
        raise CampaignError(f"{where}: no row has a number for its time; export it in seconds, or map another column to time")
    kept = np.flatnonzero(known & ~_out_of_line(time_s)) if known.sum() > 1 else np.zeros(0, dtype=int)
    if len(kept) < max((1.0 - MOST_REPAIRED) * rows, 3):
        raise CampaignError(f"{where}: only {len(kept)} of {rows} rows have a time that fits their neighbours'")
    if len(kept) < rows:
        missing = np.setdiff1d(np.arange(rows), kept, assume_unique=True)
        notes.append(f"{where}: {_rows(missing, first_line)} without a time that fits the neighbours' left out")
    time = time_s[kept]
    step = float(np.median(np.diff(time)))
    if not step > 0.0:
        raise CampaignError(f"{where}: the clock stands still or runs backwards in most rows; map the right column to time")
    few = max(_FEW_ROWS, rows // 100)
    if (np.diff(time) < 0.0).any():
        kept, time = _sorted(kept, time, step, few, where, notes, first_line)
    doubled = np.flatnonzero(np.diff(time) < JITTER * step) + 1
    if len(doubled) > few:
        raise CampaignError(
            f"{where}: the clock repeats itself in {len(doubled)} rows, first in {row(kept[doubled[0]], first_line)}; "
            "export it with more decimals or map another column to time"
        )
    if len(doubled):
        notes.append(f"{where}: {_rows(kept[doubled], first_line)} doubled in time left out")
        kept, time = np.delete(kept, doubled), np.delete(time, doubled)
    steps = np.diff(time)
    widest = int(np.argmax(steps))
    if steps[widest] > max(LONGEST_GAP_S, 1.5 * step):
        raise CampaignError(
            f"{where}, {row(kept[widest + 1], first_line)}: the clock jumps from {time[widest]:g} s to {time[widest + 1]:g} s; "
            f"more than {LONGEST_GAP_S:g} s cannot be bridged: cut the run there"
        )
    counts = np.rint(steps / step).astype(np.int64)
    slots = np.concatenate([[0], np.cumsum(np.maximum(counts, 1))])
    step = float((time[-1] - time[0]) / slots[-1])
    even = bool((np.abs(time - time[0] - step * slots) < JITTER * step).all())
    if gaps := int((counts > 1).sum()):
        at = int(np.argmax(counts > 1))
        lost = int((counts[counts > 1] - 1).sum())
        notes.append(
            f"{where}: {lost} samples missing in {gaps} gap{'s' * (gaps > 1)}, the first after {row(kept[at], first_line)}; "
            "bridged"
        )
    whole = len(kept) == rows and bool((kept == np.arange(rows)).all())
    return Clock(time, step, None if whole else kept, slots if even else None, rows, first_line), notes


def _out_of_line(time: np.ndarray) -> np.ndarray:
    """Rows whose time does not lie between their neighbours', which are two even steps apart."""
    wrong: np.ndarray = np.zeros(len(time), dtype=bool)
    if len(time) > 4:
        steps = np.diff(time)
        step = np.nanmedian(steps)
        with np.errstate(invalid="ignore"):
            apart = np.abs(steps[1:] + steps[:-1] - 2.0 * step) < 0.5 * step
            wrong[1:-1] = apart & (np.abs(steps[:-1] - step) > 1.5 * step)
    return wrong


def _sorted(
    kept: np.ndarray, time: np.ndarray, step: float, few: int, where: str, notes: list[str], first_line: int
) -> tuple[np.ndarray, np.ndarray]:
    back = int(np.argmax(np.diff(time) < 0.0)) + 1
    order = np.argsort(time, kind="stable")
    moved = order != np.arange(len(order))
    gaps = np.diff(time[order])
    if moved.sum() > few or ((gaps > JITTER * step) & (gaps < 0.5 * step)).any():
        raise CampaignError(
            f"{where}, {row(kept[back], first_line)}: the clock runs backwards, from {time[back - 1]:g} s to {time[back]:g} s; "
            "cut the run there or map another column to time"
        )
    notes.append(f"{where}: {_rows(kept[np.flatnonzero(moved)], first_line)} in the wrong order, sorted by time")
    return kept[order], time[order]


def resample(time_s: np.ndarray, values: np.ndarray, targets_s: np.ndarray, hold: bool = False) -> np.ndarray:
    """Bring a channel (n,) to other times (m,); both rise, the targets evenly and inside the channel's.

    To a slower clock through a low-pass that leaves no delay (windowed sinc, cut-off at 0.8 of the new Nyquist frequency), to a
    faster or shifted one by a cubic spline. `hold` keeps the last value instead, as for commands.
    """
    if hold:
        held: np.ndarray = values[np.maximum(np.searchsorted(time_s, targets_s, side="right") - 1, 0)]
        return held
    every, source = _every(time_s, targets_s)
    target = every * source
    if not every:
        source, target = (float(np.median(np.diff(t))) for t in (time_s, targets_s))
    if source > _PASS_BAND * target:
        spline: np.ndarray = CubicSpline(time_s, values)(targets_s)
        return spline
    width = target / _PASS_BAND
    reach = _HALF_WIDTH * width
    lobes = np.arange(_HALF_WIDTH * _TABLE + 2) / _TABLE
    table = np.sinc(lobes) * np.where(lobes < _HALF_WIDTH, np.cos(0.5 * np.pi * lobes / _HALF_WIDTH) ** 2, 0.0)
    # Mirrored about the end points, a ramp goes on as a ramp.
    ahead = int(min(np.searchsorted(time_s, time_s[0] + reach) + 1, len(time_s) - 1))
    behind = int(max(np.searchsorted(time_s, time_s[-1] - reach) - 1, 0))
    padded = np.concatenate([2 * values[0] - values[ahead:0:-1], values, 2 * values[-1] - values[-2:behind:-1]])
    half = int(reach / source)
    if every and half <= min(ahead, len(time_s) - 2 - behind):
        taps = np.interp(np.abs(np.arange(-half, half + 1)) * source / width, lobes, table)
        first = ahead + round((targets_s[0] - time_s[0]) / source) - half
        return _thinned(padded[first:], taps / taps.sum(), every, len(targets_s))
    time = np.concatenate([2 * time_s[0] - time_s[ahead:0:-1], time_s, 2 * time_s[-1] - time_s[-2:behind:-1]])
    shares = np.gradient(time)  # rows that lie closer together count less
    return _filtered(time, padded * shares, shares, targets_s, width, table)


def _every(time: np.ndarray, targets: np.ndarray) -> tuple[int, float]:
    """Return n where the targets are every n-th time of an even clock, else 0; and the clock's mean step [s]."""
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    if not step > 0.0:
        return 0, step
    count = round((targets[-1] - targets[0]) / step / max(len(targets) - 1, 1))
    rows = round((targets[0] - time[0]) / step) + count * np.arange(len(targets))
    if rows[0] < 0 or rows[-1] >= len(time) or count < 1:
        return 0, step
    even = np.abs(np.diff(time) - step).max() < _EVEN * step and np.abs(time[rows] - targets).max() < _EVEN * step
    return (count if even else 0), step


def _thinned(values: np.ndarray, taps: np.ndarray, every: int, number: int) -> np.ndarray:
    """Return sums of the values weighted by the taps (symmetric), of windows that start at every so many values."""
    from scipy.signal import upfirdn  # here, as it takes longer to import than all the rest

    lead = -(len(taps) - 1) % every  # of zeros, so that the first whole window falls on a result
    sums = upfirdn(np.concatenate([np.zeros(lead), taps]), values, 1, every)
    first = (len(taps) - 1 + lead) // every
    found: np.ndarray = sums[first : first + number]
    return found


@kernel
def _filtered(
    time: np.ndarray, values: np.ndarray, shares: np.ndarray, targets: np.ndarray, width: float, table: np.ndarray
) -> np.ndarray:
    """Means of the values (times their shares) about each target, weighted by `table` over the distance in `width`."""
    result = np.empty(len(targets))
    reach = _HALF_WIDTH * width
    scale = _TABLE / width
    first = 0
    for j in range(len(targets)):
        target = targets[j]
        while first < len(time) - 1 and time[first] < target - reach:
            first += 1
        total = 0.0
        weights = 0.0
        i = first
        while i < len(time) and time[i] < target + reach:
            x = abs(time[i] - target) * scale
            k = int(x)
            weight = table[k] + (x - k) * (table[k + 1] - table[k])
            total += weight * values[i]
            weights += weight * shares[i]
            i += 1
        result[j] = total / weights
    return result


def spread(time_s: np.ndarray, bad: np.ndarray, targets_s: np.ndarray) -> np.ndarray:
    """Return which targets (m,) are touched by bad samples (n,) of a channel."""
    marks: np.ndarray = np.zeros(len(targets_s) + 1, dtype=np.int64)
    at = time_s[bad]
    if at.size:
        step = max(float(np.median(np.diff(t))) for t in (time_s, targets_s))
        np.add.at(marks, np.searchsorted(targets_s, at - step), 1)
        np.add.at(marks, np.searchsorted(targets_s, at + step, side="right"), -1)
    touched: np.ndarray = np.cumsum(marks[:-1]) > 0
    return touched


def row(index: int, first_line: int = 2) -> str:
    """Name a row as a person would look for it."""
    return f"row {index + 1} (line {index + first_line} of a CSV)"


def _rows(indices: np.ndarray, first_line: int) -> str:
    if len(indices) == 1:
        return row(int(indices[0]), first_line)
    return f"{len(indices)} rows, the first {row(int(indices[0]), first_line)},"
