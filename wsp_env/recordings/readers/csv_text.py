"""Recordings as text: CSV with commas, semicolons or tabs, and decimal commas with the latter two or in quotes.

Before the line of names there may be lines on the test, and after it one line of units, as many loggers write them.
"""

import csv
import dataclasses
import io
import itertools
import re
from pathlib import Path
from typing import BinaryIO

import numpy as np
import polars as pl

from wsp_env.recordings.errors import CampaignError, first_line
from wsp_env.recordings.readers.channel_file import ChannelFile, Samples
from wsp_env.recordings.readers.text import file_head, is_clock, plain, seconds
from wsp_env.recordings.units import is_unit, stated_unit

MOST_COLUMNS = 20_000  # see `readers.MOST_CHANNELS`
_SEPARATORS = ",;\t"
_NUMBER = re.compile(r'[\s"]*[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?[\s"]*', re.IGNORECASE)

_MISSING = ("na", "nan", "n/a", "null")  # what loggers write for no number; some are units, too


@dataclasses.dataclass(frozen=True)
class _Layout:
    """Where names, units and samples stand."""

    separator: str
    names: list[str]  # of the columns in their order; those without a name begin with \0
    units: list[str]  # as a line of units states them, or nothing
    skip: int  # lines before the first sample


class Csv(ChannelFile):
    """Text with a line of names, then one line per sample."""

    def __init__(self, file: Path):
        head = file_head(file)
        self._content = None if head.is_plain else plain(file, head)
        lines = head.lines
        if (most := max(map(lines[0].count, _SEPARATORS))) >= MOST_COLUMNS:
            raise CampaignError(f"{file} has {most + 1} columns, more than {MOST_COLUMNS}: export those of a stop only")
        layout = _layout(lines)
        self._names, self._separator, self._skip = layout.names, layout.separator, layout.skip
        named = [name for name in self._names if not name.startswith("\0")]
        if any(ord(sign) < ord(" ") for name in named for sign in name):
            raise CampaignError(f"{file} is empty or no CSV table: its first line is not text")
        if twice := sorted({name for name in named if named.count(name) > 1}):
            raise CampaignError(f"{file}: two columns are called {', '.join(map(repr, twice))}; give each a name of its own")
        cells = [cell for line in lines[self._skip :] for cell in _cells(line, self._separator)]
        commas, points = (len(re.findall(rf"\d{mark}\d", "\n".join(cells))) for mark in (",", r"\."))
        self._decimal_comma = commas > points
        self._is_quoted = any(self._separator in cell for cell in cells)  # else a quote is a sign like any other
        self.first_line = self._skip + 1
        stated = layout.units or [""] * len(self._names)
        first = _cells(lines[self._skip], self._separator) if self._skip < len(lines) else []
        clocks = [cell is not None and is_clock(cell) for cell, _ in itertools.zip_longest(first, self._names)]
        stated = ["s" if is_time else unit for unit, is_time in zip(stated, clocks, strict=False)]
        super().__init__(
            file,
            {name: unit or stated_unit(name) for name, unit in zip(self._names, stated, strict=True) if name in named},
        )

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named columns; a line with fewer cells than the header counts for nothing, as its cells may be shifted."""
        last = self._names[-1]
        frame = self._scan(dict.fromkeys(self._names, pl.Float64), sorted({*names, last}, key=self._names.index))
        if frame.height == 0:
            raise CampaignError(f"{self.file} is empty: it has a header but no samples")
        short = self._short(frame.height) if frame[last].null_count() else np.zeros(0, dtype=bool)
        quoted_commas = self._is_quoted and self._decimal_comma
        unread = [name for name in names if quoted_commas or frame[name].null_count()]
        if unread:  # a number in quotes or blanks, a text, an empty cell, a short line
            text = self._scan(dict.fromkeys(self._names, pl.String), sorted(unread, key=self._names.index))
            frame = frame.with_columns(_numbers(text[name], self._decimal_comma) for name in unread)
            for name in unread:  # times of day are no numbers: "12:03:04.123"
                if self.units.get(name) == "s" and frame[name].null_count() > frame.height // 2:
                    frame = frame.with_columns(pl.Series(name, seconds(text[name])))
        columns = {}
        for name in names:
            values = frame.drop_in_place(name).to_numpy()
            if short.any():
                values = np.where(short, np.nan, values)
            columns[name] = Samples(values)
        return columns

    def _scan(self, schema: dict[str, type[pl.DataType]], names: list[str]) -> pl.DataFrame:
        try:
            return pl.read_csv(
                self.file if self._content is None else self._content,
                has_header=False,
                skip_rows=self._skip,
                schema=schema,
                columns=[self._names.index(name) for name in names],
                separator=self._separator,
                decimal_comma=self._decimal_comma and self._separator != ",",
                quote_char='"' if self._is_quoted else None,
                ignore_errors=True,
                encoding="utf8-lossy",
            )
        except pl.exceptions.NoDataError:
            raise CampaignError(f"{self.file} is empty: it has a header but no samples") from None
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
            raise CampaignError(f"{self.file} cannot be read: {self._long_line() or first_line(error)}") from None

    def _open(self) -> BinaryIO:
        return self.file.open("rb") if self._content is None else io.BytesIO(self._content)

    def _short(self, rows: int) -> np.ndarray:
        """Return which rows (rows,) have fewer cells than the header."""
        short: np.ndarray = np.zeros(rows, dtype=bool)
        with self._open() as stream:
            for row, line in enumerate(stream, start=-self._skip):
                if 0 <= row < rows and self._width(line) < len(self._names):
                    short[row] = True
        return short

    def _width(self, line: bytes) -> int:
        """Return the number of cells of a line."""
        if self._is_quoted:
            return len(_cells(line.decode(errors="replace"), self._separator))
        return line.count(self._separator.encode()) + 1

    def _long_line(self) -> str:
        """Say which line has more cells than the header."""
        cells = len(self._names)
        with self._open() as stream:
            for number, line in enumerate(stream, start=1):
                if number > self._skip and (width := self._width(line)) > cells:
                    return f"line {number} has {width} cells, the header {cells}; correct or remove that line"
        return ""


def open_file(file: Path) -> Csv:
    """Open a text file; `CampaignError` for one that is no table."""
    return Csv(file)


def _layout(lines: list[str]) -> _Layout:
    """Find the line of names: the first with as many cells as the first line of numbers, none of them empty but the last."""
    first = next((number for number, line in enumerate(lines) if line.strip()), 0)
    header, separator = first, max(_SEPARATORS, key=lines[first].count)
    numbers = next((number for number, line in enumerate(lines[:200]) if _separator(line)), first)
    if numbers > first:
        separator = _separator(lines[numbers])
        for number in range(first, numbers):
            cells = _cells(lines[number], separator)
            as_many = len(_cells(lines[numbers], separator)) == len(cells) or _ends_open(lines[numbers], separator, len(cells))
            if as_many and all(cells[:-1]):
                header = number
                break
    names = [name or f"\0{column}" for column, name in enumerate(_cells(lines[header], separator))]
    if numbers > header and _ends_open(lines[numbers], separator, len(names)):
        names.append(f"\0{len(names)}")
    units = _units(lines[header + 1], separator, len(names)) if header + 1 < numbers else []
    return _Layout(separator, names, units, header + 1 + bool(units))


def _separator(line: str) -> str:
    """Return what separates a line of numbers, "" for a line of anything else."""

    def numbers(separator: str) -> tuple[float, int]:
        cells = [cell for cell in line.split(separator) if cell.strip()]
        found = sum(_NUMBER.fullmatch(cell) is not None or is_clock(cell) for cell in cells)
        return (found / len(cells) if found > 1 else 0.0), found

    best = max(_SEPARATORS, key=numbers)
    return best if numbers(best)[0] > 0.5 else ""


def _cells(line: str, separator: str) -> list[str]:
    try:
        cells = next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a carriage return within the line, or a cell of more than 128 KiB
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _ends_open(line: str, separator: str, cells: int) -> bool:
    """Whether a line ends in one separator more than it needs for so many cells."""
    found = _cells(line, separator)
    return len(found) == cells + 1 and not found[-1]


def _units(line: str, separator: str, columns: int) -> list[str]:
    """Return the units (columns,) that a line states, "" for a column without; nothing where it is no line of units."""
    units = [cell.strip("[]() -") for cell in _cells(line, separator)]
    units += [""] * (columns - len(units))
    stated = [unit for unit in units if unit]
    are_units = all(unit.lower() not in _MISSING and is_unit(unit) for unit in stated)
    return units if len(units) == columns and stated and are_units else []


def _numbers(text: pl.Series, decimal_comma: bool) -> pl.Series:
    text = text.str.strip_chars(' "')
    if decimal_comma:  # a point then parts thousands
        whole = text.str.contains(r"^[-+]?\d{1,3}(\.\d{3})+(,\d*)?$")
        text = pl.select(pl.when(whole).then(text.str.replace_all(".", "", literal=True)).otherwise(text)).to_series()
        text = text.str.replace(",", ".", literal=True)
    return text.cast(pl.Float64, strict=False)
