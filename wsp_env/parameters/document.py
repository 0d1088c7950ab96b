"""Documents that anybody may have written, in TOML or JSON: read within limits, and refused with one clause.

`tomllib` and `json` raise what their recursion runs into. Here a document is looked at before it is parsed and after. Whole
numbers may be beyond the floats: `quantity.number` takes them.
"""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

#: Bytes of a document: those of this project have some thousand, and TOML is parsed at about a million bytes a second.
MOST_BYTES = 1_000_000

#: Levels of brackets, or of dotted keys: documents of this project have four; the parsers give up at some hundreds.
DEEPEST = 50

_QUOTED = re.compile(r'"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'")
_COMMENT = re.compile(r"#[^\n]*")


class DocumentError(ValueError):
    """What is wrong with a document, as a clause that goes on after its name."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return a TOML document; `DocumentError` for a file that cannot be read, is no TOML or beyond the limits."""
    text = _text(path)
    bare = _COMMENT.sub("", _QUOTED.sub("''", text))
    if any(line.partition("=")[0].count(".") > DEEPEST for line in bare.splitlines()):
        raise DocumentError(f"is not valid TOML: a key in it has more than {DEEPEST} dots")
    _check_depth(bare, "TOML")
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"is not valid TOML: {_why(error)}") from None
    _check_values(document)
    return document


def read_json(path: Path) -> Any:
    """Return what a JSON file holds; `DocumentError` for a file that cannot be read, is no JSON or beyond the limits."""
    text = _text(path)
    _check_depth(_QUOTED.sub("", text), "JSON")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"is not JSON: {_why(error)}") from None
    _check_values(document)
    return document


def _text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise DocumentError(f"cannot be read: it is {'a folder; name the file in it' if path.is_dir() else 'no file'}")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise DocumentError(f"cannot be read: {error.strerror or error}") from None
    except DocumentError:
        raise
    except ValueError:  # a zero byte in its name
        raise DocumentError("cannot be read: no file can be called so") from None
    if len(content) > MOST_BYTES:
        raise DocumentError(f"is larger than {MOST_BYTES} bytes")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DocumentError("is no text in UTF-8") from None


def _check_depth(bare: str, form: str) -> None:
    """Refuse a text (without what is in quotes) whose brackets are nested too deep."""
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", bare):
        depth += 1 if bracket in "[{" else -1
        if depth > DEEPEST:
            raise DocumentError(f"is not valid {form}: nested too deep, beyond {DEEPEST} levels")


def _check_values(document: Any) -> None:
    """Refuse text that cannot be written out again."""
    waiting = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += [*value.keys(), *value.values()]
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str) and not _is_writable(value):
            raise DocumentError("holds a text with half a character (a lone surrogate)")


def _is_writable(text: str) -> bool:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _why(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "nested too deep"
    if "digits" in str(error):  # Python's limit, with advice that is of no use here
        return "it holds a number of thousands of digits"
    return str(error)
