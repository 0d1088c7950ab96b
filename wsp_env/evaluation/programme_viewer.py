"""Any stop of an evaluation, chosen by menus and drawn in the browser."""

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsp_env.evaluation.evaluate import KEYS, ProgrammeResult, Trace
from wsp_env.evaluation.results import TRACE_SAMPLES
from wsp_env.report import COLOURS

_MISSING = "The stops are drawn by plotly's library, which the page loads from the network; --standalone does without."


class Viewer:
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
  const layout = {{template: null, height: 760, hovermode: "closest", margin: {{l: 70, r: 20, t: 40, b: 50}},
    legend: {{orientation: "h", y: 1.06}},
    xaxis: {{title: {{text: "time [s]"}}, anchor: "y3"}}, yaxis: {{title: {{text: "speed [m/s]"}}, domain: [0.68, 1]}},
    yaxis2: {{title: {{text: "slip speed [m/s]"}}, domain: [0.35, 0.63]}},
    yaxis3: {{title: {{text: "pressure [bar]"}}, domain: [0, 0.3]}}}};
  Plotly.react("course", traces, layout, {{displaylogo: false, responsive: true}});
}}
const fold = document.getElementById("course").closest("details");
if (!window.Plotly) document.getElementById("course-note").textContent = {json.dumps(_MISSING)};
else if (!fold || fold.open) draw();
else fold.addEventListener("toggle", () => fold.open && draw());
}})();"""
