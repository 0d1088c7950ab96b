"""`wsp validate`: the tuned law against recordings it was not tuned on, and in the vehicle, as the seed paper does."""

import json
from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.recordings import read_campaign
from wsp_env.recordings.derive import Smoothing
from wsp_env.recordings.validation import validate


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/validation.html"),
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    fixed_mu_cd: tyro.conf.FlagCreatePairsOff[bool] = False,
    smoothing: Annotated[Smoothing, tyro.conf.arg(name="")] = Smoothing(),
) -> None:
    """Tune on the tune group, score the validate group, simulate every stop with its recorded brake torque.

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
    smoothing
        How the recordings are filtered, and which samples count.

    """
    if as_json:
        print(json.dumps(validate(read_campaign(campaign), smoothing, not fixed_mu_cd).to_json()))
        return
    from rich.console import Console

    from wsp_env.recordings import validation_report as report
    from wsp_env.report import plotly, terminal_table

    plotly()  # says at once when it is missing
    console = Console(highlight=False)
    validation = validate(read_campaign(campaign), smoothing, not fixed_mu_cd)
    low, high = validation.tuning.interval95
    console.print(f"tau = {validation.tuning.tau_m_per_J:.3e} m/J, 95 % interval {low:.3e} to {high:.3e} m/J")
    console.print(terminal_table(report.adhesion_table(validation.tuning)))
    for table in (report.slide_table, report.window_table, report.criteria_table):
        console.print(terminal_table(table(validation)))
    console.print(f"[bold]{validation.verdict}[/bold]")
    report.write(out, validation)
    console.print(f"Interactive plots: [bold]{out}[/bold]")
