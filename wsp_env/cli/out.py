"""What `--out` names: a file in some commands, a folder in others."""

import os
from pathlib import Path
from typing import Annotated, TypeAlias

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from wsp_env.output import OutputError

_SEPARATORS = tuple(filter(None, (os.sep, os.altsep)))


def _file(given: list[str]) -> Path:
    """Return the path; `OutputError` for one that ends as a folder's does, which `Path` would forget."""
    (path,) = given
    if path.endswith(_SEPARATORS):
        raise OutputError(f"--out {path} names a folder, but this command writes a file; name a file in it with --out")
    return Path(path)


#: Option of a command that writes one file.
OutFile: TypeAlias = Annotated[
    Path,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="FILE",
        instance_from_str=_file,
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda value: [str(value)],
    ),
]

#: Option of a command that writes a folder of files.
OutFolder: TypeAlias = Annotated[Path, tyro.conf.arg(metavar="DIR")]
