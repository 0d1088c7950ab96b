"""The page of `wsp compare-campaigns`: the changes, their confidence and their worth; then both campaigns side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.diagnosis.changes import Change, sentence
from wsp_env.diagnosis.report_facts import MEANINGS, worth_said
from wsp_env.diagnosis.report_runs import course_plot
from wsp_env.recordings import Campaign, Tuning
from wsp_env.report import COLOURS, Facts, Figure, Origin, PageOptions, Section, Table, axes, plotly, write_page

_SHOWN = {True: "yes", False: "no", None: "cannot tell"}


def changes_table(changes: Sequence[Change], names: tuple[str, str]) -> Table:
    """Return a table of all compared quantities and their changes."""
    rows = [(one.what, one.first, one.second, one.difference, _SHOWN[one.shown]) for one in changes]
    caption = (
        "Change shown: the interval of the difference leaves out none. In brackets the intervals; of mu_cd the runs' own range."
    )
    return Table(("Quantity", *names, "Difference", "Change shown"), rows, caption)


def write_changes(
    path: Path,
    sides: tuple[tuple[Campaign, Tuning, Diagnosis | None], ...],
    changes: Sequence[Change],
    made_from: Origin,
    options: PageOptions = PageOptions(),
) -> None:
    """Write the page; `sides` holds the first and the second campaign; a diagnosis is None if it was not made."""
    names = labels(sides[0][0].name, sides[1][0].name)
    tunings = [tuning for _, tuning, _ in sides]
    sections = [
        Section("", (), [_facts(sides, names), _picture(tunings, names)]),
        Section("All that was compared", (), [changes_table(changes, names)], fold=True),
        Section("What was believed of the vehicle", (), [_beliefs([campaign for campaign, _, _ in sides], names)], fold=True),
    ]
    for name, (_, _, found) in zip(names, sides, strict=True):
        if found is not None:
            shows = (
                [course_plot(found.course, found.course.shows, bool(found.mechanisms or found.discovered))]
                if found.course
                else []
            )
            sections.append(Section(f"The diagnosis of {name}", [found.sentence], shows, fold=True))
    write_page(path, f"{names[0]} beside {names[1]}", sentence(changes, *names), sections, made_from, options)


def labels(first: str, second: str) -> tuple[str, str]:
    """Return distinct labels for both campaigns."""
    return (first, second) if first != second else (f"{first} (first)", f"{second} (second)")


def _facts(sides: Sequence[tuple[Campaign, Tuning, Diagnosis | None]], names: tuple[str, str]) -> Facts:
    rows = []
    for name, (campaign, _, found) in zip(names, sides, strict=True):
        if found is None:
            rows.append((name, f"{len(campaign.runs)} runs; not diagnosed"))
            continue
        worth = f" Worth in a stop: {worth_said(found)}." if found.mechanisms or found.discovered else ""
        rows.append((name, f"{len(campaign.runs)} runs; {found.verdict}: {MEANINGS[found.verdict]}.{worth}"))
    return Facts(rows)


def _picture(tunings: Sequence[Tuning], names: tuple[str, str]) -> Figure:
    """Draw tau with its interval, and mu_cd of every run that slides, of both campaigns."""
    _, subplots = plotly()
    figure = subplots.make_subplots(
        1, 2, column_widths=[0.4, 0.6], subplot_titles=["tau, 95 % interval", "mu_cd of every run that slides"],
        horizontal_spacing=0.12,
    )  # fmt: skip
    for i, (name, tuning) in enumerate(zip(names, tunings, strict=True)):
        colour = COLOURS[i]
        low, high = tuning.interval95
        bounds: dict[str, Any] = {"color": colour, "thickness": 3}
        if tuning.determined:
            bounds |= {"array": [high - tuning.tau_m_per_J], "arrayminus": [tuning.tau_m_per_J - low]}
        figure.add_scatter(
            x=[name], y=[tuning.tau_m_per_J], error_y=bounds, mode="markers", name=name, legendgroup=name,
            marker={"color": colour, "size": 12}, row=1, col=1,
        )  # fmt: skip
        scores = {run: score.mu_cd for run, score in tuning.runs.items() if score.slides}
        figure.add_scatter(
            x=[name] * len(scores), y=list(scores.values()), text=list(scores), textposition="middle right",
            mode="markers+text",
            name=name, legendgroup=name, showlegend=False, marker={"color": colour, "size": 9}, row=1, col=2,
        )  # fmt: skip
    axes(figure, "campaign [-]", "", height=400, showlegend=False)
    figure.update_yaxes(title_text="recovery rate tau [m/J]", rangemode="tozero", exponentformat="power", row=1, col=1)
    figure.update_yaxes(title_text="friction mu_cd [-]", row=1, col=2)
    figure.update_xaxes(range=[-0.5, 1.5])
    result: Figure = figure
    return result


def _beliefs(campaigns: Sequence[Campaign], names: tuple[str, str]) -> Table:
    """Return the vehicle data in both campaigns' files; a difference in the data is not a change of the vehicle."""
    rows = []
    words = {"axles": "axles", "mass_kg": "mass [kg]", "wheelset_inertia_kgm2": "wheelset inertia [kg m2]",
             "wheel_radius_m": "wheel radius [m]", "brake_torque_source": "brake torque"}  # fmt: skip
    for field, name in words.items():
        values = [str(getattr(campaign.vehicle, field)) for campaign in campaigns]
        rows.append((name, *values, "yes" if values[0] == values[1] else "no"))
    return Table(("Belief", *names, "Alike"), rows, "Where they differ, part of what changed may be a change of belief.")


def to_json(changes: Sequence[Change], tunings: Mapping[str, Tuning], said: str) -> dict[str, Any]:
    """Return the comparison as plain data."""
    return {
        "sentence": said,
        "changes": [change._asdict() for change in changes],
        "campaigns": {name: tuning.to_json() for name, tuning in tunings.items()},
    }
