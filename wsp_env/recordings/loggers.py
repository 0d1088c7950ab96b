"""Files of measurement systems: MDF4 (asammdf) and MATLAB's MAT, version 5 and 7.3 (HDF5, h5py); extra [data].

The libraries raise whatever their parsers stumble over in a damaged file (struct.error, KeyError, MemoryError, their own),
so everything is caught here and said in one sentence.
"""

import contextlib
import gc
import importlib
import logging
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wsp_env.recordings.mat5 import read_mat5
from wsp_env.recordings.table import CampaignError, Samples, Table, first_line

_DEFLATE_RATIO = 1032  # [-] the most that deflate, by which MDF4 compresses, can save

_HDF5 = b"\x89HDF\r\n\x1a\n"  # how an HDF5 file begins, in a MAT file after 512 bytes


class Mdf(Table):
    """An MDF file of version 4; every channel brings its own clock."""

    own_clocks = True

    def __init__(self, file: Path):
        asammdf = _extra("asammdf", file)
        with _saying(file, "an MDF4 file"):
            logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # it logs what it then raises
            self._mdf = asammdf.MDF(file)
            for group in self._mdf.groups:  # asammdf would take that much memory
                record = group.channel_group.samples_byte_nr + group.channel_group.invalidation_bytes_nr
                if record > _DEFLATE_RATIO * file.stat().st_size:
                    raise ValueError(f"it cannot hold a record of {record} bytes")
            units = {}
            for name, entries in self._mdf.channels_db.items():
                group, index = entries[0]
                if index != self._mdf.masters_db.get(group):
                    units[name] = str(self._mdf.get_channel_unit(name, group=group, index=index) or "")
        super().__init__(file, units)

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named channels; samples that the logger marked as invalid become nan."""
        columns = {}
        for name in names:
            entries = self._mdf.channels_db[name]
            if len(entries) > 1:
                raise CampaignError(
                    f"{self.file}: {len(entries)} groups have a channel {name}; rename it or export only one of them"
                )
            with _saying(self.file, "an MDF4 file"):
                signal = self._mdf.get(name, group=entries[0][0], index=entries[0][1], ignore_invalidation_bits=True)
                values = _vector(self.file, name, signal.samples)
                if signal.invalidation_bits is not None:
                    values = np.where(np.asarray(signal.invalidation_bits, dtype=bool), np.nan, values)
                columns[name] = Samples(values, np.asarray(signal.timestamps, dtype=float))
        return columns


class Mat(Table):
    """Vectors of a MAT file, also in structures (`structure.field`)."""

    def __init__(self, file: Path, vectors: dict[str, Any]):
        super().__init__(file, dict.fromkeys(vectors, ""))
        self._vectors = vectors

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named vectors."""
        columns = {}
        for name in names:
            with _saying(self.file, "a MAT file"):
                columns[name] = Samples(_vector(self.file, name, np.asarray(self._vectors[name][()])))
        return columns


def open_mat(file: Path) -> Mat:
    """Open a MAT file of either version."""
    with file.open("rb") as stream:
        head = stream.read(520)
    if head[512:520] == _HDF5 or head[:8] == _HDF5:
        h5py = _extra("h5py", file)
        with _saying(file, "a MAT file of version 7.3"):
            vectors: dict[str, Any] = {}
            content = h5py.File(file, "r")

            def visit(name: str, node: Any) -> None:
                if isinstance(node, h5py.Dataset) and node.dtype.kind in "fiub" and not name.startswith("#"):
                    vectors[name.replace("/", ".")] = node

            content.visititems(visit)
            return Mat(file, _long(vectors))
    with _saying(file, "a MAT file"):
        return Mat(file, _long(read_mat5(file.read_bytes())))


def _long(vectors: dict[str, Any]) -> dict[str, Any]:
    """Keep what may be a channel: more than one number in a row or column."""
    return {
        name: value
        for name, value in vectors.items()
        if np.prod(value.shape) > 1 and np.max(value.shape) == np.prod(value.shape)
    }


def _vector(file: Path, name: str, values: Any) -> np.ndarray:
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(float), np.nan)
    values = np.asarray(values)
    if values.dtype.kind not in "fiub":
        raise CampaignError(f"{file}, channel {name}: its samples are no numbers; export it as numbers")
    return np.ravel(values).astype(float, copy=False)


def _extra(name: str, file: Path) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise CampaignError(f'{file}: reading {file.suffix} files needs {name}: pip install "wsp-env[data]"') from None


@contextlib.contextmanager
def _saying(file: Path, what: str) -> Iterator[None]:
    """Say in one sentence what a library stumbles over, however it does."""
    problem = ""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # asammdf's destructor stumbles over files that it could not open
    try:
        yield
    except CampaignError:
        raise
    except Exception as error:
        problem = first_line(error)
        traceback.clear_frames(error.__traceback__)
        gc.collect()  # lets go of the half-opened file while nobody hears it
    finally:
        sys.unraisablehook = hook
    if problem:
        raise CampaignError(f"{file} is damaged or not {what}: {problem}")
