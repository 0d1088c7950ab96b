"""Puts the figures of scored campaigns into the pages of the proof (`PAGES`): their tables and pictures."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.concealed.errors import BankError
from experiments.concealed.figures import COMPARED, draw, of
from experiments.concealed.rates import NO_CASE, percent, put, restored
from experiments.concealed.required import Check, checks, common

PAGES, PICTURES = ("concealed.md", "concealed_figures.md", "lab/concealed_others.md"), "concealed"
#: The rivals in words, by the names of their folders.
RIVALS = {"bic": "BIC only", "held_out": "held-out only", "black_box": "black box"}
#: Folder, beside the bank's answers, of those to other people's campaigns.
OUTSIDE = "outside"
_BLOCK = re.compile(r"(<!-- begin: (?P<name>\w+) -->\n).*?(<!-- end: (?P=name) -->)", re.DOTALL)


class Bank(NamedTuple):
    """What identifies a bank."""

    command: str
    labels: str  # SHA-256
    version: dict[str, str] | None  # of the diagnosis


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def compared(found: Sequence[Check]) -> str:
    """Return figures against what is required of them, as a table."""
    return table(["figure", "required", "measured", "met"], [[*one[:3], one.mark] for one in found])


def grouped(groups: dict[str, dict[str, Any]]) -> str:
    """Return a table of the common figures for every group of campaigns; those without a case are left out."""
    tables = {name: [check for check in common(one) if check.measured != NO_CASE] for name, one in groups.items()}
    return "\n".join(f"{name[0].upper()}{name[1:]}:\n\n{compared(one)}" for name, one in tables.items())


def others(scored: dict[str, Any]) -> str:
    """Return the tables of one set of other people's campaigns."""
    head = f"### {scored['title']}\n\n{identified(scored['code'], scored['labels'])}\n"
    parts = grouped(scored["groups"])
    return head + compared(common(scored["promised"])) + (f"\n{parts}" if parts else "")


def identified(version: dict[str, str] | None, labels: str) -> str:
    """Say in a paragraph of what version of the diagnosis figures are, and of which labels."""
    if version is None:
        return f"Version of the diagnosis: not noted. SHA-256 of the labels: `{labels}`.\n"
    return (
        f"Diagnosed with release {version.get('release', 'not noted')}, SHA-256 of the code `{version['sha256']}`. "
        f"SHA-256 of the labels: `{labels}`.\n"
    )


def blocks(
    figures: dict[str, Any], rivals: dict[str, dict[str, Any]], bank: Bank, outside: Sequence[dict[str, Any]]
) -> dict[str, str]:
    """Return the text of every generated block.

    Parameters
    ----------
    rivals : the same figures of every rival, by its name in words
    outside : what `outside.score` wrote, of every set of other people's campaigns

    """
    cases = figures["cases"]
    kinds = ", ".join(f"{count} {kind}" for kind, count in cases.items())
    required = checks(figures)
    contestants = {"wsp diagnose": figures} | rivals
    against = [[what, *(put(of(one, path)) for one in contestants.values())] for what, path in COMPARED.items()]
    return {
        "bank": f"{identified(bank.version, bank.labels)}\n"
        + table(["", ""], [["cases", f"{sum(cases.values())}: {kinds}"], ["command", bank.command]]),
        "required": compared(required),
        "groups": grouped(figures["groups"]) or "All cases are of one group.\n",
        "outside": "\n".join(others(one) for one in outside) or "No campaigns of others were diagnosed.\n",
        "missed": _missed({"this bank": required} | {one["title"]: common(one["promised"]) for one in outside}),
        "power": _picture("power", "Power by size and noise") + _power(figures),
        "effects": _effects(figures),
        "confusion": _picture("confusion", "First names answered by what is true") + _foreign(figures),
        "parameters": _parameters(figures),
        "calibration": _picture("calibration", "Stated confidence and share that is true") + _calibration(figures),
        "rivals": _picture("rivals", "Rivals on the same bank") + table(["figure", *contestants], against),
    }


def _missed(truths: dict[str, list[Check]]) -> str:
    missed = [[truth, *one[:3]] for truth, found in truths.items() for one in found if one.met is False]
    if not missed:
        return "Every figure is as required.\n"
    return table(["campaigns", "figure", "required", "measured"], missed)


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
        ["nulls: alarms", put(figures["promised"]["false_alarms"])],
        ["outside the library: seen", put(figures["promised"]["outside_seen"])],
        ["outside the library: called by a library name", put(figures["promised"]["outside_named"])],
        ["pairs: both found", put(figures["promised"]["pairs_both"])],
        ["pairs: one found", put(figures["pairs_one_found"])],
        ["confounded: not named wrongly", put(figures["confounded_honest"])],
    ]
    return table(["class", "share"], rows)


def _parameters(figures: dict[str, Any]) -> str:
    parameters, removed = figures["promised"]["parameters"], figures["removed_share"]
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
    one = figures["promised"]["calibration"]
    if not one["claims"]:
        return "Nothing was named.\n"
    return (
        f"{one['claims']} names were given. Brier score {one['brier']:.3f}; expected calibration error "
        f"{one['expected_error']:.3f}. The numbers beside the points count the names.\n"
    )


def fill(out: Path, docs: Path) -> None:
    """Fill the pages' blocks and draw their pictures from a scored bank, and from others' campaigns scored beside it.

    Raises
    ------
    BankError
        when the bank has not been scored, or the pages' markers are not those of the blocks

    """
    score, pages = out / "score.json", [docs / name for name in PAGES]
    if not score.is_file():
        raise BankError(f"{out} holds no score.json: run `score --out {out}` first")
    figures = _read(score)
    files = {words: out / "rivals" / name / "score.json" for name, words in RIVALS.items()}
    rivals = {words: _read(file) for words, file in files.items() if file.is_file()}
    made = blocks(figures, rivals, _bank(out), [_read(file) for file in sorted((out / OUTSIDE).glob("*/score.json"))])
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    marked = [match["name"] for text in texts.values() for match in _BLOCK.finditer(text)]
    if sorted(marked) != sorted(made):
        raise BankError(
            f"{docs / PAGES[0]} and the pages beside it have markers for {', '.join(marked)}; "
            f"expected each once: {', '.join(made)}"
        )
    draw(figures, rivals, docs / PICTURES)
    for page, text in texts.items():
        page.write_text(_BLOCK.sub(lambda match: match[1] + made[match["name"]] + match[3], text), encoding="utf-8")


def _read(file: Path) -> dict[str, Any]:
    read: dict[str, Any] = restored(json.loads(file.read_text(encoding="utf-8")))
    return read


def _bank(out: Path) -> Bank:
    head = json.loads((out / "bank.json").read_text(encoding="utf-8"))
    version = out / "diagnoses" / "version.json"
    return Bank(
        f"`python -m experiments.concealed bank --cases {head['cases']} --seed {head['seed']}`",
        (out / "labels.sha256").read_text(encoding="utf-8").split()[0],
        json.loads(version.read_text(encoding="utf-8")) if version.is_file() else None,
    )
