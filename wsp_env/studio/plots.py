"""Plots of the studio as plotly's plain dictionaries."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wsp_env.report import COLOURS

_GRID = {"gridcolor": "#eceff2", "linecolor": "#c5ccd3", "zerolinecolor": "#c5ccd3", "automargin": True}
_GAP = 0.05  # between panels, share of the height
_PANEL_PX = 190
_ROOM = 1.6  # above the largest adhesion used, as a factor

Line = dict[str, Any]


def line(x: Any, y: Any, name: str, colour: str, **more: Any) -> Line:
    """Return one curve; what is no number is a gap."""
    values = [float(one) if np.isfinite(one) else None for one in np.asarray(y, dtype=float)]
    style = {"color": colour, "width": 1.4, **more.pop("line", {})}
    return {"type": "scattergl" if len(values) > 5000 else "scatter", "mode": "lines", "x": np.asarray(x, dtype=float).tolist(),
            "y": values, "name": name, "line": style, **more}  # fmt: skip


def panels(rows: Sequence[tuple[str, Sequence[Line]]], x: str = "time [s]") -> dict[str, Any]:
    """Return a figure of panels below each other on one axis; rows of (title of the y axis, curves); a name is listed once."""
    count, data, named = len(rows), [], set()
    layout: dict[str, Any] = {
        "margin": {"l": 64, "r": 12, "t": 34, "b": 44}, "height": 70 + _PANEL_PX * count, "paper_bgcolor": "white",
        "plot_bgcolor": "white", "hovermode": "x unified" if count == 1 else "closest",
        "font": {"color": "#1f2933", "size": 12},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0}, "xaxis": {**_GRID, "title": {"text": x}},
    }  # fmt: skip
    share = (1.0 - _GAP * (count - 1)) / count
    for number, (title, curves) in enumerate(rows):
        own = "" if number == 0 else str(number + 1)
        top = 1.0 - number * (share + _GAP)
        layout[f"yaxis{own}"] = {**_GRID, "title": {"text": title, "standoff": 8}, "domain": [max(top - share, 0.0), top]}
        for curve in curves:
            fresh = curve["name"] not in named
            named.add(curve["name"])
            data.append({"legendgroup": curve["name"], "showlegend": fresh, **curve, "yaxis": f"y{own}"})
    layout["xaxis"]["anchor"] = f"y{count}" if count > 1 else "y"
    return {"data": data, "layout": layout, "config": {"displaylogo": False, "responsive": True, "displayModeBar": False}}


def colour(k: int) -> str:
    """Return the colour of an axle, from 0."""
    return COLOURS[k % 6]


def stop_panels(stop: dict[str, Any]) -> dict[str, Any]:
    """Return speeds, slips, pressures and adhesion of a stop of the driving desk."""
    course = {name: np.array(values) for name, values in stop["course"].items()}
    time, axles = course["time_s"], len(stop["vehicle"]["axle_positions_m"])
    shown = range(axles) if axles <= 6 else sorted({0, 1, axles // 2, axles - 1})
    speeds = [line(time, course["wheel_mps"][:, k], f"axle {k + 1}", colour(k)) for k in shown]
    speeds.append(line(time, course["speed_mps"], "vehicle", "#1f2933", line={"width": 2.2}))
    each = {
        name: [line(time, course[name][:, k], f"axle {k + 1}", colour(k)) for k in shown]
        for name in ("slip_speed_mps", "pressure_bar", "adhesion")
    }
    limits = [
        line(time, course[name].mean(axis=1), words, "#7b8794", line={"dash": dash, "width": 1.2})
        for name, words, dash in (("adhesion_d", "limit, uncleaned", "dot"), ("adhesion_r", "limit, cleaned", "dash"))
    ]
    figure = panels(
        [
            ("speed [m/s]", speeds),
            ("slip [m/s]", each["slip_speed_mps"]),
            ("cylinder pressure [bar]", each["pressure_bar"]),
            ("adhesion [-]", [*each["adhesion"], *limits]),
        ]
    )
    # The limit of a rail that is wholly cleaned is some times what any wheel uses: it may leave the panel.
    used = max(float(np.max(course["adhesion"])), float(np.max(course["adhesion_d"])), 0.01)
    figure["layout"]["yaxis4"]["range"] = [min(0.0, float(np.min(course["adhesion"]))), _ROOM * used]
    return figure
