"""Origin of a diagnosis: input files with hashes, date and version."""

import dataclasses
from datetime import date
from pathlib import Path

import wsp_env
from wsp_env.diagnosis.answer import Diagnosis, Source
from wsp_env.recordings.origin import hashes


def sources(folder: Path) -> tuple[Source, ...]:
    """Return campaign.toml and the files of its runs, each with its SHA-256."""
    return tuple(Source(name, digest) for name, digest in hashes(folder))


def signed(found: Diagnosis, folder: Path) -> Diagnosis:
    """Return a diagnosis with sources, today's date and the package version; its model tells the sources, too."""
    files = sources(folder)
    model = {**found.model, "sources": {one.file: one.sha256 for one in files}}
    return dataclasses.replace(found, model=model, sources=files, made=date.today().isoformat(), version=wsp_env.__version__)
