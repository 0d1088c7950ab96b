"""Files on their way to another machine and back: a folder as bytes."""

import contextlib
import dataclasses
import io
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from wsp_env.output import write_whole

_WHEN = (1980, 1, 1, 0, 0, 0)  # of every file: equal files give equal bytes


def pack(folder: Path, files: Iterable[Path] | None = None) -> bytes:
    """Return the files of a folder, all or some, with their places in it."""
    chosen = sorted(folder.rglob("*")) if files is None else sorted(files)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for file in chosen:
            if file.is_file():
                name = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _WHEN)
                archive.writestr(name, file.read_bytes(), zipfile.ZIP_DEFLATED, compresslevel=1)
    return content.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write packed files into a folder, in the order of their names, each whole or not at all."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for name in archive.namelist():
            file = folder / name
            if not file.resolve().is_relative_to(folder.resolve()):
                raise ValueError(f"{name} leads out of the folder that it was packed for")
            data = archive.read(name)
            write_whole(file, lambda stream, data=data: stream.write(data))  # type: ignore[misc]  # a default of a lambda


@dataclasses.dataclass(frozen=True)
class Sent:
    """A folder, or some files of it, in a task; on its way to other machines its content goes along.

    It is read when the task is sent, so that tasks that wait take no memory.
    """

    path: Path
    far: bool  # whether the task goes to other machines
    files: tuple[Path, ...] | None = None  # of the folder; None: all
    content: bytes | None = None  # once it has been sent

    def __reduce__(self) -> tuple[Any, ...]:
        """Take the content along, where that is needed."""
        content = pack(self.path, self.files) if self.far and self.content is None else self.content
        return Sent, (self.path, self.far, self.files, content)

    @contextlib.contextmanager
    def here(self) -> Iterator[Path]:
        """Give the folder while the task lasts; on another machine it is one for the time being, of the same name."""
        if self.content is None:
            yield self.path
            return
        with tempfile.TemporaryDirectory(prefix="wsp-") as place:
            folder = Path(place) / self.path.absolute().name
            folder.mkdir()
            unpack(self.content, folder)
            yield folder

    def __str__(self) -> str:
        """Return its path: the content fills no message."""
        return str(self.path)


def send(folder: Path, far: bool, files: Iterable[Path] | None = None) -> Sent:
    """Return a folder, or some files of it, as tasks take it; for an executor that is `far` its content goes along."""
    return Sent(folder, far, None if files is None else tuple(files))
