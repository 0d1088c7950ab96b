"""MDF files of version 4, from test vehicles (asammdf; extra [data])."""

import logging
from pathlib import Path

import numpy as np

from wsp_env.recordings.readers.channel_file import ChannelFile, Samples
from wsp_env.recordings.readers.mdf4_blocks import check_blocks
from wsp_env.recordings.readers.third_party import extra, one_sentence, vector

_DEFLATE_RATIO = 1032  # [-] the most that deflate, by which MDF4 compresses, can save (zlib's own documentation)


class Mdf(ChannelFile):
    """An MDF file of version 4; every channel brings its own clock."""

    own_clocks = True

    def __init__(self, file: Path):
        asammdf = extra("asammdf", file)
        with one_sentence(file, "an MDF4 file"):
            check_blocks(file)
            logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # it logs what it then raises
            self._mdf = asammdf.MDF(file)
            for group in self._mdf.groups:  # asammdf would take that much memory
                record = group.channel_group.samples_byte_nr + group.channel_group.invalidation_bytes_nr
                if record > _DEFLATE_RATIO * file.stat().st_size:
                    raise ValueError(f"it cannot hold a record of {record} bytes")
            units, self._places = {}, {}
            for name, entries in self._mdf.channels_db.items():
                own = [(group, index) for group, index in entries if index != self._mdf.masters_db.get(group)]
                for group, index in own:  # a logger may record one signal in several groups
                    channel = name if len(own) == 1 else f"{name} (group {group})"
                    units[channel] = str(self._mdf.get_channel_unit(name, group=group, index=index) or "")
                    self._places[channel] = (name, group, index)
        super().__init__(file, units)

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels; samples that the logger marked as invalid become nan."""
        columns = {}
        for name in names:
            channel, group, index = self._places[name]
            with one_sentence(self.file, "an MDF4 file"):
                signal = self._mdf.get(channel, group=group, index=index, ignore_invalidation_bits=True)
                values = vector(self.file, name, signal.samples)
                if signal.invalidation_bits is not None:
                    values = np.where(np.asarray(signal.invalidation_bits, dtype=bool), np.nan, values)
                columns[name] = Samples(values, np.asarray(signal.timestamps, dtype=float))
        return columns


def open_file(file: Path) -> Mdf:
    """Open an MDF file; `CampaignError` for a damaged one."""
    return Mdf(file)
