"""Files of results: tried before the work, written whole or not at all, and never lost to a full or read-only disk."""

import contextlib
import secrets
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


class OutputError(Exception):
    """A result that could not be written where it was asked for; the message says why, and where it lies instead."""


def ready(*files: Path) -> None:
    """Try to write each of some files, and leave nothing behind; `OutputError` says why one cannot be written."""
    for file in files:
        made: list[Path] = []
        try:
            if file.is_dir():
                raise IsADirectoryError(None, "a folder of that name is there")
            there = next(one for one in file.absolute().parents if one.exists())
            if not there.is_dir():
                raise NotADirectoryError(None, f"{there} is a file, not a folder")
            made = [folder for folder in file.absolute().parents if not folder.exists()]
            file.parent.mkdir(parents=True, exist_ok=True)
            tried = _beside(file)
            try:
                tried.open("xb").close()
            finally:
                tried.unlink(missing_ok=True)
        except (OSError, ValueError) as error:  # the latter: a zero byte in its name
            raise OutputError(f"{file} cannot be written: {_why(error)}; name another place with --out") from None
        finally:
            for folder in made:
                with contextlib.suppress(OSError):  # somebody else has put something into it
                    folder.rmdir()


def write_text(file: Path, text: str) -> None:
    """Write a text in UTF-8 whole or not at all, see `write_whole`."""
    write_whole(file, lambda stream: stream.write(text.encode("utf-8", errors="backslashreplace")))


def write_whole(file: Path, fill: Callable[[BinaryIO], object]) -> None:
    """Write a file whole or not at all: first beside it, then renamed; its folder is made.

    Raises
    ------
    OutputError
        where that cannot be; the result then lies in a new folder for temporary files, if there is room

    """
    try:
        _write(file, fill)
    except (OSError, ValueError) as error:
        try:
            instead = Path(tempfile.mkdtemp(prefix="wsp-")) / file.name
            _write(instead, fill)
            where = f"it lies in {instead} instead"
        except (OSError, ValueError):
            where = "nor is there room elsewhere"
        raise OutputError(f"{file} cannot be written: {_why(error)}; {where}") from None


def all_of(*steps: Callable[[], object]) -> None:
    """Take every step, whatever becomes of the others; then raise the first `OutputError`."""
    first = None
    for step in steps:
        try:
            step()
        except OutputError as error:
            first = first or error
    if first:
        raise first


def _write(file: Path, fill: Callable[[BinaryIO], object]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    beside = _beside(file)  # named before it is made: Ctrl-C may come at any moment
    try:
        with beside.open("xb") as stream:
            fill(stream)
        beside.chmod(0o644)
        beside.replace(file)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def _beside(file: Path) -> Path:
    """Return a hidden name in the same folder that nobody else has."""
    return file.parent / f".{file.name[:100]}.{secrets.token_hex(8)}"


def _why(error: Exception) -> str:
    said = getattr(error, "strerror", None) or str(error)
    return said if said.startswith("/") else said.lower()
