"""Pages that one forwards: text, tables and interactive plots in one HTML file, and the same as PDF and for Excel."""

from wsp_env.report.page import PageOptions, write_page
from wsp_env.report.parts import COLOURS, Facts, Figure, Links, Origin, Section, Table, axes, plotly, terminal_table

__all__ = [
    "COLOURS",
    "Facts",
    "Figure",
    "Links",
    "Origin",
    "PageOptions",
    "Section",
    "Table",
    "axes",
    "plotly",
    "terminal_table",
    "write_page",
]
