"""The columns of one run's table: reading and checking them."""

import re
from pathlib import Path

import numpy as np
import polars as pl

#: A step of the clock may differ from the campaign's sample time by this share of it.
CLOCK_TOLERANCE = 0.5


class CampaignError(ValueError):
    """A campaign that cannot be used; the message names file, column and line, and says how to mend it."""


def read_columns(file: Path, names: list[str], axles: int, sample_time_s: float) -> dict[str, np.ndarray]:
    """Return the named columns of a CSV or Parquet table as arrays (T,) of finite floats.

    Parameters
    ----------
    file : a CSV with one header line, or a Parquet file (.parquet)
    names : columns that must be there; `time_s` among them must rise in steps of the sample time
    axles : number of axles of the vehicle, which the columns must not contradict
    sample_time_s : [s]

    Raises
    ------
    CampaignError
        for an empty file, a missing column, a cell that is not a finite number, a clock that does not rise evenly

    """
    parquet = file.suffix == ".parquet"
    try:
        header = pl.read_parquet_schema(file) if parquet else pl.read_csv(file, n_rows=0, infer_schema=False).columns
        present = list(header)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise CampaignError(f"{file} is empty or no {'Parquet' if parquet else 'CSV'} table: {_first_line(error)}") from None
    _check_columns(file, names, present, axles)
    try:
        if parquet:
            frame = pl.read_parquet(file, columns=names)
        else:
            frame = pl.read_csv(file, columns=names, schema_overrides=dict.fromkeys(names, pl.Float64))
    except pl.exceptions.ComputeError:  # a cell that is no number: read as text and find it
        frame = pl.read_csv(file, columns=names, infer_schema=False, truncate_ragged_lines=True)
    except pl.exceptions.PolarsError as error:
        raise CampaignError(f"{file} cannot be read: {_first_line(error)}") from None
    if frame.height == 0:
        raise CampaignError(f"{file} is empty: it has a header but no samples")
    columns = {name: _numbers(file, frame[name]) for name in names}
    _check_clock(file, columns["time_s"], sample_time_s)
    return columns


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or ["unreadable"])[0]


def _check_columns(file: Path, names: list[str], present: list[str], axles: int) -> None:
    numbers = {int(match[1]) for name in present if (match := re.match(r"axle(\d+)_", name))}
    if numbers and numbers != set(range(1, axles + 1)):
        raise CampaignError(
            f"{file}: its columns speak of axles {', '.join(map(str, sorted(numbers)))}, but campaign.toml says "
            f"[vehicle] axles = {axles}; correct the one or the other"
        )
    if missing := [name for name in names if name not in present]:
        raise CampaignError(f"{file} lacks the column {', '.join(missing)}; it has: {', '.join(present)}")


def _numbers(file: Path, column: pl.Series) -> np.ndarray:
    values = column.cast(pl.Float64, strict=False).to_numpy()
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        cell = column[int(bad[0])]
        what = "is empty" if cell is None else f"is {cell!r}"
        raise CampaignError(
            f"{file}, column {column.name}, {_line(bad[0])}: the cell {what}, which is no finite number "
            f"({bad.size} such cells in this column); correct it or cut the run before it"
        )
    return np.asarray(values, dtype=float)


def _check_clock(file: Path, time_s: np.ndarray, sample_time_s: float) -> None:
    steps = np.diff(time_s)
    for wrong, what in (
        (steps <= 0.0, "the clock does not rise"),
        (np.abs(steps - sample_time_s) > CLOCK_TOLERANCE * sample_time_s, "the clock jumps"),
    ):
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            raise CampaignError(
                f"{file}, column time_s, {_line(row)}: {what}, from {time_s[row - 1]:g} s to {time_s[row]:g} s "
                f"(sample_time_s = {sample_time_s:g}); remove the doubled sample or cut the run there"
            )


def _line(row: int) -> str:
    return f"row {row + 1} (line {row + 2} of a CSV)"
