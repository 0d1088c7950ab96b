"""A picture of a plot for where plotly's library cannot be had: the same lines, bars and titles, as SVG by matplotlib."""

import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

_WIDTH_PX, _DPI = 1040, 100
_POINTS = 400  # of a line or cloud: a picture is for the first look
_MARKER = {"circle": "o", "circle-open": "o", "diamond": "D", "square": "s", "x": "x"}
_DASH = {"solid": "-", "dot": ":", "dash": "--", "dashdot": "-."}


def picture(figure: Any) -> str:
    """Return a plotly figure of lines, marks and bars as an SVG element; "" without matplotlib, or for other kinds of plot."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure as Canvas
    except ImportError:
        return ""
    traces = [trace for trace in figure.data if trace.visible is not False]
    if not traces or any(trace.type not in ("scatter", "bar") for trace in traces):
        return ""
    layout = figure.layout
    height = layout.height or 450
    look: Any = {"svg.fonttype": "none", "svg.hashsalt": "wsp", "text.parse_math": False, "font.family": "sans-serif",
            "font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}  # fmt: skip
    with mpl.rc_context(look):
        canvas = Canvas(figsize=(_WIDTH_PX / _DPI, height / _DPI), dpi=_DPI)
        panels = {pair: _panel(canvas, layout, pair, height) for pair in dict.fromkeys(map(_pair, traces))}
        named: dict[str, Any] = {}
        stacked: dict[Any, np.ndarray] = {}
        for trace in traces:
            beside = [one for one in traces if one.type == "bar" and _pair(one) == _pair(trace)]
            drawn = _draw(panels[_pair(trace)], trace, stacked, [] if layout.barmode in ("relative", "stack") else beside)
            if trace.name and trace.showlegend is not False and trace.name not in named and drawn is not None:
                named[trace.name] = drawn
        for shape in layout.shapes:
            _shape(panels, shape)
        for note in layout.annotations:
            _note(canvas, panels, note, layout, height)
        if len(named) > 1 and layout.showlegend is not False:
            canvas.legend(named.values(), named.keys(), loc="upper right", ncols=len(named), frameon=False, fontsize=9)
        target = io.StringIO()
        canvas.savefig(target, format="svg", metadata={"Date": None})
    return re.sub(r"^.*?(?=<svg)", "", target.getvalue(), flags=re.DOTALL)


def _pair(trace: Any) -> tuple[str, str]:
    return trace.xaxis or "x", trace.yaxis or "y"


def _axis(layout: Any, name: str) -> Any:
    return layout[f"{name[0]}axis{name[1:]}"]


def _area(layout: Any, height: float) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of the plotting area, in shares of the picture."""
    left, right = (layout.margin.l or 70) / _WIDTH_PX, (layout.margin.r or 20) / _WIDTH_PX
    bottom, top = (layout.margin.b or 60) / height, (layout.margin.t or 50) / height
    return left, bottom, 1.0 - left - right, 1.0 - bottom - top


def _panel(canvas: Any, layout: Any, pair: tuple[str, str], height: float) -> Any:
    across, up = (_axis(layout, name) for name in pair)
    left, bottom, wide, high = _area(layout, height)
    x, y = (tuple(one.domain or (0.0, 1.0)) for one in (across, up))
    panel = canvas.add_axes((left + wide * x[0], bottom + high * y[0], wide * (x[1] - x[0]), high * (y[1] - y[0])))
    panel.grid(color="#ebebeb")
    panel.set_axisbelow(True)
    for axis, one in ((panel.xaxis, across), (panel.yaxis, up)):
        if one.type == "log":
            getattr(panel, f"set_{axis.axis_name}scale")("log")
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
        axis.set_label_text((one.title.text or "").replace("<br>", " "))
        axis.set_inverted(one.autorange == "reversed")
        if one.tickvals is not None:
            axis.set_ticks(list(one.tickvals), labels=[str(text) for text in one.ticktext or one.tickvals], minor=False)
        if one.showticklabels is False:
            axis.set_tick_params(which="both", labelbottom=False, labelleft=False)
        if one.range is not None:
            low, high_ = (10.0**edge if one.type == "log" else edge for edge in one.range)
            getattr(panel, f"set_{axis.axis_name}lim")(low, high_)
    return panel


def _draw(panel: Any, trace: Any, stacked: dict[Any, np.ndarray], beside: Sequence[Any]) -> Any:
    if trace.type == "bar":
        return _grouped(panel, trace, beside) if len(beside) > 1 else _bars(panel, trace, stacked)
    x, y = _values(trace.x), _values(trace.y)
    mode = trace.mode or "lines"
    if mode in ("lines", "markers") and trace.fill is None and trace.error_y.array is None:
        thin = slice(None, None, max(1, len(x) // _POINTS))
        x, y = x[thin], y[thin]
    colour = _colour(trace.line.color or _single(trace.marker.color))
    if trace.fill == "toself":
        return panel.fill(x, y, **_rgba(trace.fillcolor), linewidth=0)[0]
    style = {"color": colour, "linewidth": 0.8 * (trace.line.width or 2.0) if "lines" in mode else 0.0}
    style["linestyle"] = _DASH.get(trace.line.dash or "solid", "-") if "lines" in mode else "none"
    if "markers" in mode:
        size = trace.marker.size if isinstance(trace.marker.size, int | float) else 6.0
        symbol = _single(trace.marker.symbol)
        style |= {"marker": _MARKER.get(symbol or "circle", "o"), "markersize": 0.7 * size, "alpha": trace.marker.opacity}
        style["markerfacecolor"] = "none" if str(symbol).endswith("open") else _colour(_single(trace.marker.color)) or colour
    for axis, one in (("x", trace.error_x), ("y", trace.error_y)):
        if one is not None and one.array is not None:
            panel.errorbar(x, y, **{f"{axis}err": np.asarray(one.array, float)}, fmt="none", ecolor=colour, elinewidth=0.8)
    if "text" in mode and trace.text is not None:
        for at, up, text in zip(x, y, np.broadcast_to(np.asarray(trace.text), np.shape(x)), strict=True):
            panel.annotate(str(text), (at, up), (3, 3), textcoords="offset points", fontsize=7)
    return panel.plot(x, y, **style)[0]


def _bars(panel: Any, trace: Any, stacked: dict[Any, np.ndarray]) -> Any:
    lying = trace.orientation == "h"
    places, sizes = (trace.y, trace.x) if lying else (trace.x, trace.y)
    sizes = np.nan_to_num(np.asarray(sizes, float))
    key = (_pair(trace), tuple(np.asarray(places).tolist()))
    ends = stacked.setdefault(key, np.zeros((2, len(sizes))))
    side = (sizes > 0.0).astype(int)
    start = ends[side, np.arange(len(sizes))].copy()
    ends[side, np.arange(len(sizes))] += sizes
    labels = [str(place) for place in places]
    colour = _colour(_single(trace.marker.color))
    return (
        panel.barh(labels, sizes, left=start, color=colour) if lying else panel.bar(labels, sizes, bottom=start, color=colour)
    )


def _grouped(panel: Any, trace: Any, beside: Sequence[Any]) -> Any:
    """Draw upright bars beside those of other traces, which have the same places."""
    places = list(dict.fromkeys(str(place) for one in beside for place in one.x))
    width = 0.8 / len(beside)
    at = np.array([places.index(str(place)) for place in trace.x]) + (beside.index(trace) - 0.5 * (len(beside) - 1)) * width
    panel.set_xticks(range(len(places)), places)
    return panel.bar(at, np.asarray(trace.y, float), width, color=_colour(_single(trace.marker.color)))


def _shape(panels: Mapping[tuple[str, str], Any], shape: Any) -> None:
    """Draw a line or a band across a panel."""
    for (x, y), panel in panels.items():
        style = {"color": _colour(shape.line.color) or "#888", "linewidth": 0.8}
        style["linestyle"] = _DASH.get(shape.line.dash or "solid", "-")
        if str(shape.xref).startswith(f"{x} dom") and shape.yref == y and shape.type == "line":
            panel.axhline(shape.y0, **style)
        elif shape.xref == x and str(shape.yref).startswith(f"{y} dom"):
            band = shape.type == "rect"
            panel.axvspan(shape.x0, shape.x1, **_rgba(shape.fillcolor), linewidth=0) if band else panel.axvline(
                shape.x0, **style
            )


def _note(canvas: Any, panels: Mapping[tuple[str, str], Any], note: Any, layout: Any, height: float) -> None:
    text = re.sub(r"<[^>]*>", " ", note.text or "")
    if note.xref == "paper" and note.yref == "paper":
        left, bottom, wide, high = _area(layout, height)
        size = 0.7 * (note.font.size or 14)
        canvas.text(
            left + wide * note.x, bottom + high * note.y + 3.0 / height, text, ha=note.xanchor or "center", fontsize=size
        )
        return
    panel = panels.get((str(note.xref).split()[0], str(note.yref).split()[0]))
    if panel is not None and " " not in f"{note.xref}{note.yref}":
        panel.annotate(text, (note.x, note.y), (3, 3), textcoords="offset points", fontsize=8)


def _values(given: Any) -> Any:
    values = np.asarray(given)
    return (
        values
        if values.dtype.kind in "fiu"
        else [str(one) for one in values]
        if values.dtype.kind in "US"
        else _numbers(list(values))
    )


def _numbers(values: Sequence[Any]) -> Any:
    """Return numbers, nan for gaps; names as they are."""
    if all(one is None or isinstance(one, int | float) for one in values):
        return np.array([np.nan if one is None else float(one) for one in values])
    return [str(one) for one in values]


def _single(value: Any) -> Any:
    """Return a style that may be given for each mark: the first one's."""
    return value if value is None or isinstance(value, str) else next(iter(value), None)


def _colour(value: Any) -> Any:
    return _rgba(value)["color"] if isinstance(value, str) else None


def _rgba(value: str) -> dict[str, Any]:
    found = re.fullmatch(r"rgba?\(([^)]*)\)", value or "")
    if not found:
        return {"color": value or "#cccccc"}
    parts = [float(part) for part in found[1].split(",")]
    return {"color": tuple(part / 255.0 for part in parts[:3]), "alpha": parts[3] if len(parts) > 3 else 1.0}
