"""Readers of recorded files, one module per format; every one gives a `ChannelFile`.

A new format is a module here with a function `open_file(file: Path) -> ChannelFile`, and a line in `FORMATS`.
"""

import importlib
from pathlib import Path

from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers.channel_file import ChannelFile

#: Suffixes of files -> module of this package that reads them.
FORMATS = {
    (".csv", ".txt", ".tsv"): "csv_text",
    (".parquet",): "parquet",
    (".mf4",): "mdf4",
    (".mat",): "mat",
}


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
        size = file.stat().st_size
    except OSError as error:
        raise CampaignError(f"{file} cannot be opened: {error.strerror}") from None
    if size == 0:
        raise CampaignError(f"{file} is empty")
    opened: ChannelFile = importlib.import_module(f"{__name__}.{readers[suffix]}").open_file(file)
    if not opened.units:
        raise CampaignError(f"{file} holds no channels")
    return opened
