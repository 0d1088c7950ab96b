"""The runs on a diagnosis' page: residuals of every run, one run's course, and the paper's figures before and after."""

from collections.abc import Mapping, Sequence
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis, RunTrace
from wsp_env.report import COLOURS, Table, axes, plotly

#: Mean squares from which on a cell is reported: twice what noise alone leaves.
HIGH = 2.0
_REPORTED = 8  # cells at most
_SCALE = {"colorscale": "YlOrRd", "cmin": 0.5, "cmax": 5.0}


def series_name(balance: str, axle: int) -> str:
    """Name a series of residuals; axle 0 is the vehicle."""
    return f"{balance}, axle {axle}" if axle else balance


def heat_maps(cells: Sequence[Mapping[str, Any]], over: str, sides: Mapping[str, str], x: str) -> Any:
    """Draw mean squares by balance and axle over runs or places, on one colour scale.

    Parameters
    ----------
    cells : of the JSON's `residuals`
    over : "run" or "place_m"
    sides : "before", "after" -> title
    x : title of the axis

    """
    objects, subplots = plotly()
    across = list(dict.fromkeys(cell[over] for cell in cells))
    if over != "run":
        across.sort()
    series = list(dict.fromkeys((cell["balance"], cell["axle"]) for cell in cells))
    figure = subplots.make_subplots(1, len(sides), shared_yaxes=True, subplot_titles=list(sides.values()))
    for i, side in enumerate(sides):
        values = {(cell["balance"], cell["axle"], cell[over]): cell[side] for cell in cells}
        z = [[values.get((*one, place)) for place in across] for one in series]
        names = [series_name(*one) for one in series]
        figure.add_trace(objects.Heatmap(z=z, x=across, y=names, coloraxis="coloraxis"), 1, i + 1)
    figure.update_layout(height=140 + 28 * len(series), coloraxis={**_SCALE, "colorbar": {"title": "mean square [-]"}})
    axes(figure, x, "")
    figure.update_layout(margin={"l": 140})
    return figure


def still_high(found: Diagnosis) -> str:
    """Say which cells stay high."""
    side = "after" if found.mechanisms else "before"
    high = sorted((one for one in found.residuals["cells"] if one[side] > HIGH), key=lambda one: -one[side])
    so = "after the extension" if found.mechanisms else "beside the baseline"
    if not high:
        return f"No cell stays above {HIGH:g} {so}."
    worst = [f"{series_name(one['balance'], one['axle'])} in {one['run']} ({one[side]:.1f})" for one in high[:_REPORTED]]
    more = f", and {len(high) - _REPORTED} more" if len(high) > _REPORTED else ""
    return f"Above {HIGH:g} {so}: {'; '.join(worst)}{more}."


def course_plot(course: RunTrace, extended: bool) -> Any:
    """Draw the adhesion of one axle and the speed's residual over a run."""
    objects, subplots = plotly()
    held_out = ", held out" if course.group == "validate" else ""
    titles = (
        f"Run {course.run}{held_out}: adhesion coefficient of axle {course.axle}, which slides most",
        "Recorded minus predicted vehicle speed",
    )
    figure = subplots.make_subplots(
        2, 1, shared_xaxes=True, subplot_titles=titles, row_heights=[0.6, 0.4], vertical_spacing=0.1
    )
    sides = {"baseline": (course.adhesion_before, course.speed_residual_before_mps, COLOURS[1])}
    if extended:
        sides["extended"] = (course.adhesion_after, course.speed_residual_after_mps, COLOURS[2])
    figure.add_trace(
        objects.Scatter(
            x=course.time_s, y=course.adhesion_measured, mode="markers", name="measured",
            marker={"color": COLOURS[6], "size": 4, "opacity": 0.6},
        ), 1, 1,
    )  # fmt: skip
    for name, (adhesion, speed, colour) in sides.items():
        line = {"color": colour}
        figure.add_trace(objects.Scatter(x=course.time_s, y=adhesion, mode="lines", name=name, line=line), 1, 1)
        shown = objects.Scatter(x=course.speed_time_s, y=speed, mode="lines+markers", name=name, line=line, showlegend=False)
        figure.add_trace(shown, 2, 1)
    figure.update_layout(height=620)
    axes(figure, "", "")
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    figure.update_yaxes(title_text="adhesion coefficient [-]", row=1, col=1)
    figure.update_yaxes(title_text="speed [m/s]", row=2, col=1)
    return figure


def figures(found: Diagnosis) -> list[Table]:
    """Return the paper's figures by run and axle; before alone where nothing was found."""
    sides = ("before", "after") if found.mechanisms else ("before",)
    speeds, axle_rows = [], []
    for one in found.runs:
        name = f"{one.run}*" if one.group == "validate" else one.run
        speeds.append((name, *(f"{getattr(one, f'speed_error_{side}_mps'):.3g}" for side in sides)))
        for k in range(len(one.slide_mean_recorded_mps)):
            errors = [getattr(one, f"adhesion_error_{side}")[k] for side in sides]
            slides = [
                getattr(one, f"slide_{what}_{side}_mps")[k] for what in ("mean", "deviation") for side in ("recorded", *sides)
            ]
            shown = ["-" if error is None else f"{100.0 * error:.2f}" for error in errors]
            axle_rows.append((name, str(k + 1), *shown, *(f"{slide:.2f}" for slide in slides)))
    recorded = ("recorded", *sides)
    header = ("Run", "Axle", *(f"e {side} [%]" for side in sides), *(f"mean slide {side} [m/s]" for side in recorded),
              *(f"deviation {side} [m/s]" for side in recorded))  # fmt: skip
    return [
        Table(header, axle_rows,
              "*: held out. e: error of the adhesion coefficient over its mean while the axle slides (Table 4); -: it does not "
              "slide. Mean slide and its deviation (eqs. 20 and 21) of whole stops simulated with the recorded torque, which "
              "no controller corrects: compare the statistics, not instants."),
        Table(("Run", *(f"E {side} [m/s]" for side in sides)), speeds, "*: held out."),
    ]  # fmt: skip
