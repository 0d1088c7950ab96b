"""`wsp demo`: recordings, tuning, a validation that passes, the diagnosis of what it concealed, stops with the finding."""

import os
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from wsp_env.cli.demo_stops import found_section, policy_section, worlds
from wsp_env.cli.out import OutFile
from wsp_env.cli.pages import Pages
from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.diagnosis.report import write_report
from wsp_env.diagnosis.report_facts import facts, lead
from wsp_env.diagnosis.report_runs import course_plot
from wsp_env.diagnosis.sources import signed
from wsp_env.output import ready
from wsp_env.recordings import concealed_campaign, read_campaign
from wsp_env.recordings.origin import origin
from wsp_env.recordings.validation import Validation, validate
from wsp_env.recordings.validation_plots import adhesion_plot, transition_plot, worst
from wsp_env.recordings.validation_report import adhesion_table, criteria_table
from wsp_env.report import Facts, PageOptions, Section, Table, plotly, terminal_table, write_page

#: What the recordings of the demo conceal, see wsp_env/data/README.md.
TRUTH = "In the simulator that made these recordings the pads' friction falls with speed and heat;"


def main(
    out: OutFile = Path("out/demo.html"),
    page: Pages = PageOptions(),
) -> None:
    """From recorded stops to the physics that their validation concealed; two minutes at the very first run, then half of one.

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
    _say(console, first := [recorded_section(validation), validated_section(validation)])
    with console.status("diagnosing: does the law lack any physics? ..."):
        found = signed(diagnose(campaign, lambda step: None, os.cpu_count() or 1), folder)
    _say(console, [diagnosis := diagnosis_section(found)])
    last: list[Section] = []
    if found.verdict != "data":  # channels that contradict themselves say nothing to brake with
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


def recorded_section(validation: Validation) -> Section:
    """Show what the recorded stops say: the samples with the tuned curve, and the error of every axle."""
    campaign, tuning = validation.campaign, validation.tuning
    text = (
        f"{len(tuning.runs)} stops of a four-axle coach were recorded in an independent simulator. The law is tuned on "
        f"{', '.join(campaign.tune)} and only scored on {', '.join(campaign.validate)}: {tuning.sentence}.",
    )
    return Section("Recorded stops, and the law tuned on them", text, (adhesion_table(tuning), transition_plot(validation)))


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
