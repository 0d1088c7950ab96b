"""`wsp diagnose`: which physics a campaign's simulation lacks; writes diagnosis.json, model.json and report.html.

A campaign of stops and a folder of creep curves (`[campaign] kind = "creep_curve"`) go to one engine each.
"""

import functools
import json
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, TypeVar

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from wsp_env.cli.folder import make_campaign
from wsp_env.cli.out import OutFolder
from wsp_env.cli.pages import Pages
from wsp_env.cli.workers import WorkersOption, executor_of
from wsp_env.diagnosis.creep_curves import CreepDiagnosis
from wsp_env.diagnosis.creep_curves.report import write_creep_report
from wsp_env.diagnosis.index import Found, summary, write_index
from wsp_env.diagnosis.many import MADE_FROM, Many, diagnose_folder, diagnose_many, remember
from wsp_env.diagnosis.progress import Advance
from wsp_env.diagnosis.report import write_report
from wsp_env.diagnosis.report_facts import LEAST_SHARE, confidence_said, removed_said, worth_said
from wsp_env.diagnosis.words import BALANCES, parameter_said
from wsp_env.executor import Executor, Workers
from wsp_env.output import all_of, ready, write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignError, CampaignWarning
from wsp_env.recordings.origin import hashes
from wsp_env.report import Origin, PageOptions

T = TypeVar("T")

_REPORT_EVERY = 0.1  # share of the whole after which progress is reported to a log again


def main(
    campaigns: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER [FOLDER ...]")],
    /,
    out: OutFolder = Path("out/diagnosis"),
    effort: float = 1.0,
    seed: int = 0,
    workers: int = os.cpu_count() or 1,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "",
    many: WorkersOption = Workers(),
    page: Pages = PageOptions(),
) -> None:
    """Locate where recorded stops, or measured creep curves, and the law differ, and name the missing physics.

    Several campaigns are diagnosed side by side, each into a folder of its own, with a page that lists them all. Broken off,
    the command goes on where it stopped: what the same files and the same code have given before is kept.

    Parameters
    ----------
    campaigns
        Folders that hold campaign.toml and one table per run or creep curve; or recorded files only, for which campaign.toml is
        then written as `wsp inspect` does.
    out
        Folder for diagnosis.json, model.json and report.html; of several campaigns, for a folder of these each and index.html.
    effort
        Of creep curves: multiplies the number of null recordings (99, and no fewer); more of them make rare verdicts surer.
        Stops need no null recordings: their answer does not depend on it.
    seed
        Of the null recordings of creep curves; 0 or more. The answer to stops does not depend on it.
    workers
        Threads that evaluate and refit mechanisms of stops side by side; the answer does not depend on them. Of several
        campaigns each has one.
    as_json
        Print the JSON instead of the verdict.
    vehicle
        Gives mass, inertia and radius where campaign.toml is written: a name (wsp vehicle list) or a vehicle file.
    many
        Who diagnoses several campaigns; the answers do not depend on it.
    page
        How the pages are written.

    """
    if not campaigns:
        raise ParameterError("name at least one folder")
    _check(effort, seed, workers)
    if len(campaigns) > 1:
        _many(campaigns, out, Many(effort, seed), vehicle, executor_of(many), page, as_json)
        return
    _ready(out, page)
    _complete(campaigns[0], vehicle)
    with progress() as report:
        found = diagnose_folder(campaigns[0], Many(effort, seed), report, workers)
    text = json.dumps(found.to_json(), indent=1, allow_nan=False)
    all_of(*_results(out, found, campaigns[0], page), lambda: print(text) if as_json else _print(found, out))


def _complete(folder: Path, vehicle: str) -> None:
    """Write campaign.toml where a folder holds recorded files only."""
    if folder.is_dir() and not (folder / "campaign.toml").exists():
        make_campaign(folder, vehicle, None, Console(stderr=True, highlight=False, soft_wrap=True))


def _results(out: Path, found: Found, folder: Path, options: PageOptions) -> list[Callable[[], None]]:
    """Return what writes the files of a diagnosis."""

    def page() -> None:
        target = out / "report.html"
        if isinstance(found, CreepDiagnosis):
            _page(
                target,
                lambda: write_creep_report(target, found, Origin("wsp diagnose", files=hashes(folder, "curves")), options),
            )
        else:
            _page(target, lambda: write_report(target, found, options))

    text = json.dumps(found.to_json(), indent=1, allow_nan=False)
    return [
        lambda: write_text(out / "diagnosis.json", text + "\n"),
        lambda: write_text(out / "model.json", json.dumps(found.model, indent=1) + "\n"),
        page,
    ]


def _page(target: Path, write: Callable[[], None]) -> None:
    """Write a page; where plotly is not installed, the answer does without, and a line says so."""
    try:
        write()
    except ModuleNotFoundError as missing:
        target.unlink(missing_ok=True)  # of an earlier answer
        print(f"wsp: no {target.name}: {missing}", file=sys.stderr)


def _many(
    folders: Sequence[Path], out: Path, how: Many, vehicle: str, executor: Executor, options: PageOptions, as_json: bool
) -> None:
    """Diagnose campaigns side by side; one that cannot be is reported, and the others are done."""
    names = _apart(folders)
    ready(*options.files(out / "index.html"))
    for name in names.values():
        _ready(out / name, options)
    ordered = list(names.values())
    found: dict[str, Found] = {}
    failed: dict[str, str] = {}

    def fail(folder: Path, why: str) -> None:
        failed[names[folder]] = why
        print(f"wsp: {folder}: {why}", file=sys.stderr)

    for folder in names:
        try:
            _complete(folder, vehicle)
        except (CampaignError, ParameterError) as error:
            fail(folder, str(error))
    wanted = {folder: out / name for folder, name in names.items() if name not in failed}
    for folder, one, said in track(diagnose_many(wanted, how, executor), len(wanted)):
        for warning in said:
            warnings.warn(warning, CampaignWarning, stacklevel=2)
        if isinstance(one, str):
            fail(folder, one)
            continue
        name = names[folder]
        found[name] = one
        (out / name / MADE_FROM).unlink(missing_ok=True)
        all_of(*_results(out / name, one, folder, options))
        remember(folder, out / name, how)
        if not as_json:
            _print(one, out / name)
        found = {name: found[name] for name in ordered if name in found}
        # Anew after each, so that what is done can be read.
        _page(out / "index.html", functools.partial(write_index, out / "index.html", found, failed, options))
    if as_json:
        print(json.dumps({name: one.to_json() for name, one in found.items()}, allow_nan=False))
    elif found:
        pages = out / "index.html"
        print(f"{summary(list(found.values()))} All of them: {pages if pages.exists() else out}")
    if failed:
        sys.exit(1)


def track(doing: Iterator[T], total: int) -> Iterator[T]:
    """Show how many of several campaigns are done: a bar on a terminal, lines in a log."""
    console = Console(stderr=True)
    with Progress(BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=console, transient=True,
                  disable=not console.is_terminal) as bar:  # fmt: skip
        task = bar.add_task("diagnosing", total=total)
        for done, one in enumerate(doing, 1):
            bar.update(task, completed=done)
            if not console.is_terminal:
                print(f"wsp: campaign {done} of {total}", file=sys.stderr, flush=True)
            yield one


def _apart(folders: Sequence[Path]) -> dict[Path, str]:
    """Return a name for each folder, its own where that is unique."""
    names: dict[Path, str] = {}
    for folder in dict.fromkeys(folders):
        own = folder.resolve().name or "campaign"
        count = sum(name.partition(" ")[0] == own for name in names.values())
        names[folder] = f"{own} {count + 1}" if count else own
    return names


def _check(effort: float, seed: int, workers: int) -> None:
    """Refuse what cannot be before the work begins."""
    if not 0.0 < effort < math.inf:
        raise ParameterError(f"effort = {effort:g} is impossible: it must be above 0 and finite")
    if seed < 0:
        raise ParameterError(f"seed = {seed} is impossible: it must be 0 or more")
    if workers < 1:
        raise ParameterError(f"workers = {workers} is impossible: there must be at least 1")


def _ready(out: Path, options: PageOptions) -> None:
    ready(*(out / name for name in ("diagnosis.json", "model.json")), *options.files(out / "report.html"))


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show what step the diagnosis is at and how far it is: a bar on a terminal, lines in a log."""
    console, course = Console(stderr=True), Advance()
    if not console.is_terminal:
        yield lambda step: _report(course, step)
        return
    columns = (BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("diagnosing", total=1.0)
        yield lambda step: bar.update(task, description=escape(step), completed=course.reach(step))


def _report(course: Advance, step: str) -> None:
    before = course.share
    if course.enters(step) or int(course.reach(step) / _REPORT_EVERY) > int(before / _REPORT_EVERY):
        print(f"wsp: {course.reach(step):.0%}: {step}", file=sys.stderr, flush=True)


def _print(found: Found, out: Path) -> None:
    console = Console(highlight=False)
    console.print(f"[bold]{found.verdict}[/bold]: {escape(found.sentence)}")
    for one in found.mechanisms:
        for name, value in one.parameters.items():
            console.print(f"  {one.name.replace('_', ' ')}: {parameter_said(name, value)}", markup=False)
    if not isinstance(found, CreepDiagnosis) and (found.mechanisms or found.discovered):
        console.print(f"  worth in a stop: {worth_said(found)}", markup=False)
        console.print(f"  confidence: {confidence_said(found)}", markup=False)
        console.print(f"  removed: {removed_said(found.fit.removed_validate)}", markup=False)
    for place in (one for one in found.location if one.share >= LEAST_SHARE):
        which = f", axle{'s' * (len(place.axles) > 1)} {', '.join(map(str, place.axles))}" if place.axles else ""
        console.print(
            f"  where: {BALANCES.get(place.equation, place.equation)}{which}, {place.where} ({place.share:.0%} of it)",
            markup=False,
        )
    if isinstance(found, CreepDiagnosis):
        for tied in found.inseparable:
            console.print(f"  left open: {tied.words}", markup=False)
        console.print(f"  null recordings: {max((len(one.null) for one in found.evidence), default=0)}", markup=False)
    else:
        for suspect in found.suspect_channels:
            console.print(f"  channel: {suspect.line}", markup=False)
    console.print(f"  next test: {found.next_test}", markup=False)
    for note in found.notes:
        console.print(f"  note: {note}", markup=False)
    report = out / "report.html"
    console.print(f"Report: [bold]{escape(str(report if report.exists() else out / 'diagnosis.json'))}[/bold]")
