"""The tables that stops are recorded in: what channels a file has, in which units, and their samples as they stand there.

CSV (comma, semicolon or tab; decimal comma with the latter two) and Parquet here, MDF4 and MAT in `loggers`. A cell
that is no number comes out as nan; what to do about it is decided in `quality`.
"""

import csv
import dataclasses
import re
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
import polars as pl

_HEAD_BYTES = 1 << 20  # a header and a few lines fit in here
_SEPARATORS = ",;\t"


class CampaignError(ValueError):
    """A campaign that cannot be used; the message names file, column and line, and says how to mend it."""


class CampaignWarning(UserWarning):
    """Something in a recording was mended or looks wrong; the message says what and where."""


@dataclasses.dataclass(frozen=True)
class Samples:
    """One channel as it stands in the file; nan where it has no number."""

    values: np.ndarray  # (n,) in the file's unit
    time_s: np.ndarray | None = None  # (n,) [s], where the format gives every channel its clock


class Table(ABC):
    """One open file of recorded channels."""

    own_clocks = False  # whether the format gives every channel its clock

    def __init__(self, file: Path, units: dict[str, str]):
        self.file = file
        self.units = units  # channel -> unit stated in the file, "" where it states none

    @abstractmethod
    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels, which must be in `units`; `CampaignError` when the file is damaged."""

    def require(self, names: list[str]) -> None:
        """Raise `CampaignError` naming the channels that the file does not have."""
        if missing := [name for name in names if name not in self.units]:
            has = ", ".join(list(self.units)[:40]) + (", ..." if len(self.units) > 40 else "")
            raise CampaignError(f"{self.file} lacks the column {', '.join(missing)}; it has: {has}")


def open_table(file: Path) -> Table:
    """Open a recording of any known format, by its suffix.

    Raises
    ------
    CampaignError
        for a file that is empty, damaged, of an unknown format, or needs an extra that is not installed

    """
    from wsp_env.recordings import loggers

    formats = {".csv": Csv, ".txt": Csv, ".tsv": Csv, ".parquet": Parquet, ".mf4": loggers.Mdf, ".mat": loggers.open_mat}
    suffix = file.suffix.lower()
    if suffix not in formats:
        raise CampaignError(f"{file}: unknown format {suffix!r}; known: {', '.join(formats)}")
    try:
        size = file.stat().st_size
    except OSError as error:
        raise CampaignError(f"{file} cannot be opened: {error.strerror}") from None
    if size == 0:
        raise CampaignError(f"{file} is empty")
    table: Table = formats[suffix](file)
    if not table.units:
        raise CampaignError(f"{file} holds no channels")
    return table


class Csv(Table):
    """Text with one line of names, then one line per sample."""

    def __init__(self, file: Path):
        with file.open("rb") as stream:
            head = stream.read(_HEAD_BYTES).decode("utf-8-sig", errors="replace")
        lines = head.splitlines()
        self._skip = next((i for i, line in enumerate(lines) if line.strip()), 0)
        header = lines[self._skip] if lines else ""
        if "\0" in header:
            raise CampaignError(f"{file} is empty or no CSV table: its first line is not text")
        self._separator = max(_SEPARATORS, key=header.count)
        names = [name.strip() for name in next(csv.reader([header], delimiter=self._separator), [])]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise CampaignError(f"{file}: two columns are called {', '.join(map(repr, twice))}; give each a name of its own")
        body = "\n".join(lines[self._skip + 1 : self._skip + 20])
        self._decimal_comma = self._separator != "," and re.search(r"\d,\d", body) is not None
        self._names = names
        super().__init__(file, {name: _stated_unit(name) for name in names if name})

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named columns; a line with fewer cells than the header counts for nothing, as its cells may be shifted."""
        last = self._names[-1]
        frame = self._scan(dict.fromkeys(self._names, pl.Float64), sorted({*names, last}, key=self._names.index))
        if frame.height == 0:
            raise CampaignError(f"{self.file} is empty: it has a header but no samples")
        unread = [name for name in frame.columns if frame[name].null_count()]
        if unread:  # a number in quotes or blanks, a text, an empty cell, a short line
            text = self._scan(dict.fromkeys(self._names, pl.String), unread)
            frame = frame.with_columns(text[name].str.strip_chars(' "').cast(pl.Float64, strict=False) for name in unread)
        short = frame[last].is_null().to_numpy()
        if short.any() and last in unread:
            short &= text[last].is_null().to_numpy()
        columns = {}
        for name in names:
            values = frame.drop_in_place(name).to_numpy() if name != last else frame[name].to_numpy()
            if short.any():
                values = np.where(short, np.nan, values)
            columns[name] = Samples(values)
        return columns

    def _scan(self, schema: dict[str, type[pl.DataType]], names: list[str]) -> pl.DataFrame:
        try:
            return pl.read_csv(
                self.file,
                has_header=False,
                skip_rows=self._skip + 1,
                schema=schema,
                columns=[self._names.index(name) for name in names],
                separator=self._separator,
                decimal_comma=self._decimal_comma,
                quote_char=None,
                ignore_errors=True,
                encoding="utf8-lossy",
            )
        except pl.exceptions.NoDataError:
            raise CampaignError(f"{self.file} is empty: it has a header but no samples") from None
        except (pl.exceptions.PolarsError, OSError) as error:
            raise CampaignError(f"{self.file} cannot be read: {self._long_line() or first_line(error)}") from None

    def _long_line(self) -> str:
        """Say which line has more cells than the header."""
        cells = len(self._names)
        separator = self._separator.encode()
        with self.file.open("rb") as stream:
            for number, line in enumerate(stream, start=1):
                if number > self._skip and line.count(separator) >= cells:
                    return (
                        f"line {number} has {line.count(separator) + 1} cells, the header {cells}; correct or remove that line"
                    )
        return ""


class Parquet(Table):
    """A Parquet file with one column per channel."""

    def __init__(self, file: Path):
        try:
            names = list(pl.read_parquet_schema(file))
        except (pl.exceptions.PolarsError, OSError) as error:
            raise CampaignError(f"{file} is empty or no Parquet table: {first_line(error)}") from None
        super().__init__(file, {name: _stated_unit(name) for name in names})

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named columns; points in time become seconds."""
        try:
            frame = pl.read_parquet(self.file, columns=names)
        except (pl.exceptions.PolarsError, OSError) as error:
            raise CampaignError(f"{self.file} cannot be read: {first_line(error)}") from None
        if frame.height == 0:
            raise CampaignError(f"{self.file} is empty: it has columns but no samples")
        return {name: Samples(_floats(frame.drop_in_place(name))) for name in names}


def _floats(column: pl.Series) -> np.ndarray:
    if isinstance(column.dtype, pl.Datetime | pl.Duration):
        return column.to_physical().to_numpy() * {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.dtype.time_unit]
    if column.dtype == pl.String:
        column = column.str.strip_chars(' "')
    if not (column.dtype.is_numeric() or column.dtype in (pl.String, pl.Boolean)):
        return np.full(len(column), np.nan)
    return column.cast(pl.Float64, strict=False).to_numpy()


def _stated_unit(name: str) -> str:
    """Return the unit in a name such as "Speed [km/h]" or "Pressure (bar)"."""
    match = re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name)
    return match[1].strip() if match else ""


def first_line(error: Exception) -> str:
    """Return the first line of what another library says is wrong."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
