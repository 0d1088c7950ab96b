"""`wsp diagnose`: which physics a campaign's simulation lacks; writes diagnosis.json, model.json and report.html.

A campaign of stops and a folder of creep curves (`[campaign] kind = "creep_curve"`) go to one engine each.
"""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.diagnosis.creep_curves import CreepDiagnosis, diagnose_creep_curves
from wsp_env.diagnosis.creep_curves.report import write_creep_report
from wsp_env.diagnosis.report import write_report
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import read_campaign
from wsp_env.recordings.creep_curves import holds_creep_curves, read_creep_curves
from wsp_env.report import write_text


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/diagnosis"),
    effort: float = 1.0,
    seed: int = 0,
    workers: int = os.cpu_count() or 1,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Locate where recorded stops, or measured creep curves, and the law differ, and name the missing physics.

    Parameters
    ----------
    campaign
        Folder that holds campaign.toml and one table per run or creep curve.
    out
        Folder for diagnosis.json, model.json and report.html.
    effort
        Multiplies the number of null recordings: more of them make rare verdicts surer.
    seed
        Of the null recordings.
    workers
        Threads that search null recordings and refit mechanisms side by side; the answer does not depend on them.
    as_json
        Print the JSON instead of the verdict.

    """
    if not effort > 0.0:
        raise ParameterError(f"effort = {effort:g} is impossible: it must be above 0")
    if not workers > 0:
        raise ParameterError(f"workers = {workers} is impossible: there must be at least 1")
    found: Diagnosis | CreepDiagnosis
    if holds_creep_curves(campaign):
        curves = read_creep_curves(campaign)
        with _progress() as told:
            found = diagnose_creep_curves(curves, effort, seed, told)
        write_creep_report(out / "report.html", found)
    else:
        recorded = read_campaign(campaign)
        with _progress() as told:
            found = diagnose(recorded, effort, seed, told, workers)
        write_report(out / "report.html", found)
    text = json.dumps(found.to_json(), indent=1, allow_nan=False)
    write_text(out / "diagnosis.json", text + "\n")
    write_text(out / "model.json", json.dumps(found.model, indent=1) + "\n")
    if as_json:
        print(text)
    else:
        _print(found, out)


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Show what step the diagnosis is at."""
    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task("diagnosing")
        yield lambda step: bar.update(task, description=step)


def _print(found: Diagnosis | CreepDiagnosis, out: Path) -> None:
    console = Console(highlight=False)
    console.print(f"[bold]{found.verdict}[/bold]: {found.sentence}")
    for one in found.mechanisms:
        for name, value in one.parameters.items():
            low, high = value.interval90
            console.print(f"  {one.name}: {name} = {value.value:.3g} {value.unit} ({low:.3g} to {high:.3g})")
    for place in found.location:
        axles = f", axles {', '.join(map(str, place.axles))}" if place.axles else ""
        console.print(f"  where: {place.equation} balance{axles}, {place.where} ({place.share:.0%} of it)")
    if isinstance(found, CreepDiagnosis):
        for tied in found.inseparable:
            console.print(f"  left open: {tied.words}")
    console.print(f"  next test: {found.next_test}")
    for note in found.notes:
        console.print(f"  note: {note}")
    console.print(f"Report: [bold]{out / 'report.html'}[/bold]")
