"""The page of an evaluation: distance against slip, where distance is lost, the course of any stop, all figures."""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars

from wsp_env.evaluation.evaluate import BOUND, KEYS, ProgrammeResult, Trace
from wsp_env.evaluation.figures import CAUSES, FIGURES
from wsp_env.evaluation.results import TRACE_SAMPLES
from wsp_env.evaluation.summary import Verdict
from wsp_env.report import COLOURS, Figure, Section, Table, axes, plotly, write_page

#: What the mark beside a ratio to the bound says.
LEFT_LIMIT = "* at least one draw left the slide limit: it violates it, and the bound does not hold for it"

_DIGITS = {"m": 0, "m/s": 2, "s": 1, "Nl": 0, "MJ": 3, "-": 3}
_SLIP_TICKS = [digit * 10.0**power for power in range(-4, 3) for digit in (1, 2, 5)]
_CAUSE_COLOURS = dict(zip(CAUSES, ("#bbbbbb", COLOURS[0], COLOURS[4], COLOURS[1]), strict=True))


def write_report(
    path: Path, result: ProgrammeResult, summary: polars.DataFrame, verdicts: Sequence[Verdict], title: str
) -> None:
    """Write the self-contained page; `ModuleNotFoundError` names the extra where plotly is missing."""
    plotly()
    contaminated = _contaminated(summary)
    sections = [Section("Requirements", _complaints(result), [_verdicts(verdicts)] if verdicts else [])]
    if contaminated.height:
        sections += [_front(contaminated), _lost(contaminated)]
    sections += [_courses(result), _all_figures(summary)]
    lead = (
        "Stopping distance is only comparable at equal slide: read it together with the slip, the contact energy and the bound."
    )
    write_page(path, f"Wheel slide protection: {title}", lead, sections, "Written by wsp evaluate.")


def _complaints(result: ProgrammeResult) -> list[str]:
    return [f"{failure.controller} failed in {failure.case}: {failure.message}" for failure in result.failures]


def _ran_on(summary: polars.DataFrame) -> list[str]:
    """Return a sentence on the stops that never ended, which have no distance to draw."""
    rows = summary.filter(polars.col("stopped") < polars.col("draws")).to_dicts()
    named = [f"{row['controller']} in {row['case']}, {row['law']} law ({row['draws'] - row['stopped']})" for row in rows]
    return [f"Not shown, as they never stopped: {'; '.join(named)}."] if named else []


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
    if verdict.passed:
        return f"pass ({verdict.worst:.4g})"
    return f"FAIL ({verdict.worst:.4g}: {verdict.where})" if math.isfinite(verdict.worst) else f"FAIL ({verdict.where})"


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
                marker=_marker(COLOURS[index % len(COLOURS)], rows),
                text=rows["case"],
                customdata=[_limit_kept(row) for row in rows.to_dicts()],
                hovertemplate="%{text}<br>mean slip %{x:.2f} m/s<br>distance / bound %{y:.3f}<br>%{customdata}",
                row=1,
                col=column,
            )
        figure.add_hline(y=1.0, line={"color": "#777", "dash": "dot", "width": 1}, row=1, col=column)
    axes(figure, "mean slip speed [m/s]", "stopping distance / bound [-]", height=460)
    figure.update_xaxes(type="log", tickvals=_SLIP_TICKS, ticktext=[f"{tick:g}" for tick in _SLIP_TICKS])
    text = (
        "One point per case on contaminated rail, mean of the draws with its 95 % confidence interval. The bound (1) is the "
        "shortest stop within the slide limit. A hollow point left the limit in at least one draw: it violates it, and may lie "
        "below 1.",
        *_ran_on(summary),
    )
    return Section("Stopping distance against slip", text, [figure])


def _marker(colour: str, rows: polars.DataFrame) -> dict[str, object]:
    """Return filled points, hollow where a stop left the slide limit."""
    symbols = ["circle" if row["within_limit"] == row["draws"] else "circle-open" for row in rows.to_dicts()]
    return {"color": colour, "size": 9, "symbol": symbols, "line": {"width": 2, "color": colour}}


def _limit_kept(row: Mapping[str, Any]) -> str:
    left = row["draws"] - row["within_limit"]
    return f"{left} of {row['draws']} left the slide limit" if left else "within the slide limit"


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


def _lost_under(summary: polars.DataFrame, law: str) -> Figure:
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
    figure.update_xaxes(nticks=5)
    figure.update_yaxes(categoryorder="array", categoryarray=cases[::-1])
    return figure


def _all_figures(summary: polars.DataFrame) -> Section:
    header = ["case", "law", "controller", *(f"{name} [{unit}]" for name, (unit, _) in FIGURES.items())]
    rows = []
    stops = list(summary.select("case", "law").unique(maintain_order=True).iter_rows())
    for row in sorted(summary.to_dicts(), key=lambda row: stops.index((row["case"], row["law"]))):
        cells = [_cell(row[name], row[f"{name}_ci"], _DIGITS[unit]) for name, (unit, _) in FIGURES.items()]
        cells[list(FIGURES).index("ratio_bound")] += "*" * (row["within_limit"] < row["draws"])
        ran_on = row["draws"] - row["stopped"]
        rows.append([row["case"], row["law"], row["controller"] + (f" ({ran_on} ran on)" if ran_on else ""), *cells])
    meanings = "; ".join(f"{name}: {meaning}" for name, (_, meaning) in FIGURES.items())
    caption = f"Means of the draws with 95 % confidence intervals. {LEFT_LIMIT}. {meanings}."
    return Section("All figures", (), [Table(header, rows, caption)])


def _cell(value: float | None, half: float | None, digits: int) -> str:
    if value is None or not math.isfinite(value):
        return "" if value is None else "-"
    spread = f" ± {half:.{digits}f}" if half is not None and math.isfinite(half) and half >= 0.5 * 10.0**-digits else ""
    return f"{value:.{digits}f}{spread}"


def _courses(result: ProgrammeResult) -> Section:
    text = (
        f"Any stop, thinned out to {TRACE_SAMPLES} samples: vehicle and wheels, slip speeds, cylinder pressures. On clean rail "
        "both laws are one.",
    )
    return Section("The course of a stop", text, [_Viewer(result)])


class _Viewer:
    """Menus that choose a stop, and its three plots; drawn in the browser from one copy of the numbers."""

    def __init__(self, result: ProgrammeResult) -> None:
        self.result = result

    def to_html(self, **_: object) -> str:
        """Return the element; the page brings plotly itself."""
        notes = {tuple(row[key] for key in KEYS): _note(row) for row in self.result.stops.to_dicts()}
        stops = []
        for trace in self.result.traces:
            key = (trace.controller, trace.case, trace.law, trace.draw)
            stops.append(dict(zip(KEYS, key, strict=True)) | {"note": notes[key], "samples": _packed(trace)})
        data = json.dumps(stops, separators=(",", ":")).replace("<", "\\u003c")
        menus = "".join(f'<label>{what} <select id="course-{what}"></select></label> ' for what in KEYS)
        return f'<p>{menus}</p><p id="course-note"></p><div id="course"></div><script>{_script(data)}</script>'


def _note(row: Mapping[str, Any]) -> str:
    """Return how the stop went, in a line."""
    kept = "within the slide limit" if row["within_limit"] else f"left the slide limit for {row['beyond_limit_s']:.1f} s"
    if not row["stopped"]:
        return f"Ran on: never stopped, {kept}."
    return f"Stopped after {row['distance_m']:.0f} m, {row['ratio_bound']:.3f} of the bound, {kept}."


def _packed(trace: Trace) -> str:
    """Return time, speed, wheel speeds and pressures one after the other, in hundredths as 16 bits, little endian, base64."""
    columns = np.concatenate([[trace.time, trace.speed], trace.wheel.T, trace.pressure.T])
    return base64.b64encode(np.clip(np.rint(100.0 * columns), 0, 65535).astype("<u2").tobytes()).decode()


def _script(data: str) -> str:
    return f"""(() => {{
const stops = {data}, colours = {json.dumps(COLOURS)}, length = {TRACE_SAMPLES}, keys = {json.dumps(KEYS)};
const menu = name => document.getElementById("course-" + name);
const shown = (name, value) => name === "draw" ? value + 1 : value;
let chosen = stops.find(s => s.case.startsWith("low") && s.controller === stops[stops.length - 1].controller) || stops[0];
// Every menu offers what there is, given the menus before it.
function offer() {{
  let fits = stops;
  for (const name of keys) {{
    const values = [...new Set(fits.map(s => s[name]))], value = values.includes(chosen[name]) ? chosen[name] : values[0];
    menu(name).replaceChildren(...values.map(v => new Option(shown(name, v), v, false, v === value)));
    fits = fits.filter(s => s[name] === value);
  }}
  chosen = fits[0];
}}
for (const name of keys) menu(name).onchange = event => {{
  chosen = {{...chosen, [name]: name === "draw" ? Number(event.target.value) : event.target.value}};
  draw();
}};
function unpack(text) {{
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0)), all = new Uint16Array(bytes.buffer);
  const column = k => Array.from(all.subarray(k * length, (k + 1) * length), hundredths => hundredths / 100);
  return Array.from({{length: all.length / length}}, (_, k) => column(k));
}}
function draw() {{
  offer();
  document.getElementById("course-note").textContent = chosen.note;
  const [t, v, ...rest] = unpack(chosen.samples), axles = rest.length / 2, traces = [];
  for (let k = 0; k < axles; k++) {{
    const line = {{color: colours[k % colours.length], width: 1.2}}, name = "axle " + (k + 1), legendgroup = name;
    traces.push({{x: t, y: rest[k], name, legendgroup, line}},
      {{x: t, y: rest[k].map((r, i) => v[i] - r), yaxis: "y2", name, legendgroup, showlegend: false, line}},
      {{x: t, y: rest[axles + k], yaxis: "y3", name, legendgroup, showlegend: false, line}});
  }}
  traces.push({{x: t, y: v, name: "vehicle", line: {{color: "black", width: 2}}}});
  const layout = {{template: null, height: 760, hovermode: "closest", margin: {{l: 70, r: 20, t: 20, b: 50}},
    xaxis: {{title: {{text: "time [s]"}}, anchor: "y3"}}, yaxis: {{title: {{text: "speed [m/s]"}}, domain: [0.68, 1]}},
    yaxis2: {{title: {{text: "slip speed [m/s]"}}, domain: [0.35, 0.63]}},
    yaxis3: {{title: {{text: "pressure [bar]"}}, domain: [0, 0.3]}}}};
  Plotly.react("course", traces, layout, {{displaylogo: false, responsive: true}});
}}
draw();
}})();"""
