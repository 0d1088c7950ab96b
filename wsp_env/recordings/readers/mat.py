"""MATLAB's MAT files: version 5 by `mat5`, version 7.3 (HDF5) by h5py (extra [data])."""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from wsp_env.recordings.readers.channel_file import ChannelFile, Samples
from wsp_env.recordings.readers.mat5 import read_mat5
from wsp_env.recordings.readers.third_party import extra, one_sentence, vector

_MOST_COLUMNS = 64  # of a matrix of channels, one for each axle
_HDF5 = b"\x89HDF\r\n\x1a\n"  # how an HDF5 file begins, in a MAT file after 512 bytes


class _Stored(Protocol):
    """An array in memory or in the file: numpy's or h5py's."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, key: tuple[()], /) -> np.ndarray: ...


class Mat(ChannelFile):
    """Vectors of a MAT file, also in structures (`structure.field`), and columns of matrices (`matrix.1`)."""

    def __init__(self, file: Path, vectors: Mapping[str, _Stored]):
        names: list[str] = []
        for name, stored in vectors.items():
            lengths = sorted(one for one in stored.shape if one > 1)
            names += [name] if len(lengths) == 1 else [f"{name}.{k}" for k in range(1, lengths[0] + 1)]
        super().__init__(file, dict.fromkeys(names, ""))
        self._vectors = vectors

    def read(self, names: list[str]) -> dict[str, Samples]:
        """Return the named vectors."""
        columns = {}
        for name in names:
            with one_sentence(self.file, "a MAT file"):
                whole, _, column = (name, "", "") if name in self._vectors else name.rpartition(".")
                values = np.asarray(self._vectors[whole][()])
                if column:
                    values = np.take(values, int(column) - 1, axis=int(np.argmin(values.shape)))
                columns[name] = Samples(vector(self.file, name, values))
        return columns


def open_file(file: Path) -> Mat:
    """Open a MAT file of either version; `CampaignError` for a damaged one."""
    with file.open("rb") as stream:
        head = stream.read(520)
    if head[512:520] == _HDF5 or head[:8] == _HDF5:
        h5py = extra("h5py", file)
        with one_sentence(file, "a MAT file of version 7.3"):
            vectors: dict[str, _Stored] = {}
            content = h5py.File(file, "r")

            def visit(name: str, node: object) -> None:
                if isinstance(node, h5py.Dataset) and node.dtype.kind in "fiub" and not name.startswith("#"):
                    vectors[name.replace("/", ".")] = node

            content.visititems(visit)
            return Mat(file, _long(vectors))
    with one_sentence(file, "a MAT file"):
        return Mat(file, _long(read_mat5(file.read_bytes())))


def _long(vectors: Mapping[str, _Stored]) -> dict[str, _Stored]:
    """Keep what may be channels: more than one number in a row or column, or some columns of many."""
    return {name: value for name, value in vectors.items() if _is_long(value.shape)}


def _is_long(shape: tuple[int, ...]) -> bool:
    lengths = sorted(one for one in shape if one != 1)
    if len(lengths) == 2:
        return 0 < lengths[0] <= _MOST_COLUMNS and lengths[1] > lengths[0] and len(shape) == 2
    return len(lengths) == 1 and lengths[0] > 1
