"""`wsp validate`: the tuned law against recordings it was not tuned on, and in the vehicle, as the seed paper does."""

import json
import sys
from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.cli.out import OutFile
from wsp_env.cli.pages import Pages
from wsp_env.executor import Processes
from wsp_env.output import ready
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import Campaign, read_campaign
from wsp_env.recordings.derive import Smoothing
from wsp_env.recordings.origin import origin
from wsp_env.recordings.suspect import warn_of_suspects
from wsp_env.recordings.tuning import warn_of_errors
from wsp_env.recordings.validation import CLOSED_LOOP_BY, ClosedLoop, validate
from wsp_env.report import PageOptions

_WIDTH = 160  # of tables in a file or a pipe


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    out: OutFile = Path("out/validation.html"),
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    fixed_mu_cd: tyro.conf.FlagCreatePairsOff[bool] = False,
    controller: str = "",
    smoothing: Annotated[Smoothing, tyro.conf.arg(name="")] = Smoothing(),
    page: Pages = PageOptions(),
) -> None:
    """Tune on the tune group, score the validate group, simulate every stop with its recorded brake torque.

    With a controller, every stop also in closed loop under the recorded conditions, compared by the slide's statistics only.
    What a diagnosis has found is not part of the law: wsp replay --model simulates the stops with it.

    Parameters
    ----------
    campaign
        Folder that holds campaign.toml and one file per run.
    out
        The page with interactive plots to write.
    as_json
        Print JSON instead of the tables, and write no page.
    fixed_mu_cd
        Keep the friction coefficients of campaign.toml instead of tuning one for each run.
    controller
        Also simulate in closed loop with this one: a short name (none, rule-based, slip, extremum, adaptive),
        package.module:Class or path.py:Class; such code is run.
    smoothing
        How the recordings are filtered, and which samples count.
    page
        How the page is written.

    """
    if controller and fixed_mu_cd:
        raise ParameterError("--controller brakes with the tuned friction coefficients: leave out --fixed-mu-cd")
    if as_json:
        recorded = read_campaign(campaign)
        warn_of_suspects(recorded)
        validation = validate(recorded, smoothing, not fixed_mu_cd)
        warn_of_errors(validation.tuning)
        found = validation.to_json()
        if controller:
            figures = {name: slide.figures() for name, slide in _closed_loop(recorded, controller, smoothing).items()}
            found["closed_loop"] = {"controller": controller, "compared_by": CLOSED_LOOP_BY, "runs": figures}
        print(json.dumps(found))
        return
    from rich.console import Console
    from rich.markup import escape

    from wsp_env.recordings import validation_report as report
    from wsp_env.report import plotly, terminal_table

    plotly()  # says at once when it is missing
    ready(*page.files(out))
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    recorded = read_campaign(campaign)
    warn_of_suspects(recorded)
    validation = validate(recorded, smoothing, not fixed_mu_cd)
    warn_of_errors(validation.tuning)
    console.print(validation.tuning.sentence, markup=False)
    tables = [report.adhesion_table(validation.tuning)]
    tables += [table(validation) for table in (report.slide_table, report.window_table, report.criteria_table)]
    closed = None
    if controller:
        closed = report.closed_loop_table(controller, _closed_loop(recorded, controller, smoothing))
        tables.append(closed)
    for table in tables:
        console.print(terminal_table(table))
    console.print(f"[bold]{escape(validation.verdict)}[/bold]")
    report.write(out, validation, closed, origin("wsp validate", recorded, campaign), page)
    console.print(f"Interactive plots: [bold]{escape(str(out))}[/bold]")


def _closed_loop(campaign: Campaign, controller: str, smoothing: Smoothing) -> dict[str, ClosedLoop]:
    """Let the controller brake under each run's conditions; as fast as the recorded stops are compared."""
    from wsp_env.evaluation.replay import RECORDED, replay

    result = replay(campaign, {controller: {}}, smoothing=smoothing, executor=Processes(1))
    for message in result.failures.values():
        sys.exit(f"wsp: {controller} failed: {message}")
    slips = {(c.stop, c.who): c.slip_mps[c.speed_mps > smoothing.least_speed_mps] for c in result.courses}
    stops = dict.fromkeys(course.stop for course in result.courses)
    return {stop: ClosedLoop.of(slips[stop, RECORDED], slips[stop, controller]) for stop in stops}
