"""Self-contained HTML pages: text, tables and interactive plots that need no network."""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from wsp_env.output import write_text

if TYPE_CHECKING:
    import rich.table

#: One colour for the same thing on every page (Okabe and Ito's palette, told apart by colour-blind readers too).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; margin-bottom: .3rem; } h2 { font-size: 1.25rem; margin: 2.2rem 0 .4rem; }
p { max-width: 46rem; } .lead { font-size: 1.1rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid #ddd; } th { background: #f4f4f4; }
th:first-child, td:first-child { text-align: left; } caption { caption-side: bottom; text-align: left; color: #666; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1.2rem; margin: .8rem 0; max-width: 62rem; }
dt { color: #666; } dd { margin: 0; }
details { border-top: 1px solid #ddd; padding: .5rem 0; } summary { cursor: pointer; }
summary h2 { display: inline; font-size: 1.1rem; margin: 0; }
footer { white-space: pre-line; margin-top: 3rem; color: #777; font-size: .85rem; }
"""

#: What was drawn while a fold hid it is drawn again at its true size; on paper all folds are open.
_FOLDS = """
const draw = fold => fold.querySelectorAll(":scope .plotly-graph-div").forEach(plot => Plotly.Plots.resize(plot));
document.querySelectorAll("details").forEach(fold => fold.addEventListener("toggle", () => fold.open && draw(fold)));
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(fold => { fold.open = true; draw(fold); }));
"""


@dataclass(frozen=True)
class Facts:
    """What is said beside labels, in rows (label, text)."""

    rows: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Table:
    """A table of text cells; the first column is a label."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


class Figure(Protocol):
    """What a page can draw: plotly's figures, and whatever makes its own HTML."""

    def to_html(self, **options: object) -> str:
        """Return the element."""


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, and then tables and plotly figures in their order."""

    title: str  # "": none
    text: Sequence[str] = ()
    shows: Sequence[Facts | Table | Figure] = field(default_factory=tuple)
    fold: bool = False  # hidden until its heading is clicked


def plotly() -> tuple[Any, Any]:
    """Return `plotly.graph_objects` and `plotly.subplots`; the error names the extra that brings them."""
    try:
        import plotly.graph_objects as objects
        from plotly import subplots
    except ImportError:
        raise ModuleNotFoundError('the report needs plotly: pip install "wsp-env[report]"') from None
    return objects, subplots


def axes(figure: Any, x: str, y: str, **options: Any) -> Any:
    """Give a figure its axis titles (quantity and unit) and the pages' common look; return it."""
    figure.update_layout(template="plotly_white", margin={"l": 70, "r": 20, "t": 50, "b": 60}, hovermode="closest", **options)
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(title_text=y)
    return figure


def write_page(path: Path, title: str, lead: str, sections: Sequence[Section], footer: str = "") -> None:
    """Write the page; a page that was there is replaced whole or not at all."""
    from plotly.offline import get_plotlyjs

    body = [f"<h1>{html.escape(title)}</h1>", f'<p class="lead">{html.escape(lead)}</p>']
    for section in sections:
        heading = f"<h2>{html.escape(section.title)}</h2>" if section.title else ""
        inside = [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.text] + [_show(one) for one in section.shows]
        body += [f"<details><summary>{heading}</summary>", *inside, "</details>"] if section.fold else [heading, *inside]
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style>'
        f"<script>{get_plotlyjs()}</script></head><body>{''.join(body)}"
        f"<footer>{html.escape(footer)}</footer><script>{_FOLDS}</script></body></html>"
    )
    write_text(path, page)


def _show(one: Facts | Table | Figure) -> str:
    if isinstance(one, Facts):
        rows = "".join(f"<dt>{html.escape(label)}</dt><dd>{html.escape(text)}</dd>" for label, text in one.rows)
        return f"<dl>{rows}</dl>"
    return _table(one) if isinstance(one, Table) else _figure(one)


def _figure(figure: Figure) -> str:
    return figure.to_html(full_html=False, include_plotlyjs=False, config={"displaylogo": False, "responsive": True})


def _table(table: Table) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    rows = "".join(row(cells, "td") for cells in table.rows)
    return f'<div class="scroll"><table>{caption}{row(table.header, "th")}{rows}</table></div>'


def terminal_table(table: Table) -> "rich.table.Table":
    """Return the same table for the terminal (a `rich` table)."""
    from rich.markup import escape  # a unit in brackets is no markup
    from rich.table import Table as Rich

    shown = Rich(title=None, caption=table.caption or None, caption_justify="left", header_style="bold")
    for index, name in enumerate(table.header):
        shown.add_column(escape(name), justify="left" if index == 0 else "right")
    for cells in table.rows:
        shown.add_row(*(escape(str(cell)) for cell in cells))
    return shown
