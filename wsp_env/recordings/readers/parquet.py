"""Parquet files with one column per channel."""

from pathlib import Path

import numpy as np
import polars as pl

from wsp_env.recordings.errors import CampaignError, first_line
from wsp_env.recordings.readers.channel_file import ChannelFile, Samples
from wsp_env.recordings.readers.third_party import AGAIN
from wsp_env.recordings.units import stated_unit

#: What polars raises for a damaged file; in about one of a thousand it panics, which is no `Exception`.
_UNREADABLE = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)


class Parquet(ChannelFile):
    """A Parquet file."""

    def __init__(self, file: Path):
        try:
            names = list(pl.read_parquet_schema(file))
        except _UNREADABLE as error:
            remedy = AGAIN if _begins_as_parquet(file) else "if it is text, give it a name that ends in .csv"
            raise CampaignError(f"{file} is empty or no Parquet table: {first_line(error)}; {remedy}") from None
        super().__init__(file, {name: stated_unit(name) for name in names})

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named columns; points in time become seconds."""
        try:
            frame = pl.read_parquet(self.file, columns=names)
        except _UNREADABLE as error:
            raise CampaignError(f"{self.file} cannot be read: {first_line(error)}; {AGAIN}") from None
        if frame.height == 0:
            raise CampaignError(f"{self.file} is empty: it has columns but no samples")
        return {name: Samples(_floats(frame.drop_in_place(name))) for name in names}


def _begins_as_parquet(file: Path) -> bool:
    try:
        with file.open("rb") as content:
            return content.read(4) == b"PAR1"
    except OSError:
        return True  # what cannot be read may be anything


def open_file(file: Path) -> Parquet:
    """Open a Parquet file; `CampaignError` for a damaged one."""
    return Parquet(file)


def _floats(column: pl.Series) -> np.ndarray:
    if isinstance(column.dtype, pl.Datetime | pl.Duration):
        return column.to_physical().to_numpy() * {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.dtype.time_unit]
    if column.dtype == pl.String:
        column = column.str.strip_chars(' "')
    if not (column.dtype.is_numeric() or column.dtype in (pl.String, pl.Boolean)):
        return np.full(len(column), np.nan)
    return column.cast(pl.Float64, strict=False).to_numpy()
