"""HTML pages: the message first, the rest behind folds, plots that are drawn when they are first seen.

Plots need plotly's library, 5 MB. A page does not carry it unless it is asked to stand alone: it loads the library from
plotly's server, checked against its SHA-256. Without a network the first plot is a picture, and the others say what they need.
"""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.output import OutputError, all_of, write_text, write_whole
from wsp_env.report.paper import browser, printed
from wsp_env.report.parts import COLOURS, Facts, Figure, Links, Origin, Section, Table, plotly
from wsp_env.report.style import SCRIPT, STYLE
from wsp_env.report.workbook import workbook

_HASH_SHOWN = 12  # digits of a file's SHA-256, enough to tell files apart
_TYPED_FROM = 20  # numbers of a plot from which on they are written as 32-bit floats: seven digits are more than a screen shows
_DIGITS = 6  # of other numbers of a plot


@dataclass(frozen=True)
class PageOptions:
    """How a report is written.

    Parameters
    ----------
    standalone
        The page carries plotly's library (5 MB) and needs no network for its plots.
    pdf
        Also write the page as PDF; needs Chromium or Chrome.
    excel
        Also write every table of the page into an Excel file.
    author
        Who answers for the report, for its footer; a semicolon begins a new line.

    """

    standalone: bool = False
    pdf: bool = False
    excel: bool = False
    author: str = ""

    def files(self, page: Path) -> tuple[Path, ...]:
        """Return all files of a report; `OutputError` where one cannot be had, so that it is known before the work."""
        if self.pdf and browser() is None:
            raise OutputError(
                "--pdf needs Chromium or Google Chrome on the PATH, and there is none; any browser can print the page to a PDF"
            )
        named = [page, *([page.with_suffix(".pdf")] if self.pdf else []), *([page.with_suffix(".xlsx")] if self.excel else [])]
        return tuple(named)


def write_page(
    path: Path,
    title: str,
    lead: str,
    sections: Sequence[Section],
    origin: Origin | None = None,
    options: PageOptions = PageOptions(),
) -> None:
    """Write the page, and what else the options ask for; each file is replaced whole or not at all."""
    plotly()

    def body(standalone: bool) -> str:
        return _document(title, lead, sections, origin, PageOptions(standalone, author=options.author))

    steps = [lambda: write_text(path, body(options.standalone))]
    if options.excel:
        book = workbook(sections)
        steps.append(lambda: write_whole(path.with_suffix(".xlsx"), lambda stream: stream.write(book)))
    if options.pdf:
        steps.append(lambda: _print(path.with_suffix(".pdf"), body(True)))
    all_of(*steps)


def _print(path: Path, text: str) -> None:
    content = printed(text)
    write_whole(path, lambda stream: stream.write(content))


def _document(title: str, lead: str, sections: Sequence[Section], origin: Origin | None, options: PageOptions) -> str:
    body = [f"<h1>{html.escape(title)}</h1>", f'<p class="lead">{html.escape(lead)}</p>']
    plots = [one for section in sections for one in section.shows if hasattr(one, "to_plotly_json")]
    for section in sections:
        heading = f"<h2>{html.escape(section.title)}</h2>" if section.title else ""
        inside = [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.text]
        inside += [
            _show(one, still=any(one is first for first in plots[:1]) and not options.standalone) for one in section.shows
        ]
        body += [f"<details><summary>{heading}</summary>", *inside, "</details>"] if section.fold else [heading, *inside]
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style>'
        f"{_library(options.standalone)}</head><body>{''.join(body)}"
        f"<footer>{html.escape(_footer(origin, options.author))}</footer><script>{SCRIPT}</script></body></html>"
    )


def _library(standalone: bool) -> str:
    from plotly.offline import get_plotlyjs, get_plotlyjs_version

    source = get_plotlyjs()
    if standalone:
        return f"<script>{source}</script>"
    digest = base64.b64encode(hashlib.sha256(source.encode("utf-8")).digest()).decode()
    address = f"https://cdn.plot.ly/plotly-{get_plotlyjs_version()}.min.js"
    return f'<script src="{address}" integrity="sha256-{digest}" crossorigin="anonymous"></script>'


def _footer(origin: Origin | None, author: str) -> str:
    lines = [line.strip() for line in author.replace(";", "\n").splitlines()]
    if origin is not None:
        package = import_module(__name__.partition(".")[0])  # by its name: a page lies below all that the package imports
        version, made = origin.version or package.__version__, origin.made or date.today().isoformat()
        lines.append(f"Written by {origin.command} (wsp-env {version}) on {made}")
        lines += [f"Vehicle: {origin.vehicle}"] if origin.vehicle else []
        if origin.files:
            files = ", ".join(f"{name} {digest[:_HASH_SHOWN]}" for name, digest in origin.files)
            lines.append(f"Files, each with the first {_HASH_SHOWN} digits of its SHA-256: {files}")
        lines += origin.notes
    return "\n".join(lines)


def _show(one: Facts | Links | Table | Figure, still: bool) -> str:
    if isinstance(one, Facts):
        rows = "".join(f"<dt>{html.escape(label)}</dt><dd>{html.escape(text)}</dd>" for label, text in one.rows)
        return f"<dl>{rows}</dl>"
    if isinstance(one, Links):
        rows = "".join(f'<li><a href="{html.escape(to)}">{html.escape(words)}</a></li>' for to, words in one.rows)
        return f"<ul>{rows}</ul>"
    return table_html(one) if isinstance(one, Table) else _figure(one, still)


def _figure(figure: Any, still: bool) -> str:
    """Return a plot: its numbers, and a picture or a sentence for where the library cannot be had."""
    if not hasattr(figure, "to_plotly_json"):
        return str(figure.to_html())
    from wsp_env.report.still import picture

    drawn = picture(figure) if still else ""
    missing = (
        "This plot is drawn by plotly's library, which the page loads from the network; write the page with --standalone to do "
        "without."
    )
    shown = drawn or f'<p class="missing">{html.escape(missing)}</p>'
    known = figure.to_plotly_json()
    layout = {key: value for key, value in known["layout"].items() if key != "template"} | {"template": _template()}
    data = [_even(trace) for trace in known["data"]]
    numbers = json.dumps(_lean({"data": data, "layout": layout}), separators=(",", ":")).replace("<", "\\u003c")
    height = figure.layout.height or 450
    return (
        f'<div class="plot" style="min-height:{height:g}px"><div class="still">{shown}</div><div class="live"></div>'
        f'<script type="application/json">{numbers}</script></div>'
    )


def _template() -> dict[str, Any]:
    """Return the common look, what plotly's own template has of it that these plots use: it is 7 kB, for every plot."""
    grid = {"gridcolor": "#ebebeb", "linecolor": "#ccc", "zerolinecolor": "#ccc", "automargin": True, "title": {"standoff": 12}}
    look = {"paper_bgcolor": "white", "plot_bgcolor": "white", "font": {"color": "#222"}, "colorway": list(COLOURS[:6])}
    return {"layout": look | {"xaxis": grid, "yaxis": grid}}


def _even(trace: dict[str, Any]) -> dict[str, Any]:
    """Return a trace with the start and the step of its x in place of x, where it is even to a thousandth of a step."""
    x = _decoded(trace.get("x"))
    if not isinstance(x, np.ndarray) or x.ndim != 1 or x.dtype.kind != "f" or len(x) < _TYPED_FROM:
        return trace
    step = (x[-1] - x[0]) / (len(x) - 1)
    if not np.isfinite(x).all() or (np.abs(x - x[0] - step * np.arange(len(x))) > 1e-3 * abs(step)).any():
        return trace
    return {key: value for key, value in trace.items() if key != "x"} | {"x0": float(x[0]), "dx": float(step)}


def _decoded(value: Any) -> Any:
    """Return an array that plotly has encoded for its page as an array again; anything else as it is."""
    if isinstance(value, dict) and set(value) == {"dtype", "bdata"}:
        return np.frombuffer(base64.b64decode(value["bdata"]), dtype=f"<{value['dtype']}")
    return value


def _lean(value: Any) -> Any:
    """Return a plot's numbers in few bytes; what is no finite number becomes a gap."""
    value = _decoded(value)
    if isinstance(value, dict):
        return {key: _lean(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _lean(value.tolist())
    if isinstance(value, list | tuple):
        if len(value) >= _TYPED_FROM and all(type(item) in (float, int) for item in value):
            typed = np.asarray(value, dtype="<f4")
            return {"dtype": "f4", "bdata": base64.b64encode(typed.tobytes()).decode()}
        return [_lean(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def table_html(table: Table) -> str:
    """Return a table as an element."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    rows = "".join(row(cells, "td") for cells in table.rows)
    return f'<div class="scroll"><table>{caption}<thead>{row(table.header, "th")}</thead>{rows}</table></div>'
