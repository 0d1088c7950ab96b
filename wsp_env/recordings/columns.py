"""One recorded stop out of one file: channels found, converted to SI, repaired and brought to a common clock."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wsp_env.recordings import channels, clock, quality, units
from wsp_env.recordings.channels import Source
from wsp_env.recordings.clock import Clock
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers import open_file
from wsp_env.recordings.readers.channel_file import ChannelFile, Samples

_LEAST_SAMPLES = 4  # for one third difference
_LEAST_ALIKE = 2  # notes besides the first that say the same: from three on they are one line
_EVEN_SHARE = 0.9  # of the steps of a channel between blank cells that must be alike
_FINEST_S = 1e-6  # between samples: no logger of speeds takes a million a second
_LONGEST_S = 86400.0  # of a file: no stop lasts a day


@dataclasses.dataclass
class Columns:
    """Channels in SI on one clock of T even steps."""

    time_s: np.ndarray  # (T,)
    values: dict[str, np.ndarray]  # channel -> (T,)
    suspect: dict[str, np.ndarray]  # channel -> (T,) bool: repaired, or not to be trusted
    notes: list[str]  # what was repaired or looks wrong, sentence by sentence


def read_columns(
    file: Path,
    required: list[str],
    optional: list[str],
    mapping: Mapping[str, Source],
    sample_time_s: float,
    wheel_radius_m: float,
    alternatives: Sequence[list[str]] = (),
) -> Columns:
    """Read channels of one file.

    Parameters
    ----------
    required, optional : channels (`channels.CHANNELS`) that must, or may, be there
    mapping : where channels come from (`channels.parse`); the others have their native columns
    sample_time_s : step of the common clock [s]
    wheel_radius_m : for wheel speeds recorded as speeds of the circumference
    alternatives : further channels that must be there: those of the first list that the file has, else of the last one

    Raises
    ------
    CampaignError
        naming file, column and row, for what cannot be read or repaired

    """
    opened = open_file(file)

    def has(name: str) -> bool:
        return name in mapping or channels.native(name).column in opened.units

    if alternatives:
        required = [*required, *next((some for some in alternatives if all(map(has, some))), alternatives[-1])]
        optional = [name for name in optional if name not in required]
    _check_axles(opened, required, optional)
    sources = {name: mapping.get(name) or channels.native(name) for name in ["time", *required, *optional]}
    wanted = [name for name in required if name != "time"]
    opened.require([sources[name].column for name in ([] if opened.own_clocks else ["time"]) + wanted])
    wanted += [name for name in optional if has(name)]
    opened.require([sources[name].column for name in wanted])
    clocks = [column for name in wanted if (column := sources[name].time)]
    opened.require(clocks)
    time_columns = [] if opened.own_clocks else [sources["time"].column]
    raw = opened.read(list(dict.fromkeys([*time_columns, *clocks, *(sources[name].column for name in wanted)])))
    return _Reader(opened, sources, wheel_radius_m).gather(raw, wanted, sample_time_s)


def _check_axles(opened: ChannelFile, required: list[str], optional: list[str]) -> None:
    """Refuse native columns that speak of other axles than the vehicle has; those of missing ones may be there."""
    believed = {int(match[1]) for name in required if (match := re.match(r"axle(\d+)_", name))}
    missing = {int(match[1]) for name in optional if (match := re.match(r"axle(\d+)_", name))} - believed
    pattern = r"axle(\d{1,4})_(wheel_speed_radps|brake_torque_nm)$"
    seen = {int(match[1]) for name in opened.units if (match := re.match(pattern, name))}
    if seen and seen - missing != believed:
        raise CampaignError(
            f"{opened.file}: its columns speak of axles {', '.join(map(str, sorted(seen)))}, but campaign.toml says "
            f"[vehicle] axles = {len(believed | missing)}; correct the one or the other, or name axles without a sensor in "
            "missing_axles, of [vehicle] or of the run"
        )


class _Reader:
    """Brings the raw columns of one file to SI and to one clock."""

    def __init__(self, opened: ChannelFile, sources: dict[str, Source], wheel_radius_m: float):
        self.file, self.units, self.sources, self.radius = opened.file, opened.units, sources, wheel_radius_m
        self.first_line = opened.first_line
        self.notes: list[str] = []
        self._clocks: dict[str | int, Clock] = {}

    def gather(self, raw: dict[str, Samples], wanted: list[str], step_s: float) -> Columns:
        """Return the channels on a clock of even steps over the time that all of them cover."""
        self._part(raw, wanted)
        clocks = {name: self.clock(raw, name) for name in wanted}
        self._check_steps(clocks, step_s)
        first = clocks[wanted[0]]
        start = max(c.time_s[0] for c in clocks.values())
        end = min(c.time_s[-1] for c in clocks.values())
        if all(_fits(c, first.time_s[0], step_s) and len(c.grid_s) == len(first.grid_s) for c in clocks.values()):
            time = first.grid_s
        else:
            time = start + step_s * np.arange(int(np.floor((end - start) / step_s + clock.JITTER)) + 1)
            time = time[time <= end]
        if len(time) < _LEAST_SAMPLES:
            raise CampaignError(
                f"{self.file} has {len(time)} samples that all channels cover; at least {_LEAST_SAMPLES} are needed"
            )
        result = Columns(time, {}, {}, self.notes)
        for name in wanted:
            column = self.sources[name].column
            values = self.convert(name, raw[column].values)
            if sum(self.sources[other].column == column for other in wanted) == 1:
                del raw[column]  # a file may fill half the memory
            self._bring(name, values, clocks[name], step_s, result)
        result.notes = condensed(self.file, self.notes)
        return result

    def _part(self, raw: dict[str, Samples], wanted: list[str]) -> None:
        """Give channels of a table whose cells are blank at an even pace, each at its own rate, the clock of their rows."""
        sparse: dict[str, list[str]] = {}
        for name in wanted:
            column, time = self.sources[name].column, self.sources[name].time or self.sources["time"].column
            samples = raw[column]
            filled = np.isfinite(samples.values)
            if samples.time_s is not None or filled.mean() > 1.0 - clock.MOST_REPAIRED or len(raw[time].values) != len(filled):
                continue
            own = self.convert("time", raw[time].values, time)[filled]
            steps = np.diff(own)
            if len(steps) and np.mean(np.abs(steps - np.median(steps)) < clock.JITTER * abs(np.median(steps))) > _EVEN_SHARE:
                raw[column] = Samples(samples.values[filled], own)
                sparse.setdefault(f"{np.median(steps):.4g}", []).append(column)
        for step, columns in sparse.items():
            few = ", ".join(columns[:3]) + (", ..." if len(columns) > 3 else "")
            self.notes.append(
                f"{self.file}: cells of {few} are blank but every {step} s; read at that rate, other rows left out"
            )

    def _check_steps(self, clocks: dict[str, Clock], step_s: float) -> None:
        """Refuse clocks in another unit, and spans that no stop lasts."""
        for name, own in clocks.items():
            column = self.sources[name].time or self.sources["time"].column
            if channels.channel(name).required and not _FINEST_S <= own.step_s <= clock.LONGEST_GAP_S:
                unit = "ms" if own.step_s > clock.LONGEST_GAP_S else "min"
                raise CampaignError(
                    f"{self.file}, column {column}: a sample every {own.step_s:.3g} s says nothing of a slide; is the time in "
                    f'another unit? Give it, such as unit = "{unit}", to time in [channels]'
                )
            if own.time_s[-1] - own.time_s[0] > _LONGEST_S:
                raise CampaignError(
                    f"{self.file}, column {column}: the clock spans {own.time_s[-1] - own.time_s[0]:.3g} s; cut out the stop"
                )

    def clock(self, raw: dict[str, Samples], name: str) -> Clock:
        """Return the repaired clock of a channel; each is repaired once."""
        own = raw[self.sources[name].column].time_s
        column = self.sources[name].time or self.sources["time"].column
        key: str | int = column if own is None else hash(own.tobytes())
        if key not in self._clocks:
            where = f"{self.file}, column {column}" if own is None else f"{self.file}, clock of {self.sources[name].column}"
            time = own if own is not None else self.convert("time", raw[column].values, column)
            self._clocks[key], notes = clock.repair(time, where, self.first_line)
            self.notes += notes
        repaired = self._clocks[key]
        values = raw[self.sources[name].column].values
        if len(values) != repaired.rows:
            raise CampaignError(
                f"{self.file}: {self.sources[name].column} has {len(values)} samples, its clock {repaired.rows}; "
                "give the channel's own clock as `time` in [channels]"
            )
        return repaired

    def convert(self, name: str, values: np.ndarray, column: str | None = None) -> np.ndarray:
        """Return a channel's values in its own unit."""
        source = self.sources[name]
        stated = self.units.get(column or source.column, "")
        where = f"{self.file}, column {column or source.column}"
        unit = source.unit
        if unit is None:
            if not stated:
                raise CampaignError(f'{where}: neither the file nor [channels] says its unit; add unit = "..." to {name}')
            unit = stated
        factor = channels.factor(unit, name, self.radius, where) * source.scale
        if source.unit is not None and stated and units.is_unit(stated):
            self._compare(name, source.unit, stated, where)
        return values if factor == 1.0 else values * factor

    def _compare(self, name: str, given: str, stated: str, where: str) -> None:
        """Warn when the file states another unit than `[channels]`."""
        if stated in units.TURNS and given == "rpm":
            return
        try:
            same = abs(channels.factor(given, name, 1.0, where) / channels.factor(stated, name, 1.0, where) - 1.0) < 1e-9
        except CampaignError:
            same = False
        if not same:
            self.notes.append(f"{where}: the file states {stated!r}, [channels] {given!r}; taken as {given!r}")

    def _bring(self, name: str, values: np.ndarray, own: Clock, step_s: float, result: Columns) -> None:
        """Repair one channel and bring it to the common clock."""
        where = f"{self.file}, column {self.sources[name].column}"
        values, bad, notes = quality.repair(own.lay(values), name, own, where)
        result.notes += notes
        if channels.channel(name).unit == "" and not np.isin(values[~bad], (-1.0, 0.0, 1.0)).all():
            raise CampaignError(f"{where}: a valve command must be -1 (vent), 0 (hold) or 1 (apply)")
        grid = own.grid_s
        if len(grid) != len(result.time_s) or not _fits(own, result.time_s[0], step_s):
            clock_of = f"{self.file}" if len(self._clocks) == 1 else where
            note = f"{clock_of}: recorded every {own.step_s:.4g} s, brought to a clock of {step_s:g} s"
            if own.step_s > 1.5 * step_s:
                note += ", finer than what was recorded"
            if note not in result.notes:
                result.notes.append(note)
            values = clock.resample(grid, values, result.time_s, hold=channels.channel(name).unit == "")
            bad = clock.spread(grid, bad, result.time_s)
        result.values[name] = values
        result.suspect[name] = bad


def condensed(file: Path, notes: list[str]) -> list[str]:
    """Return notes of which those that say the same of several columns, but for numbers, are one line."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for note in notes:
        where, _, rest = note.removeprefix(f"{file}, ").partition(": ")
        named = note.startswith((f"{file}, column ", f"{file}, clock of ")) and rest
        kind = re.sub(r"[\d.]+(e-?\d+)?", "#", rest) if named else note
        groups.setdefault(kind, []).append((re.sub("^(column|clock of) ", "", where), note))
    found = []
    for group in groups.values():
        (first, note), others = group[0], len(group) - 1
        names = ", ".join(name for name, _ in group[:4]) + (", ..." if others > 3 else "")
        found.append(
            note
            if others < _LEAST_ALIKE
            else f"{file}: {others + 1} channels ({names}), such as {first}: {note.partition(': ')[2]}"
        )
    return [one for one in found if one]


def _fits(own: Clock, start_s: float, step_s: float) -> bool:
    """Whether a clock's even steps are those of the common one, within the jitter allowed."""
    if own.slots is None:
        return False
    n = own.slots[-1]
    last = abs(own.time_s[0] + n * own.step_s - start_s - n * step_s)
    return bool(abs(own.time_s[0] - start_s) < clock.JITTER * step_s and last < clock.JITTER * step_s)
