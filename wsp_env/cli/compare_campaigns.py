"""`wsp compare-campaigns`: what changed between two campaigns, and how sure that is."""

import json
import os
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from wsp_env.cli.diagnose import progress
from wsp_env.cli.out import OutFolder
from wsp_env.cli.pages import Pages
from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.diagnosis.changes import friction_change, mechanism_changes, sentence, tau_change
from wsp_env.diagnosis.changes_report import changes_table, labels, to_json, write_changes
from wsp_env.diagnosis.sources import signed, sources
from wsp_env.diagnosis.stored import read_diagnosis
from wsp_env.output import all_of, ready, write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import Campaign, CampaignError, read_campaign, tune
from wsp_env.recordings.origin import hashes, vehicle_said
from wsp_env.report import Origin, PageOptions, terminal_table

_STORED = ("first", "second")  # folders of the diagnoses, in the command's own


def main(
    first: tyro.conf.Positional[Path],
    second: tyro.conf.Positional[Path],
    /,
    out: OutFolder = Path("out/compared"),
    tuned_only: tyro.conf.FlagCreatePairsOff[bool] = False,
    workers: int = os.cpu_count() or 1,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    page: Pages = PageOptions(),
) -> None:
    """Compare two campaigns: before and after a repair, two seasons, two vehicles.

    tau, mu_cd and, from a diagnosis of each, the mechanisms: what changed, with intervals, and whether the data show it.

    Parameters
    ----------
    first
        Folder that holds campaign.toml and one table per run.
    second
        The other one.
    out
        Folder for changes.json and report.html. Both diagnoses are kept in it and used again while their files are the same.
    tuned_only
        Compare tau and mu_cd alone: seconds instead of a minute.
    workers
        Threads of the diagnoses; the answer does not depend on them.
    as_json
        Print the JSON instead of the table.
    page
        How the page is written.

    """
    if workers < 1:
        raise ParameterError(f"workers = {workers} is impossible: there must be at least 1")
    kept = () if tuned_only else tuple(out / name / "diagnosis.json" for name in _STORED)
    ready(out / "changes.json", *page.files(out / "report.html"), *kept)
    campaigns = [read_campaign(folder) for folder in (first, second)]
    tunings = [tune(campaign) for campaign in campaigns]
    changes = [tau_change(*tunings), friction_change(*tunings)]
    found: list[Diagnosis | None] = [None, None]
    if not tuned_only:
        answers = [
            _diagnosed(folder, campaign, file, workers)
            for folder, campaign, file in zip((first, second), campaigns, kept, strict=True)
        ]
        changes += mechanism_changes(*answers)
        found = [*answers]
    names = labels(campaigns[0].name, campaigns[1].name)
    said = sentence(changes, *names)
    document = to_json(changes, dict(zip(names, tunings, strict=True)), said)
    sides = tuple(zip(campaigns, tunings, found, strict=True))
    files = [(f"{name}/{file}", digest) for name, folder in zip(names, (first, second), strict=True)
             for file, digest in hashes(folder)]  # fmt: skip
    vehicle = "; ".join(f"{name}: {vehicle_said(one.vehicle)}" for name, one in zip(names, campaigns, strict=True))
    made_from = Origin("wsp compare-campaigns", vehicle, files)

    def tell() -> None:
        if as_json:
            print(json.dumps(document))
            return
        console = Console(highlight=False)
        console.print(said, markup=False)
        console.print(terminal_table(changes_table(changes, names)))
        console.print(f"Report: {out / 'report.html'}", markup=False)

    all_of(
        lambda: write_text(out / "changes.json", json.dumps(document, indent=1) + "\n"),
        lambda: write_changes(out / "report.html", sides, changes, made_from, page),
        tell,
    )


def _diagnosed(folder: Path, campaign: Campaign, file: Path, workers: int) -> Diagnosis:
    """Return the diagnosis of a campaign: the one that is kept, if it was made from the same files by this version."""
    import wsp_env

    if file.exists():
        try:
            kept = read_diagnosis(file)
        except CampaignError:
            kept = None
        if kept is not None and kept.sources == sources(folder) and kept.version == wsp_env.__version__:
            return kept
    with progress() as report:
        found = signed(diagnose(campaign, report, workers), folder)
    write_text(file, json.dumps(found.to_json(), indent=1, allow_nan=False) + "\n")
    return found
