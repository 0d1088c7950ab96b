"""Text as loggers write it: its encoding, its line ends, and times of day."""

import codecs
import dataclasses
import re
from pathlib import Path

import numpy as np
import polars as pl

from wsp_env.recordings.errors import CampaignError

_HEAD_BYTES = 1 << 20  # a header and a few lines fit in here
_MOST_BYTES = 1 << 30  # of a file that is rewritten in memory
_MOST_EMPTY = 0.25  # share of lines: more empty ones are no gaps but the logger's way to end lines
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

#: Letters and signs of European names and units. Of two encodings the one is right that gives more of them: "\x81" is a "ü"
#: to DOS (code page 850) and nothing to Windows, "\xfc" a "ü" to Windows and a superscript to DOS.
_LIKELY = set("äöüÄÖÜßéèêàâçñáíóúåøæÅØÆ°µ²³")

_DATE = r"(?:(\d{4})-(\d\d?)-(\d\d?)[ T]|(\d\d?)\.(\d\d?)\.(\d{4})[ T])?"
_CLOCK = rf"^\s*\"?{_DATE}(?:(\d{{1,2}}):)?(\d{{1,2}}):(\d{{2}}(?:[.,]\d+)?)Z?\"?\s*$"
_DAY_S = 86400.0


@dataclasses.dataclass(frozen=True)
class Head:
    """How a text begins."""

    lines: list[str]
    encoding: str
    is_plain: bool  # whether it can be read as it is: a superset of ASCII, its lines ended by line feeds


def file_head(file: Path) -> Head:
    """Return the file's first lines: UTF-8, UTF-16, or else Western European text of Windows or DOS."""
    with file.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    encoding = _encoding(head)
    text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(head)
    only_returns = "\n" not in text and "\r" in text
    lines = re.split("\r" if only_returns else "\n", text)
    if "\0" in lines[0]:
        raise CampaignError(f"{file} is empty or no CSV table: its first line is not text")
    lines = [line.rstrip("\r") for line in lines]
    empty = sum(not line.strip() for line in lines[1:-1])
    if empty > _MOST_EMPTY * len(lines):  # some loggers end lines twice
        lines = [line for line in lines if line.strip()]
    return Head(lines, encoding, encoding != "utf-16" and not only_returns and empty <= _MOST_EMPTY * len(lines))


def plain(file: Path, head: Head) -> bytes:
    """Return a text in UTF-8 with line feeds; `CampaignError` for one that is too long to be rewritten."""
    if file.stat().st_size > _MOST_BYTES:
        raise CampaignError(f"{file} is larger than {_MOST_BYTES} bytes: save it as UTF-8 with line feeds, or as Parquet")
    text = file.read_bytes().decode(head.encoding, errors="replace")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if sum(not line.strip() for line in lines) > _MOST_EMPTY * len(lines):
        lines = [line for line in lines if line.strip()]
    return "\n".join(lines).encode()


def _encoding(head: bytes) -> str:
    if head.startswith(_UTF16):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(head)
    except UnicodeDecodeError:
        scores = {name: sum(sign in _LIKELY for sign in head.decode(name, errors="ignore")) for name in ("cp1252", "cp850")}
        return max(scores, key=lambda name: scores[name])
    return "utf-8-sig"


def is_clock(cell: str) -> bool:
    """Whether a cell holds a time of day, with or without its date."""
    return ":" in cell and re.match(_CLOCK, cell) is not None


def seconds(text: pl.Series) -> np.ndarray:
    """Return times of day (n,) as seconds since the first day's midnight, nan for what is none; dates and midnight are seen."""
    columns = [text.str.extract(_CLOCK, group).str.replace(",", ".", literal=True) for group in range(1, 10)]
    year, month, day, day_too, month_too, year_too, hour, minute, second = (
        column.cast(pl.Float64, strict=False).to_numpy() for column in columns
    )
    days = _days(
        *(np.where(np.isnan(one), other, one) for one, other in ((year, year_too), (month, month_too), (day, day_too)))
    )
    time: np.ndarray = 3600.0 * np.nan_to_num(hour) + 60.0 * minute + second
    known = np.isfinite(days)
    if known.any():
        return time + _DAY_S * np.where(known, days - np.nanmin(days), np.nan)
    back = np.diff(np.where(np.isfinite(time), time, np.nan)) < -0.5 * _DAY_S
    midnights: np.ndarray = time + _DAY_S * np.concatenate([[0], np.cumsum(back)])
    return midnights


def _days(year: np.ndarray, month: np.ndarray, day: np.ndarray) -> np.ndarray:
    """Return the numbers of days since 1970; nan without a date."""
    known = np.isfinite(year) & (month >= 1) & (month <= 12)
    months = np.where(known, 12.0 * (year - 1970.0) + month - 1.0, 0.0).astype("datetime64[M]").astype("datetime64[D]")
    return np.where(known, months.astype(np.float64) + day - 1.0, np.nan)
