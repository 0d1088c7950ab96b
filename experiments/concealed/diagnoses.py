"""Runs the released diagnosis over a bank: DIR/diagnoses/CASE/diagnosis.json; goes on where it was broken off."""

import hashlib
import json
from pathlib import Path
from typing import Any

import wsp_env
from experiments.concealed.bank import BankError, read_labels
from experiments.concealed.distances import distance_change
from experiments.concealed.workers import each, quietly_read, write_whole
from wsp_env.diagnosis import diagnose
from wsp_env.recordings import CampaignError

#: What an answer depends on.
_PARTS = ("compiled.py", "contact", "parameters", "plant", "recordings", "diagnosis")


def digest() -> str:
    """Return the SHA-256 of all code that an answer depends on, thresholds included."""
    root = Path(wsp_env.__file__).parent
    files = [file for part in _PARTS for file in sorted([root / part] if part.endswith(".py") else (root / part).rglob("*.py"))]
    found = hashlib.sha256()
    for file in files:
        found.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()


def answer(campaign: Path) -> dict[str, Any]:
    """Diagnose one campaign; one that the diagnosis refuses is an answer too.

    To what `wsp diagnose` writes, `distance_change` is added where something is named.
    """
    try:
        recorded = quietly_read(campaign)
        said = diagnose(recorded, workers=1).to_json()
    except CampaignError as error:
        return {"verdict": "insufficient", "mechanisms": [], "notes": [str(error)]}
    return said | ({"distance_change": distance_change(recorded, said)} if said["mechanisms"] else {})


def _one(folders: tuple[Path, Path]) -> None:
    campaign, out = folders
    write_whole(out / "diagnosis.json", answer(campaign))


def run(out: Path, jobs: int) -> None:
    """Diagnose every case of the bank that has no answer yet.

    Raises
    ------
    BankError
        when the answers that are there are another version's: they would be mixed

    """
    names, folder = list(read_labels(out)), out / "diagnoses"
    version, now = folder / "version.json", {"sha256": digest()}
    if version.is_file() and json.loads(version.read_text(encoding="utf-8")) != now:
        raise BankError(f"{folder} holds answers of another version of the diagnosis: remove the folder to diagnose anew")
    write_whole(version, now)
    todo = [(out / "campaigns" / name, folder / name) for name in names if not (folder / name / "diagnosis.json").is_file()]
    each(_one, todo, jobs, "diagnoses")
