"""Readers of recorded files, one module per format; every one gives a `ChannelFile`.

A new format is a module here with a function `open_file(file: Path) -> ChannelFile`, and a line in `FORMATS`.
"""

import importlib
import stat
from pathlib import Path
from typing import Any

from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers.apart import Apart
from wsp_env.recordings.readers.channel_file import ChannelFile
from wsp_env.recordings.readers.third_party import AGAIN

#: Suffixes of files -> module of this package that reads them.
FORMATS = {
    (".csv", ".txt", ".tsv"): "csv_text",
    (".parquet",): "parquet",
    (".mf4",): "mdf4",
    (".mat",): "mat",
}


#: Readers whose libraries are native code, and run in a process of their own, see `apart`.
NATIVE = ("parquet", "mdf4", "mat")

#: More channels than this are a damaged file's, or of no use here; test vehicles record some thousand.
MOST_CHANNELS = 20_000


def open_file(file: Path) -> ChannelFile:
    """Open a recording of any known format, by its suffix.

    Raises
    ------
    CampaignError
        for a file that is empty, damaged, of an unknown format, or needs an extra that is not installed

    """
    readers = {suffix: reader for suffixes, reader in FORMATS.items() for suffix in suffixes}
    suffix = file.suffix.lower()
    if suffix not in readers:
        raise CampaignError(f"{file}: unknown format {suffix!r}; known: {', '.join(readers)}")
    try:
        state = file.stat()
    except (OSError, ValueError) as error:  # the latter: a zero byte in its name
        raise CampaignError(f"{file} cannot be opened: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(state.st_mode):  # a pipe would be waited for
        raise CampaignError(f"{file} cannot be opened: it is no file")
    if state.st_size == 0:
        raise CampaignError(f"{file} is empty; record it again, or leave the run out of campaign.toml")
    reader = readers[suffix]
    opened: ChannelFile = Apart(file, reader) if reader in NATIVE else _module(reader).open_file(file)
    if not opened.units:
        raise CampaignError(f"{file} holds no channels: no vector of numbers is in it, or its end is missing; {AGAIN}")
    if len(opened.units) > MOST_CHANNELS:
        raise CampaignError(f"{file} has {len(opened.units)} channels, more than {MOST_CHANNELS}: export those of a stop only")
    return opened


def _module(reader: str) -> Any:
    return importlib.import_module(f"{__name__}.{reader}")
