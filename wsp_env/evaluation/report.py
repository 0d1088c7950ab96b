"""The page of an evaluation: distance against slip, where distance is lost, the course of any stop, all figures."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars

from wsp_env.evaluation.evaluate import BOUND, Evaluation, Trace
from wsp_env.evaluation.figures import CAUSES, FIGURES
from wsp_env.evaluation.summary import Verdict
from wsp_env.report import COLOURS, Section, Table, axes, plotly, write_page

_DIGITS = {"m": 0, "m/s": 2, "s": 1, "Nl": 0, "MJ": 3, "-": 3}
_SLIP_TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
_CAUSE_COLOURS = dict(zip(CAUSES, ("#bbbbbb", COLOURS[0], COLOURS[4], COLOURS[1]), strict=True))


def write_report(path: Path, result: Evaluation, summary: polars.DataFrame, verdicts: Sequence[Verdict], title: str) -> None:
    """Write the self-contained page; `ModuleNotFoundError` names the extra where plotly is missing."""
    plotly()
    contaminated = _contaminated(summary)
    sections = [Section("Requirements", _failed(result), [_verdicts(verdicts)] if verdicts else [])]
    if contaminated.height:
        sections += [_front(contaminated), _lost(contaminated)]
    sections += [_courses(result.traces), _all_figures(summary)]
    lead = (
        "Stopping distance is only comparable at equal slide: read it together with the slip, the contact energy and the bound."
    )
    write_page(path, f"Wheel slide protection: {title}", lead, sections, "Written by wsp evaluate.")


def _failed(result: Evaluation) -> list[str]:
    return [f"{failure.controller} failed in {failure.case}: {failure.message}" for failure in result.failures]


def _contaminated(summary: polars.DataFrame) -> polars.DataFrame:
    """Return the rows of contaminated rail: where there are both laws."""
    both = summary.group_by("case").agg(polars.col("law").n_unique()).filter(polars.col("law") > 1)["case"]
    return summary.filter(polars.col("case").is_in(both.to_list()))


def _names(summary: polars.DataFrame) -> list[str]:
    return [name for name in summary["controller"].unique(maintain_order=True) if name != BOUND]


def _verdicts(verdicts: Sequence[Verdict]) -> Table:
    names = list(dict.fromkeys(verdict.controller for verdict in verdicts))
    rows = []
    for requirement in dict.fromkeys(verdict.requirement for verdict in verdicts):
        own = {verdict.controller: verdict for verdict in verdicts if verdict.requirement == requirement}
        first = next(iter(own.values()))
        cells = [_verdict(own[name]) if name in own else "" for name in names]
        rows.append((requirement, f"{first.at_most:g}", *cells, first.source))
    return Table(("requirement", "at most", *names, "source of the limit"), rows, "The worst stop counts.")


def _verdict(verdict: Verdict) -> str:
    return f"pass ({verdict.worst:.4g})" if verdict.passed else f"FAIL ({verdict.worst:.4g}: {verdict.where})"


def _front(summary: polars.DataFrame) -> Section:
    _, subplots = plotly()
    laws = summary["law"].unique(maintain_order=True).to_list()
    figure = subplots.make_subplots(
        rows=1, cols=len(laws), subplot_titles=[f"{law} law" for law in laws], horizontal_spacing=0.09
    )
    for column, law in enumerate(laws, start=1):
        for index, name in enumerate(_names(summary)):
            rows = summary.filter((polars.col("law") == law) & (polars.col("controller") == name))
            rows = rows.filter(polars.col("ratio_bound").is_finite())
            figure.add_scatter(
                x=rows["mean_slip_mps"],
                y=rows["ratio_bound"],
                error_y={"array": rows["ratio_bound_ci"], "thickness": 1, "width": 2},
                mode="markers",
                name=name,
                legendgroup=name,
                showlegend=column == 1,
                marker={"color": COLOURS[index % len(COLOURS)], "size": 9},
                text=rows["case"],
                hovertemplate="%{text}<br>mean slip %{x:.2f} m/s<br>distance / bound %{y:.3f}",
                row=1,
                col=column,
            )
        figure.add_hline(y=1.0, line={"color": "#777", "dash": "dot", "width": 1}, row=1, col=column)
    axes(figure, "mean slip speed [m/s]", "stopping distance / bound [-]", height=460)
    figure.update_xaxes(type="log", tickvals=_SLIP_TICKS, ticktext=[f"{tick:g}" for tick in _SLIP_TICKS])
    text = (
        "One point per case on contaminated rail, mean of the draws with its 95 % confidence interval. The bound (1) is the "
        "shortest stop within the slide limit; a point below it has left the limit.",
    )
    return Section("Stopping distance against slip", text, [figure])


def _lost(summary: polars.DataFrame) -> Section:
    figures = []
    for law in summary["law"].unique(maintain_order=True):
        figures.append(_lost_under(summary.filter(polars.col("law") == law), str(law)))
    text = (
        "Metres beyond the bound, by cause: the brake still filling; too little brake for the adhesion there is; slip beyond "
        "the best one; slip beyond the limit. Negative: gained, where a slide beyond the limit dries the rail or a wheelset "
        "spinning up gives momentum back. The scales differ between controllers.",
    )
    return Section("Where each controller loses distance", text, figures)


def _lost_under(summary: polars.DataFrame, law: str) -> Any:
    _, subplots = plotly()
    names = _names(summary)
    cases = summary["case"].unique(maintain_order=True).to_list()
    figure = subplots.make_subplots(rows=1, cols=len(names), shared_yaxes=True, subplot_titles=names, horizontal_spacing=0.03)
    for column, name in enumerate(names, start=1):
        rows = summary.filter(polars.col("controller") == name)
        for cause, meaning in CAUSES.items():
            figure.add_bar(
                y=rows["case"],
                x=rows[f"lost_{cause}_m"],
                name=meaning,
                legendgroup=cause,
                showlegend=column == 1,
                orientation="h",
                marker={"color": _CAUSE_COLOURS[cause]},
                row=1,
                col=column,
            )
    axes(figure, "", "", height=180 + 26 * len(cases), barmode="relative", title=f"{law} law: metres beyond the bound [m]")
    figure.update_layout(margin={"l": 160, "t": 90, "b": 70}, legend={"orientation": "h", "yref": "container", "y": 0.01})
    figure.update_yaxes(categoryorder="array", categoryarray=cases[::-1])
    return figure


def _all_figures(summary: polars.DataFrame) -> Section:
    header = ["case", "law", "controller", *(f"{name} [{unit}]" for name, (unit, _) in FIGURES.items())]
    rows = []
    stops = list(summary.select("case", "law").unique(maintain_order=True).iter_rows())
    for row in sorted(summary.to_dicts(), key=lambda row: stops.index((row["case"], row["law"]))):
        cells = [_cell(row[name], row[f"{name}_ci"], _DIGITS[unit]) for name, (unit, _) in FIGURES.items()]
        ran_on = row["draws"] - row["stopped"]
        rows.append([row["case"], row["law"], row["controller"] + (f" ({ran_on} ran on)" if ran_on else ""), *cells])
    meanings = "; ".join(f"{name}: {meaning}" for name, (_, meaning) in FIGURES.items())
    return Section("All figures", (), [Table(header, rows, f"Means of the draws with 95 % confidence intervals. {meanings}.")])


def _cell(value: float | None, half: float | None, digits: int) -> str:
    if value is None or not math.isfinite(value):
        return "" if value is None else "-"
    spread = f" ± {half:.{digits}f}" if half is not None and math.isfinite(half) and half >= 0.5 * 10.0**-digits else ""
    return f"{value:.{digits}f}{spread}"


def _courses(traces: Sequence[Trace]) -> Section:
    text = ("The first draw of every case, sampled every 0.2 s: vehicle and wheels, slip speeds, cylinder pressures.",)
    return Section("The course of a stop", text, [_Viewer(traces)])


class _Viewer:
    """Menus that choose a stop, and its three plots; drawn in the browser from one copy of the numbers."""

    def __init__(self, traces: Sequence[Trace]) -> None:
        self.traces = traces

    def to_html(self, **_: Any) -> str:
        """Return the element; the page brings plotly itself."""
        stops = [
            {
                "controller": trace.controller,
                "case": trace.case,
                "law": trace.law,
                "t": _rounded(trace.time),
                "v": _rounded(trace.speed),
                "rim": [_rounded(axle) for axle in trace.rim.T],
                "p": [_rounded(axle) for axle in trace.pressure.T],
            }
            for trace in self.traces
        ]
        data = json.dumps(stops, separators=(",", ":")).replace("</", "<\\/")
        menus = "".join(
            f'<label>{what} <select id="course-{what}"></select></label> ' for what in ("controller", "case", "law")
        )
        return f'<p>{menus}</p><div id="course"></div><script>{_script(data, COLOURS)}</script>'


def _rounded(values: np.ndarray) -> list[float]:
    rounded: list[float] = np.round(values.astype(np.float64), 2).tolist()
    return rounded


def _script(data: str, colours: Sequence[str]) -> str:
    return f"""(() => {{
const stops = {data}, colours = {json.dumps(list(colours))};
const menu = name => document.getElementById("course-" + name);
for (const name of ["controller", "case", "law"]) {{
  for (const value of new Set(stops.map(stop => stop[name]))) menu(name).add(new Option(value, value));
  menu(name).onchange = draw;
}}
const start = stops.find(s => s.case.startsWith("low") && s.controller === stops[stops.length - 1].controller) || stops[0];
for (const name of ["controller", "case", "law"]) menu(name).value = start[name];
function draw() {{
  const fits = stops.filter(s => s.controller === menu("controller").value && s.case === menu("case").value);
  const stop = fits.find(s => s.law === menu("law").value) || fits[0];
  const traces = [], layout = {{template: null, height: 760, hovermode: "closest", margin: {{l: 70, r: 20, t: 20, b: 50}},
    xaxis: {{title: {{text: "time [s]"}}, anchor: "y3"}}, yaxis: {{title: {{text: "speed [m/s]"}}, domain: [0.68, 1]}},
    yaxis2: {{title: {{text: "slip speed [m/s]"}}, domain: [0.35, 0.63]}},
    yaxis3: {{title: {{text: "pressure [bar]"}}, domain: [0, 0.3]}}}};
  if (stop) {{
    stop.rim.forEach((rim, k) => {{
      const line = {{color: colours[k % colours.length], width: 1.2}}, name = "axle " + (k + 1), legendgroup = name;
      traces.push({{x: stop.t, y: rim, name, legendgroup, line}},
        {{x: stop.t, y: rim.map((r, i) => stop.v[i] - r), yaxis: "y2", name, legendgroup, showlegend: false, line}},
        {{x: stop.t, y: stop.p[k], yaxis: "y3", name, legendgroup, showlegend: false, line}});
    }});
    traces.push({{x: stop.t, y: stop.v, name: "vehicle", line: {{color: "black", width: 2}}}});
  }} else layout.title = {{text: "this controller has no result in this case"}};
  Plotly.react("course", traces, layout, {{displaylogo: false, responsive: true}});
}}
draw();
}})();"""
