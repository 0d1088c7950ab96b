"""`wsp demo`: recordings, tuning, a validation that passes, the diagnosis of what it concealed, stops with the finding."""

import math
import os
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape

from wsp_env.cli.demo_stops import found_section, policy_section, worlds
from wsp_env.cli.pages import Pages
from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.diagnosis.report import write_report
from wsp_env.diagnosis.report_facts import facts, lead
from wsp_env.diagnosis.report_runs import course_plot
from wsp_env.diagnosis.sources import signed
from wsp_env.output import ready
from wsp_env.recordings import (
    Campaign,
    Smoothing,
    Tuning,
    concealed_campaign,
    derive,
    read_campaign,
    rolling_radii,
    transition,
)
from wsp_env.recordings.origin import origin
from wsp_env.recordings.validation import Validation, validate
from wsp_env.recordings.validation_plots import adhesion_plot, worst
from wsp_env.recordings.validation_report import criteria_table
from wsp_env.report import COLOURS, Facts, PageOptions, Section, Table, axes, plotly, terminal_table, write_page

#: What the recordings of the demo conceal, see wsp_env/data/README.md.
TRUTH = "In the simulator that made these recordings the pads' friction falls with speed and heat;"


def main(
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/demo.html"),
    page: Pages = PageOptions(),
) -> None:
    """From recorded stops to the physics that their validation concealed; a minute at the very first run, then seconds.

    Parameters
    ----------
    out
        The page with interactive plots to write; the whole diagnosis is written beside it, as NAME_diagnosis.html.
    page
        How the pages are written.

    """
    whole = out.with_name(f"{out.stem}_diagnosis.html")
    plotly()
    ready(*page.files(out), *page.files(whole))
    console, folder = Console(highlight=False), concealed_campaign()
    with console.status("reading recorded stops, tuning and validating ..."):
        campaign = read_campaign(folder)
        validation = validate(campaign)
    _say(console, first := [recorded_section(campaign, validation.tuning), validated_section(validation)])
    with console.status("diagnosing: does the law lack any physics? ..."):
        found = signed(diagnose(campaign, lambda step: None, os.cpu_count() or 1), folder, campaign)
    _say(console, [diagnosis := diagnosis_section(found)])
    with console.status("braking with what was found ..."):
        before, after = worlds(campaign, validation.tuning, found.model)
        last = [found_section(before, after, campaign.validate[0]), policy_section(after)]
    _say(console, last)
    sections = [*first, diagnosis, *last]
    write_page(
        out,
        "wsp-env: from recordings to the physics they conceal",
        lead(found),
        sections,
        origin("wsp demo", campaign, folder),
        page,
    )
    write_report(whole, found, page)
    console.print(f"\nAll of it, with plots: [bold]{escape(str(out))}[/bold]\nThe diagnosis: [bold]{escape(str(whole))}[/bold]")


def _say(console: Console, sections: list[Section]) -> None:
    """Print sections as far as a terminal can show them."""
    for section in sections:
        console.print(f"\n[bold]{escape(section.title)}[/bold]")
        console.print("\n".join(section.text), markup=False)
        for shown in section.shows:
            if isinstance(shown, Table):
                console.print(terminal_table(shown))
            elif isinstance(shown, Facts):
                for label, text in shown.rows:
                    console.print(f"  {label}: {text}", markup=False)


def recorded_section(campaign: Campaign, tuning: Tuning) -> Section:
    """Show what the recorded stops say: lambda over W_sp with the tuned curve, the errors e_j."""
    objects, _ = plotly()
    figure = objects.Figure()
    radii = rolling_radii(campaign)
    largest = 0.0
    for index, (name, score) in enumerate(tuning.runs.items()):
        derived = derive(campaign, campaign.runs[name], radii, Smoothing())
        energy = derived.energy_jpm[derived.usable]
        recovered = transition(derived, score.mu_cd, campaign.contact.law)[derived.usable]
        largest = max(largest, float(energy.max()))
        thin = slice(None, None, max(1, len(energy) // 800))
        marker = {"size": 3, "color": COLOURS[index], "opacity": 0.5}
        label = f"{name} ({score.group})"
        figure.add_scatter(x=energy[thin], y=recovered[thin], mode="markers", name=label, marker=marker)
    grid = [largest * step / 199.0 for step in range(200)]
    law = [-math.expm1(-tuning.tau_m_per_J * energy) for energy in grid]
    figure.add_scatter(x=grid, y=law, mode="lines", name="1 - exp(-tau W_sp)", line={"color": "black", "width": 3})
    figure.update_layout(legend_itemsizing="constant")
    axes(figure, "specific dissipated energy W_sp [J/m]", "transition function lambda [-]", height=460)
    header = ("run", "group", "mu_cd [-]", *(f"e_{k + 1} [%]" for k in range(campaign.vehicle.axles)))
    rows = [
        (name, score.group, f"{score.mu_cd:.4f}", *("no slide" if e is None else f"{100 * e:.2f}" for e in score.error))
        for name, score in tuning.runs.items()
    ]
    low, high = tuning.interval95
    text = (
        f"{len(tuning.runs)} stops of a four-axle coach, recorded in an independent simulator, give "
        f"tau = {tuning.tau_m_per_J:.3e} m/J (95 % interval {low:.3e} to {high:.3e}), tuned on {', '.join(campaign.tune)} "
        f"and only scored on {', '.join(campaign.validate)}.",
    )
    table = Table(header, rows, "relative error of the adhesion coefficient per axle, as the seed paper's Table 4")
    return Section("Recorded stops, and the law tuned on them", text, (table, figure))


def validated_section(validation: Validation) -> Section:
    """Show the law against the run it was not tuned on: the paper's figures, and the axle that fits worst."""
    text = [f"{validation.verdict} Most would stop here."]
    shows: list[Any] = [criteria_table(validation)]
    if (shown := worst(validation)) is not None:
        text.append(f"The worst fit of all held-out axles: run {shown.run}, axle {shown.axle + 1}.")
        shows.append(adhesion_plot(validation, shown.run, shown.axle, height=430))
    return Section("The tuned law, validated on a stop it has not seen", text, shows)


def diagnosis_section(found: Diagnosis) -> Section:
    """Show what the diagnosis found: its facts, and a run before and after."""
    shows: list[Any] = [facts(found)]
    if found.course:
        shows.append(course_plot(found.course, found.course.shows, bool(found.mechanisms or found.discovered)))
    text = [
        lead(found),
        f"{TRUTH} campaign.toml does not say so.",
    ]
    return Section("What the validation concealed: the diagnosis", text, shows)
