"""A page with every signal of a campaign as it was read, before any model; what was repaired or is not trusted is shaded."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.recording import Recording
from wsp_env.report import COLOURS, Figure, Origin, PageOptions, Section, axes, plotly, write_page

_POINTS = 1000  # of a line: more cannot be told apart on a screen
_SHADE = "rgba(213, 94, 0, 0.18)"
_LEGEND_PX = 150  # room for the legend beside a plot
_MOST_STRETCHES = 200  # shaded ones of a figure


def write_signals(
    path: Path,
    campaign: Campaign,
    made_from: Origin = Origin("wsp inspect"),
    options: PageOptions = PageOptions(),
    suspicions: Sequence[str] = (),
) -> None:
    """Write the page; `ModuleNotFoundError` without plotly.

    Parameters
    ----------
    suspicions : a line for each channel that contradicts the others

    """
    sections: list[Section] = []
    for name, run in campaign.runs.items():
        group = "tunes" if name in campaign.tune else "validates" if name in campaign.validate else "in no group"
        share = 0.0 if run.suspect is None else float(run.suspect.mean())
        text = [f"{len(run.time_s)} samples; {_missing(run)}; {100.0 * share:.1f} % not compared with the law."]
        sections.append(Section(f"{name} ({group})", [*text, *run.warnings], _figures(run), fold=bool(sections)))
    lead = (
        "Every channel as it was read, on one clock. Shaded: repaired, or not to be trusted, on the axle of that colour or all."
    )
    if suspicions:
        said = [f"Suspect: {one}." for one in suspicions]
        sections.insert(0, Section("Channels that contradict the others", said, fold=False))
    write_page(path, f"Signals of campaign {campaign.name}", lead, sections, made_from, options)


def _missing(run: Recording) -> str:
    axles = ", ".join(map(str, run.missing_axles))
    return f"no sensor on axle {axles}" if axles else "every axle has its sensor"


def _figures(run: Recording) -> list[Figure]:
    found = [
        _figure(run, "speed [rad/s]", run.wheel_speed_radps, "wheel"),
        _figure(run, "torque [N m]", run.brake_torque_nm, "brake"),
    ]
    speed = _figure(run, "speed [m/s]", run.vehicle_speed_mps[:, None], "vehicle")
    for values, what, unit in (
        (run.cylinder_pressure_bar, "cylinder", "pressure [bar]"),
        (run.wheel_load_n, "load", "wheel load [N]"),
        (run.valve_command, "valve", "command [-]"),
    ):
        if values is not None:
            found.append(_figure(run, unit, values, what))
    return [speed, *found]


def _figure(run: Recording, y: str, values: np.ndarray, what: str) -> Any:
    objects, _ = plotly()
    figure = objects.Figure()
    thin = slice(None, None, max(1, len(run.time_s) // _POINTS))
    for k, column in enumerate(values.T):
        name = what if values.shape[1] == 1 else f"{what}, axle {k + 1}"
        line = {"width": 1.2, "color": COLOURS[k % len(COLOURS)]}
        figure.add_scatter(x=run.time_s[thin], y=column[thin], mode="lines", name=name, line=line)
    if run.suspect is not None:
        for start, end in _stretches(np.asarray(run.suspect.any(axis=1)))[:_MOST_STRETCHES]:
            figure.add_vrect(x0=run.time_s[start], x1=run.time_s[end - 1], fillcolor=_SHADE, line_width=0, layer="below")
    axes(figure, "time [s]", y, height=260)
    figure.update_layout(margin_r=_LEGEND_PX)  # the same time at the same place, whether a plot has a legend or not
    return figure


def _stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
