"""Puts the figures of a scored bank into the page: every table and picture of docs/concealed.md is made here."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.concealed.bank import BankError
from experiments.concealed.figures import COMPARED, draw, of
from experiments.concealed.required import checks, percent, put
from experiments.concealed.rivals import NAMES
from experiments.concealed.score import restored

PAGE, PICTURES = "concealed.md", "concealed"
#: The rivals in words.
RIVALS = dict(zip(NAMES, ("BIC only", "held-out only", "black box"), strict=True))
_BLOCK = re.compile(r"(<!-- begin: (?P<name>\w+) -->\n).*?(<!-- end: (?P=name) -->)", re.DOTALL)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def blocks(figures: dict[str, Any], rivals: dict[str, dict[str, Any]], bank: dict[str, str]) -> dict[str, str]:
    """Return the text of every generated block.

    Parameters
    ----------
    rivals : the same figures of every rival, by its name in words
    bank : what identifies it, in words

    """
    cases, words = figures["cases"], {True: "yes", False: "**no**", None: "nothing to measure"}
    kinds = ", ".join(f"{count} {kind}" for kind, count in cases.items())
    required = [[one.what, one.required, one.measured, words[one.met]] for one in checks(figures)]
    contestants = {"wsp diagnose": figures} | rivals
    compared = [[what, *(put(of(one, path)) for one in contestants.values())] for what, path in COMPARED.items()]
    return {
        "bank": table(["", ""], [["cases", f"{sum(cases.values())}: {kinds}"], *([key, value] for key, value in bank.items())]),
        "required": table(["figure", "required", "measured", "met"], required),
        "missed": _missed(required),
        "power": _picture("power", "Power by size and noise") + _power(figures),
        "effects": _effects(figures),
        "confusion": _picture("confusion", "First names answered by what is true") + _foreign(figures),
        "parameters": _parameters(figures),
        "calibration": _picture("calibration", "Stated confidence and share that is true") + _calibration(figures),
        "rivals": _picture("rivals", "Rivals on the same bank") + table(["figure", *contestants], compared),
    }


def _missed(required: list[list[str]]) -> str:
    missed = [row[:3] for row in required if row[3] == "**no**"]
    if not missed:
        return "Every figure is as required.\n"
    return table(["figure", "required", "measured"], missed)


def _picture(name: str, text: str) -> str:
    return f"![{text}]({PICTURES}/{name}.png)\n\n"


def _power(figures: dict[str, Any]) -> str:
    rows = [
        [noise, size, *(put(rates[key]) for key in ("seen", "right_name_first", "in_set"))]
        for noise, by_size in figures["power"].items()
        for size, rates in by_size.items()
        if rates["seen"].of
    ]
    return table(["noise", "size", "seen", "right name first", "in a reported set"], rows)


def _effects(figures: dict[str, Any]) -> str:
    groups = {
        "all separable": figures["separable"],
        "those beyond normal variation": figures["separable_beyond_variation"],
        "sensor faults": figures["sensor_faults"],
        **figures["separable_by_effect"],
    }
    keys = ("seen", "right_name_first", "in_set_of_two", "in_set", "others_too")
    rows = [
        [name.replace("_", " "), *(f"{r[k].events} of {r[k].of}" for k in keys)] for name, r in groups.items() if r["seen"].of
    ]
    return table(["effect", "seen", "right name first", "in a set of two", "in a set", "others named too"], rows)


def _foreign(figures: dict[str, Any]) -> str:
    rows = [
        ["nulls: alarms", put(figures["false_alarms"])],
        ["outside the library: seen", put(figures["foreign_seen"])],
        ["outside the library: called by a library name", put(figures["foreign_named_wrongly"])],
        ["pairs: both found", put(figures["pairs_both_found"])],
        ["pairs: one found", put(figures["pairs_one_found"])],
        ["confounded: not named wrongly", put(figures["confounded_honest"])],
    ]
    return table(["class", "share"], rows)


def _parameters(figures: dict[str, Any]) -> str:
    parameters, removed = figures["parameters"], figures["removed_share"]
    groups = {"all": parameters, **parameters["by_effect"]}
    rows = [
        [name.replace("_", " "), str(one["relative_error"]["count"]), percent(one["relative_error"]["median"]),
         put(one["within_tolerance"]), put(one["interval90_covers"])]
        for name, one in groups.items()
    ]  # fmt: skip
    shares = [
        [what, str(removed[key]["count"]), percent(removed[key]["mean"]), percent(removed[key]["median"])]
        for key, what in (("named", "of each that names something"), ("all", "of each, named or not"))
    ]
    distances = figures["distance_change"]
    claims = [
        [str(distances["error"]["count"]), *(percent(distances[key]["mean"]) for key in ("truth", "error")),
         percent(distances["error"]["highest"]), put(distances["interval90_covers"])]
    ]  # fmt: skip
    return "\n".join([
        table(["parameter of", "cases", "median error", "within 20 %", "90 % interval covers"], rows),
        table(["change of distance: cases", "mean", "mean error", "largest error", "90 % interval covers"], claims),
        table(["removable held-out residual removed", "cases", "mean", "median"], shares),
        f"Summed over all singles and pairs, {percent(removed['of_sums'])} of the removable residual is removed.\n",
    ])  # fmt: skip


def _calibration(figures: dict[str, Any]) -> str:
    one = figures["calibration"]
    if not one["claims"]:
        return "Nothing was named.\n"
    return (
        f"{one['claims']} names were given. Brier score {one['brier']:.3f}; expected calibration error "
        f"{one['expected_error']:.3f}. The numbers beside the points count the names.\n"
    )


def fill(out: Path, docs: Path) -> None:
    """Fill the page's blocks and draw its pictures from a scored bank.

    Raises
    ------
    BankError
        when the bank has not been scored, or the page's markers are not those of the blocks

    """
    score, page = out / "score.json", docs / PAGE
    if not score.is_file():
        raise BankError(f"{out} holds no score.json: run `score --out {out}` first")
    figures = restored(json.loads(score.read_text(encoding="utf-8")))
    read = {words: out / "rivals" / name / "score.json" for name, words in RIVALS.items()}
    rivals = {words: restored(json.loads(file.read_text(encoding="utf-8"))) for words, file in read.items() if file.is_file()}
    made = blocks(figures, rivals, _identity(out))
    text = page.read_text(encoding="utf-8")
    marked = [match["name"] for match in _BLOCK.finditer(text)]
    if sorted(marked) != sorted(made):
        raise BankError(f"{page} has markers for {', '.join(marked)}; expected each once: {', '.join(made)}")
    draw(figures, rivals, docs / PICTURES)
    page.write_text(_BLOCK.sub(lambda match: match[1] + made[match["name"]] + match[3], text), encoding="utf-8")


def _identity(out: Path) -> dict[str, str]:
    head = json.loads((out / "bank.json").read_text(encoding="utf-8"))
    reported = {
        "command": f"`python -m experiments.concealed bank --cases {head['cases']} --seed {head['seed']}`",
        "SHA-256 of the labels": f"`{(out / 'labels.sha256').read_text(encoding='utf-8').split()[0]}`",
    }
    version = out / "diagnoses" / "version.json"
    if version.is_file():
        reported["SHA-256 of the code diagnosed with"] = f"`{json.loads(version.read_text(encoding='utf-8'))['sha256']}`"
    return reported
