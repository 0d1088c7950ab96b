"""`wsp tune`: tau and mu_cd from a campaign of recorded stops, as a table like the seed paper's Table 4 or as JSON."""

import json
from pathlib import Path
from typing import Annotated, Any

import tyro

from wsp_env.recordings import Tuning, read_campaign, tune
from wsp_env.recordings.derive import Smoothing


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
    tuning = tune(read_campaign(campaign), smoothing, tune_friction=not fixed_mu_cd)
    if as_json:
        print(json.dumps(to_json(tuning)))
    else:
        print_table(tuning, fixed_mu_cd)


def to_json(tuning: Tuning) -> dict[str, Any]:
    """Return the tuning as plain data: errors per axle, null where an axle never slides."""
    runs = {name: {"mu_cd": score.mu_cd, "error": list(score.error)} for name, score in tuning.runs.items()}
    return {"tau_m_per_J": tuning.tau_m_per_J, "interval95": list(tuning.interval95), "runs": runs}


def print_table(tuning: Tuning, fixed_mu_cd: bool = False) -> None:
    """Print the relative errors e_j as the seed paper's Table 4, with every run's mu_cd."""
    from rich.console import Console
    from rich.table import Table

    low, high = tuning.interval95
    console = Console()
    console.print(f"tau = {tuning.tau_m_per_J:.3e} m/J, 95 % interval {low:.3e} to {high:.3e} m/J", highlight=False)
    table = Table(title="Relative errors e_j of the adhesion coefficient", title_justify="left")
    table.add_column("Run")
    table.add_column("Group")
    table.add_column("mu_cd [-]", justify="right")
    axles = len(next(iter(tuning.runs.values())).error)
    for axle in range(1, axles + 1):
        table.add_column(f"e_{axle} [%]", justify="right")
    for name, score in tuning.runs.items():
        mark = "" if score.slides and not fixed_mu_cd else "*"
        errors = ("-" if error is None else f"{100 * error:.1f}" for error in score.error)
        table.add_row(name, score.group, f"{score.mu_cd:.4f}{mark}", *errors)
    console.print(table)
    if fixed_mu_cd or not all(score.slides for score in tuning.runs.values()):
        console.print("* as campaign.toml has it, not tuned;  - no sliding, nothing to compare", highlight=False)
