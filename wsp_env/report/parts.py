"""What a page is made of: facts, tables, plots, sections, and what it was made from."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import rich.table

#: One colour for the same thing on every page (Okabe and Ito's palette, told apart by colour-blind readers too).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")


@dataclass(frozen=True)
class Facts:
    """What is said beside labels, in rows (label, text)."""

    rows: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Links:
    """Other pages, in rows (address relative to this page, words)."""

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
    shows: Sequence[Facts | Links | Table | Figure] = field(default_factory=tuple)
    fold: bool = False  # hidden until its heading is clicked


@dataclass(frozen=True)
class Origin:
    """What a page was made from; its footer says it."""

    command: str  # that wrote it, as "wsp diagnose"
    vehicle: str = ""  # in a line
    files: Sequence[tuple[str, str]] = ()  # name and SHA-256
    made: str = ""  # day, as 2026-01-31; "": today
    version: str = ""  # of this package; "": this one
    notes: Sequence[str] = ()


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
