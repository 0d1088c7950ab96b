"""The page docs/measured.md: tables, its generated blocks, its pictures."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.measured.files import MeasuredError

PAGE, PICTURES = "measured.md", "measured"
_BLOCK = re.compile(r"(<!-- begin: (?P<name>\w+) -->\n).*?(<!-- end: (?P=name) -->)", re.DOTALL)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def fill(docs: Path, blocks: dict[str, str]) -> None:
    """Put generated blocks into the page; those of other names stay as they are.

    Raises
    ------
    MeasuredError : if there is no page, or it has not all these blocks

    """
    file = docs / PAGE
    if not file.is_file():
        raise MeasuredError(f"no page {file}: run this in the folder of the repository")
    text = file.read_text(encoding="utf-8")
    missing = set(blocks) - {match["name"] for match in _BLOCK.finditer(text)}
    if missing:
        raise MeasuredError(f"{file} has no place for {', '.join(sorted(missing))}")
    filled = _BLOCK.sub(lambda m: m[1] + blocks[m["name"]] + m[3] if m["name"] in blocks else m[0], text)
    file.write_text(filled, encoding="utf-8")


def pyplot() -> Any:
    """Return matplotlib's pyplot, without a window."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError:
        raise ModuleNotFoundError('the pictures need matplotlib: pip install "wsp-env[report]"') from None
    return plt


def save(plt: Any, figure: Any, docs: Path, name: str) -> None:
    """Write a picture of the page; the same bytes from the same figures."""
    folder = docs / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.png", dpi=80, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)
