"""What the commands of the pages print: run when the documentation is built, and written below them as in a terminal.

A page marks a block by a line `<!-- run -->` before it: of `console`, whose lines with `$ ` are run, or of `python`, followed
by a block of `text` for what it prints. `<!-- run 12 -->` keeps the first twelve lines. Every page has a folder of its own,
with the recordings that travel with the package: `demo`, `concealed` and `eurosprinter`.

`python docs/outputs.py` puts the outputs into the pages, `python docs/outputs.py tuning.md` into one of them.
"""

import contextlib
import hashlib
import io
import json
import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

DOCS = Path(__file__).parent
CACHE = DOCS / "_build" / "outputs.json"

_BLOCK = re.compile(
    r"^<!-- run(?: (?P<most>\d+))? -->\n"
    r"(?:```console\n(?P<console>.*?)^```|```python\n(?P<python>.*?)^```\n\n?```text\n.*?^```)",
    re.DOTALL | re.MULTILINE,
)
_WIDTH = "118"  # of tables [characters]


def filled(text: str) -> str:
    """Return a page with what its marked blocks print."""
    if not _BLOCK.search(text):
        return text
    with _workplace():
        names: dict[str, object] = {"__name__": "__main__"}
        return _BLOCK.sub(lambda match: _shown(match, names), text)


def kept(text: str) -> str:
    """Return the same, from what the same commands and the same sources have printed before where that is known."""
    key = hashlib.sha256(f"{_sources()}{text}".encode()).hexdigest()
    known: dict[str, str] = json.loads(CACHE.read_text(encoding="utf-8")) if CACHE.exists() else {}
    if key not in known and _BLOCK.search(text):
        known[key] = filled(text)
        CACHE.parent.mkdir(parents=True, exist_ok=True)
        CACHE.write_text(json.dumps(known), encoding="utf-8")
    return known.get(key, text)


def words(text: str) -> list[str]:
    """Return what must not differ between a page and what is printed anew: its words, without numbers and signs."""
    return re.findall(r"[a-zA-Z_]{2,}", text)


def _shown(match: re.Match[str], names: dict[str, object]) -> str:
    most = int(match["most"] or 10**6)
    head = match[0].partition("\n")[0]
    if match["python"] is not None:
        said = _printed(lambda: exec(compile(match["python"], "page", "exec"), names))
        return f"{head}\n```python\n{match['python']}```\n\n```text\n{_cut(said, most)}```"
    lines = []
    for command in _commands(match["console"]):
        lines.append(f"$ {command}\n{_cut(_run(command), most)}")
    return f"{head}\n```console\n{''.join(lines)}```"


def _commands(console: str) -> list[str]:
    return [line.removeprefix("$ ") for line in console.splitlines() if line.startswith("$ ")]


def _run(command: str) -> str:
    from wsp_env.cli import main

    line, _, file = command.partition(" > ")
    program, *arguments = shlex.split(line, comments=True)
    if program != "wsp":
        raise ValueError(f"only wsp is run: {command}")

    def run() -> None:
        code = main(arguments)
        if code:
            raise RuntimeError(f"{command} ended with {code}")

    said = _printed(run)
    if file:
        Path(file.strip()).write_text(said, encoding="utf-8")
        return ""
    return said


def _printed(act: Callable[[], object]) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            act()
        except BaseException:
            sys.__stderr__.write(said.getvalue())
            raise
    lines = (line.rstrip() for line in said.getvalue().splitlines())
    return "".join(f"{line}\n" for line in lines if not re.match(r"wsp: +\d+%: ", line))  # progress in a log


def _cut(said: str, most: int) -> str:
    lines = said.splitlines(keepends=True)
    return said if len(lines) <= most else "".join([*lines[:most], "...\n"])


@contextlib.contextmanager
def _workplace() -> Iterator[None]:
    """Work in a new folder with the package's campaigns."""
    from wsp_env.recordings import concealed_campaign, demo_campaign
    from wsp_env.recordings.creep_curves import eurosprinter_curve

    named = {"demo": demo_campaign(), "concealed": concealed_campaign(), "eurosprinter": eurosprinter_curve()}

    before, width = Path.cwd(), os.environ.get("COLUMNS")
    with tempfile.TemporaryDirectory() as place:
        for name, folder in named.items():
            shutil.copytree(folder, Path(place) / name)
        os.chdir(place)
        os.environ["COLUMNS"] = _WIDTH
        try:
            yield
        finally:
            os.chdir(before)
            os.environ.pop("COLUMNS")
            if width is not None:
                os.environ["COLUMNS"] = width


def _sources() -> str:
    digest = hashlib.sha256()
    for package in ("wsp_env", "baselines"):
        for file in sorted((DOCS.parent / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()


def main() -> None:
    """Put the outputs into the pages."""
    for name in sys.argv[1:] or sorted(one.name for one in DOCS.glob("*.md")):
        page = DOCS / name
        text = page.read_text(encoding="utf-8")
        anew = filled(text)
        if anew != text:
            page.write_text(anew, encoding="utf-8")
            print(f"{name}: written anew")


if __name__ == "__main__":
    main()
