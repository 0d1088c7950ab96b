"""A controller in a task: its name, and for other machines the files that it is made of."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from wsp_env.evaluation.controller import SHORT_NAMES
from wsp_env.evaluation.sources import own_files
from wsp_env.executor import Sent, send


class Carried(NamedTuple):
    """A controller's name, and its files."""

    name: str
    sent: Sent | None = None  # none where the name is one of a module: it must be installed wherever it runs
    inside: str = ""  # its name within the folder that is sent

    @contextlib.contextmanager
    def here(self) -> Iterator[str]:
        """Give the name under which it is found here, while its files are."""
        if self.sent is None or self.sent.content is None:
            yield self.name
            return
        with self.sent.here() as folder:
            yield str(folder / self.inside)


def carry(name: str, far: bool) -> Carried:
    """Return a controller as tasks take it; for an executor that is `far` its files go along."""
    place, colon, attribute = name.partition(":")
    files = own_files(place) if name not in SHORT_NAMES else set()
    if not files:
        return Carried(name)
    path = Path(place).resolve()
    if path.is_dir():
        return Carried(name, send(path, far))
    return Carried(name, send(path.parent, far, files), path.name + colon + attribute)
