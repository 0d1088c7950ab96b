"""A page with every signal of a campaign as it was read, before any model; what was repaired or is not trusted is shaded."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.recording import Recording
from wsp_env.report import COLOURS, Figure, Origin, PageOptions, Section, axes, plotly, write_page

_POINTS = 1000  # of a line: more cannot be told apart on a screen
_MOST_POINTS = 60_000  # of all lines: with them a page has 0.4 MB
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
    lines = sum(1 + sum(values.shape[1] for values, _, _ in _channels(run)) for run in campaign.runs.values())
    points = min(_POINTS, _MOST_POINTS // lines + 1)
    for name, run in campaign.runs.items():
        group = "tunes" if name in campaign.tune else "validates" if name in campaign.validate else "in no group"
        share = 0.0 if run.suspect is None else float(run.suspect.mean())
        text = [f"{len(run.time_s)} samples; {_missing(run)}; {100.0 * share:.1f} % not compared with the law."]
        said = [one.replace(f"{path.parent}{os.sep}", "") for one in run.warnings]  # who forwards the page forwards no folders
        sections.append(Section(f"{name} ({group})", [*text, *said], _figures(run, points), fold=bool(sections)))
    lead = "Every channel as it was read, on one clock. Shaded: repaired, or not to be trusted, on one axle or more."
    if suspicions:
        said = [f"Suspect: {one}." for one in suspicions]
        sections.insert(0, Section("Channels that contradict the others", said, fold=False))
    write_page(path, f"Signals of campaign {campaign.name}", lead, sections, made_from, options)


def _missing(run: Recording) -> str:
    axles = ", ".join(map(str, run.missing_axles))
    return f"no sensor on axle {axles}" if axles else "every axle has its sensor"


def _channels(run: Recording) -> list[tuple[np.ndarray, str, str]]:
    """Return what a run has of every axle: values (T, axles), what they are, and their axis."""
    found: list[tuple[np.ndarray | None, str, str]] = [
        (run.wheel_speed_radps, "wheel", "speed [rad/s]"),
        (run.brake_torque_nm, "brake", "torque [N m]"),
        (run.cylinder_pressure_bar, "cylinder", "pressure [bar]"),
        (run.wheel_load_n, "load", "wheel load [N]"),
        (run.valve_command, "valve", "command [-]"),
    ]
    return [(values, what, unit) for values, what, unit in found if values is not None]


def _figures(run: Recording, points: int) -> list[Figure]:
    speed = _figure(run, "speed [m/s]", run.vehicle_speed_mps[:, None], "vehicle", points)
    return [speed, *(_figure(run, unit, values, what, points) for values, what, unit in _channels(run))]


def _figure(run: Recording, y: str, values: np.ndarray, what: str, points: int) -> Any:
    objects, _ = plotly()
    figure = objects.Figure()
    thin = slice(None, None, -(-len(run.time_s) // points))
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
