"""The runs on a diagnosis' page: residuals of all runs, the course of one run, and the paper's figures before and after."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis, RunTrace
from wsp_env.diagnosis.words import BALANCES
from wsp_env.report import COLOURS, Table, axes, plotly

#: Mean square from which on a cell is reported: twice that of noise alone.
HIGH = 2.0
_REPORTED = 8  # largest number of reported cells
#: Colours follow the logarithm of the mean square, from the noise level to a hundred times this level.
_TICKS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_SCALE = {
    "colorscale": [[0.0, "#ffffff"], [0.15, "#fff3d0"], [0.35, "#fec44f"], [0.6, "#ec7014"], [1.0, "#7f2704"]],
    "cmin": 0.0,
    "cmax": math.log10(_TICKS[-1]),
    "colorbar": {
        "title": "mean<br>square [-]",
        "tickvals": [math.log10(tick) for tick in _TICKS],
        "ticktext": [f"{tick:g}" for tick in _TICKS],
    },
}
_ROW_PX = 30


def series_name(balance: str, axle: int) -> str:
    """Return the name of a series of residuals; axle 0 is the vehicle."""
    words = BALANCES.get(balance, balance)
    return f"{words}, axle {axle}" if axle else words


def heat_maps(cells: Sequence[Mapping[str, Any]], over: str, sides: Mapping[str, str], x: str) -> Any:
    """Draw mean squares by balance and axle over runs or places, with one colour scale.

    Parameters
    ----------
    cells : from the JSON's `residuals`
    over : "run" or "place_m"
    sides : "before", "after" -> title
    x : title of the axis

    """
    objects, subplots = plotly()
    across = list(dict.fromkeys(cell[over] for cell in cells))
    if over != "run":
        across.sort()
    series = list(dict.fromkeys((cell["balance"], cell["axle"]) for cell in cells))
    below = over != "run"  # a map over the track is wide: draw both sides one below the other
    shape = (len(sides), 1) if below else (1, len(sides))
    figure = subplots.make_subplots(
        *shape, shared_yaxes=True, shared_xaxes=True, subplot_titles=list(sides.values()), vertical_spacing=0.1,
        horizontal_spacing=0.03,
    )  # fmt: skip
    for i, side in enumerate(sides):
        values = {(cell["balance"], cell["axle"], cell[over]): cell[side] for cell in cells}
        squares = [[values.get((*one, place)) for place in across] for one in series]
        heat = objects.Heatmap(
            z=[[None if square is None else math.log10(max(square, 0.01)) for square in row] for row in squares],
            x=across, y=[series_name(*one) for one in series], coloraxis="coloraxis", customdata=squares, xgap=1, ygap=1,
            hovertemplate="%{y}, %{x}: %{customdata:.2f}<extra></extra>",
            text=[list(map(_shown, row)) for row in squares],
            texttemplate="" if below else "%{text}",
        )  # fmt: skip
        figure.add_trace(heat, *((i + 1, 1) if below else (1, i + 1)))
    rows = len(series) * (len(sides) if below else 1)
    figure.update_layout(coloraxis=_SCALE, plot_bgcolor="#eee")
    axes(figure, "", "", height=150 + _ROW_PX * rows)
    figure.update_xaxes(title_text=x, row=len(sides) if below else None, showgrid=False)
    figure.update_yaxes(autorange="reversed", showgrid=False)
    figure.update_layout(margin={"l": 210})
    return figure


def _shown(square: float | None) -> str:
    return "" if square is None else f"{square:.0f}" if square >= 10.0 else f"{square:.1f}"


def still_high(found: Diagnosis) -> str:
    """Return a sentence on the cells that stay high."""
    extended = bool(found.mechanisms or found.discovered)
    side = "after" if extended else "before"
    high = sorted((one for one in found.residuals["cells"] if one[side] > HIGH), key=lambda one: -one[side])
    so = "after the extension" if extended else "beside the baseline"
    if not high:
        return f"No cell stays above {HIGH:g} {so}."
    worst = [f"{series_name(one['balance'], one['axle'])} in {one['run']} ({one[side]:.1f})" for one in high[:_REPORTED]]
    more = f", and {len(high) - _REPORTED} more" if len(high) > _REPORTED else ""
    return f"Above {HIGH:g} {so}: {'; '.join(worst)}{more}."


def course_plot(course: RunTrace, shows: str, extended: bool) -> Any:
    """Draw one run before and after.

    Parameters
    ----------
    shows : "adhesion": adhesion of its axle and its residual; "speed": residual of the vehicle's speed
    extended : whether there is an extended model ("after")

    """
    _, subplots = plotly()
    run = f"Run {course.run}{', held out' if course.group == 'validate' else ''}"
    axle = f"adhesion coefficient of axle {course.axle}{f', {course.chosen}' if course.chosen else ''}"
    sides = {"before" if extended else "as tuned": ("before", COLOURS[1])} | (
        {"after": ("after", COLOURS[2])} if extended else {}
    )
    rest: dict[str, Sequence[float]] = {
        side: [a - b for a, b in zip(course.adhesion_measured, getattr(course, f"adhesion_{side}"), strict=True)]
        for side in ("before", "after")
    }
    lines: list[tuple[int, Sequence[float], dict[str, Sequence[float]]]]
    if shows == "speed":
        speed = {side: getattr(course, f"speed_residual_{side}_mps") for side in ("before", "after")}
        titles = [f"{run}: recorded minus predicted vehicle speed{_left(speed, extended, 'm/s')}"]
        lines, names = [(1, course.speed_time_s, speed)], ["speed [m/s]"]
    else:
        titles = [f"{run}: {axle}", f"Residual: measured less predicted{_left(rest, extended, '')}"]
        predicted = {side: getattr(course, f"adhesion_{side}") for side in ("before", "after")}
        lines, names = [(1, course.time_s, predicted), (2, course.time_s, rest)], ["adhesion coefficient [-]", "residual [-]"]
    figure = subplots.make_subplots(
        len(titles), 1, shared_xaxes=True, subplot_titles=titles, row_heights=[0.6, 0.4][: len(titles)], vertical_spacing=0.12
    )
    if shows != "speed":
        figure.add_scatter(
            x=course.time_s, y=course.adhesion_measured, mode="markers", name="measured",
            marker={"color": COLOURS[6], "size": 4, "opacity": 0.6}, row=1, col=1,
        )  # fmt: skip
    for row, x, values in lines:
        for name, (side, colour) in sides.items():
            figure.add_scatter(
                x=x, y=values[side], mode="lines", name=name, line={"color": colour, "width": 1.8},
                showlegend=row == 1, row=row, col=1,
            )  # fmt: skip
    figure.add_hline(y=0.0, line={"color": "#888", "width": 1}, row=len(titles), col=1)
    axes(
        figure,
        "",
        "",
        height=480 if len(titles) > 1 else 330,
        legend={"orientation": "h", "x": 0.0, "y": 1.2 if len(titles) > 1 else 1.25},
    )
    figure.update_annotations(font_size=14, x=0.0, xanchor="left")
    figure.update_xaxes(title_text="time [s]", row=len(titles), col=1)
    for i, name in enumerate(names):
        figure.update_yaxes(title_text=name, row=i + 1, col=1)
    return figure


def _left(values: Mapping[str, Sequence[float]], extended: bool, unit: str) -> str:
    """Return the root mean square of a residual, before and after, in words."""
    squares = [math.sqrt(sum(v * v for v in some) / max(len(some), 1)) for some in values.values()]
    sizes = [f"{size:.2g} {unit}".rstrip() for size in squares]
    if not extended:
        return f"; root mean square {sizes[0]}"
    change = squares[1] / squares[0] - 1.0 if squares[0] > 0.0 else 0.0
    delta = f", {100.0 * abs(change):.0f} % {'less' if change < 0.0 else 'more'}" if abs(change) >= 0.005 else ", no change"
    return f"; root mean square {sizes[0]} before, {sizes[1]} after{delta}"


def figures(found: Diagnosis, extended: bool) -> list[Table]:
    """Return the paper's figures by run and axle; only "as tuned" if nothing was found."""
    sides = {"before": "before", "after": "after"} if extended else {"before": "as tuned"}
    speeds, axle_rows = [], []
    for one in found.runs:
        name = f"{one.run}*" if one.group == "validate" else one.run
        speeds.append((name, *(f"{getattr(one, f'speed_error_{side}_mps'):.3g}" for side in sides)))
        for k in range(len(one.slide_mean_recorded_mps)):
            errors = [getattr(one, f"adhesion_error_{side}")[k] for side in sides]
            slides = [
                getattr(one, f"slide_{what}_{side}_mps")[k] for what in ("mean", "deviation") for side in ("recorded", *sides)
            ]
            shown = ["no slide" if error is None else f"{100.0 * error:.2f}" for error in errors]
            axle_rows.append((name, str(k + 1), *shown, *(f"{slide:.2f}" for slide in slides)))
    said, recorded = sides.values(), ("recorded", *sides.values())
    header = ("Run", "Axle", *(f"adhesion error {side} [%]" for side in said),
              *(f"mean slide {side} [m/s]" for side in recorded),
              *(f"deviation {side} [m/s]" for side in recorded))  # fmt: skip
    return [
        Table(header, axle_rows,
              "*: held out. Adhesion error: of the coefficient, over its mean while the axle slides (as e of Table 4, but of "
              "means over 0.16 s and under the law that the diagnosis fits: wsp tune and wsp validate compare single samples "
              "under theirs). "
              "Mean slide and its deviation (eqs. 20 and 21) of whole stops simulated with the recorded torque, which "
              "no controller corrects: compare the statistics, not instants."),
        Table(("Run", *(f"speed error {side} [m/s]" for side in said)), speeds,
              "*: held out. Speed error: of the vehicle's speed, computed with the measured torque (E, eq. 19), under the law "
              "that the diagnosis fits; wsp validate computes it under the law of wsp tune."),
    ]  # fmt: skip
