"""What a diagnosis was made from and by: files with their hashes, day and version."""

import dataclasses
import hashlib
import tomllib
from datetime import date
from pathlib import Path

import wsp_env
from wsp_env.diagnosis.answer import Diagnosis, Source


def sources(folder: Path) -> tuple[Source, ...]:
    """Return campaign.toml and the runs' files of a campaign folder that was read, each with its SHA-256."""
    text = (folder / "campaign.toml").read_bytes()
    runs = tomllib.loads(text.decode("utf-8"))["runs"].values()
    files = dict.fromkeys(["campaign.toml", *(str(run["file"]) for run in runs)])
    return tuple(Source(name, hashlib.sha256((folder / name).read_bytes()).hexdigest()) for name in files)


def signed(found: Diagnosis, folder: Path) -> Diagnosis:
    """Return a diagnosis with its sources, today's date and this package's version."""
    return dataclasses.replace(found, sources=sources(folder), made=date.today().isoformat(), version=wsp_env.__version__)
