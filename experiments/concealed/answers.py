"""One campaign's answer, and of which version of the code the answers in a folder are."""

import hashlib
import json
import time
from pathlib import Path
from typing import Any

import wsp_env
from experiments.concealed.errors import BankError
from experiments.concealed.workers import quietly_read, write_whole
from wsp_env.diagnosis import diagnose
from wsp_env.recordings import Campaign, CampaignError

Answer = dict[str, Any]

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


def answer(folder: Path) -> tuple[Answer, Campaign | None]:
    """Diagnose one campaign and return it beside the answer; one that is refused is an answer too, without a campaign.

    To what `wsp diagnose` writes, the `seconds` that it took are added.
    """
    begun = time.perf_counter()
    try:
        campaign = quietly_read(folder, refuse=False)
        said = diagnose(campaign, workers=1).to_json()
    except CampaignError as error:
        refused = {"verdict": "insufficient", "mechanisms": [], "notes": [str(error)]}
        return refused | {"seconds": time.perf_counter() - begun}, None
    return said | {"seconds": time.perf_counter() - begun}, campaign


def hold_version(folder: Path) -> None:
    """Note in a folder of which version its answers are.

    Raises
    ------
    BankError
        when the answers that are there are another version's: they would be mixed

    """
    file, now = folder / "version.json", {"sha256": digest(), "release": wsp_env.__version__}
    if file.is_file() and json.loads(file.read_text(encoding="utf-8"))["sha256"] != now["sha256"]:
        raise BankError(f"{folder} holds answers of another version of the diagnosis: remove the folder to diagnose anew")
    write_whole(file, now)


def read_answers(folder: Path) -> dict[str, Answer]:
    """Read every diagnosis.json below a folder, by the folder that it lies in; a rival's answers score the same way."""
    files = sorted(folder.rglob("diagnosis.json"))
    return {file.parent.relative_to(folder).as_posix(): json.loads(file.read_text(encoding="utf-8")) for file in files}
