"""`wsp tune`: tau and mu_cd from a campaign of recorded stops, as a table like the seed paper's Table 4 or as JSON."""

import json
from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.recordings import Tuning, read_campaign, tune
from wsp_env.recordings.derive import Smoothing
from wsp_env.recordings.suspect import warn_of_suspects
from wsp_env.recordings.tuning import warn_of_errors


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    fixed_mu_cd: tyro.conf.FlagCreatePairsOff[bool] = False,
    smoothing: Annotated[Smoothing, tyro.conf.arg(name="")] = Smoothing(),
) -> None:
    """Tune tau on the runs of the campaign's tune group; score those and the runs of the validate group.

    Parameters
    ----------
    campaign
        Folder that holds campaign.toml and one table per run.
    as_json
        Print JSON instead of the table.
    fixed_mu_cd
        Keep the friction coefficients of campaign.toml instead of tuning one for each run.
    smoothing
        How the recordings are filtered, and which samples count.

    """
    recorded = read_campaign(campaign)
    warn_of_suspects(recorded)
    tuning = tune(recorded, smoothing, tune_friction=not fixed_mu_cd)
    warn_of_errors(tuning)
    if as_json:
        print(json.dumps(tuning.to_json()))
    else:
        print_table(tuning)


def print_table(tuning: Tuning) -> None:
    """Print tau and the relative errors e_j as the seed paper's Table 4, with every run's mu_cd."""
    from rich.console import Console

    from wsp_env.recordings.validation_report import adhesion_table
    from wsp_env.report import terminal_table

    console = Console(highlight=False)
    console.print(tuning.sentence, markup=False)
    console.print(terminal_table(adhesion_table(tuning)))
