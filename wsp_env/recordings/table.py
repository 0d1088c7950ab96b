"""The tables that stops are recorded in: what channels a file has, in which units, and their samples as they stand there.

Parquet here, CSV in `text`, MDF4 and MAT in `loggers`. A cell that is no number comes out as nan; what to do about it is
decided in `quality`.
"""

import dataclasses
import re
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
import polars as pl


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
    first_line = 2  # of the file that holds the first sample, where the file is text

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
    from wsp_env.recordings.text import Csv

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


#: What polars raises for a damaged file; in about one of a thousand it panics, which is no `Exception`.
_UNREADABLE = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)


class Parquet(Table):
    """A Parquet file with one column per channel."""

    def __init__(self, file: Path):
        try:
            names = list(pl.read_parquet_schema(file))
        except _UNREADABLE as error:
            raise CampaignError(f"{file} is empty or no Parquet table: {first_line(error)}") from None
        super().__init__(file, {name: stated_unit(name) for name in names})

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named columns; points in time become seconds."""
        try:
            frame = pl.read_parquet(self.file, columns=names)
        except _UNREADABLE as error:
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


def stated_unit(name: str) -> str:
    """Return the unit in a name such as "Speed [km/h]" or "Pressure (bar)"."""
    match = re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name)
    return match[1].strip() if match else ""


def first_line(error: Exception) -> str:
    """Return the first line of what another library says is wrong."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
