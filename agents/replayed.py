"""Controllers under the conditions of recorded stops: `python -m agents.replayed CAMPAIGN ...`, folders with campaign.toml.

The law is tuned on each campaign, every stop gets its initial speed, demand, load, mu_cd and tau, as `wsp replay` does. The
shipped policy and all classical controllers brake the stops of all campaigns. The table gives each controller's distance as a
ratio to the front of the rules, and to the lower envelope of the others' fronts (see `agents.rivals`), at its own mean slip.
Standard errors are those of campaigns drawn anew, of stops where there is one campaign.
"""

import dataclasses
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich.progress import track

from agents.drawn import KEPT, REPORTED, Stops, against, means_of, standard_error
from agents.measure import Yardstick
from agents.rivals import classical
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.replay import braked
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignWarning, conditions, read_campaign, tune


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is replayed."""

    campaigns: Annotated[tuple[Path, ...], tyro.conf.Positional]
    vehicle: Literal["wheelset", "bogie", "coach"] = "coach"  # whose policy and thresholds; the campaigns have as many axles
    folder: Path = Path()  # of the policy; none: agents/trained/VEHICLE
    json: bool = False


def yardsticks(campaigns: Sequence[Path]) -> list[Yardstick]:
    """Return the conditions of the recorded stops of each campaign."""
    found = []
    for folder in campaigns:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CampaignWarning)  # `wsp validate` tells of them
            campaign = read_campaign(folder)
        vehicle, stops, _ = braked(campaign, conditions(campaign, tune(campaign)))
        found.append(Yardstick(vehicle, stops))
    return found


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each controller: its means, over the bound, and over the fronts at its own slip."""
    measured = yardsticks(arguments.campaigns)
    own = load_policy(arguments.folder if arguments.folder.name else Path("agents/trained") / arguments.vehicle)
    for yardstick in measured:
        try:
            own.check(yardstick.vehicle, yardstick.conduct.control_interval_s, yardstick.conduct.pressure_sensors)
        except ParameterError as error:
            raise SystemExit(f"{error}; choose its policy with --vehicle") from None
    every = {(family, who): one for family, members in classical(arguments.vehicle).items() for who, one in members.items()}
    found: dict[tuple[str, str], Stops] = {}
    ran_on: dict[tuple[str, str], int] = {}
    for key, controller in track([*every.items(), (("", "policy"), own)], "braking", transient=True):
        parts = [yardstick.figures(controller) for yardstick in measured]
        found[key] = {name: np.concatenate([part[name] for part in parts]).tolist() for name in KEPT}
        ran_on[key] = int(sum(np.sum(~part["stopped"]) for part in parts))
    sizes = [len(one.stops) for one in measured]
    blocks = np.repeat(np.arange(len(sizes)), sizes) if len(sizes) > 1 else np.arange(sizes[0])
    bound = float(np.concatenate([one.top.shortest()[0] for one in measured]).mean())
    rows = []
    for (family, who), stops in found.items():
        means = means_of(stops)
        row: dict[str, Any] = {"controller": f"{family} {who}".strip(), "stops": len(blocks), "ran_on": ran_on[family, who]}
        row |= means | {"over_bound": means["distance_m"] / bound}
        rules = [value for (other, _), value in found.items() if other == "rules" != family]
        rivals = [value for (other, _), value in found.items() if other not in ("", family)]
        for name, others in (("rules", rules), ("envelope", rivals)):
            row[f"over_{name}"] = against(means, [means_of(one) for one in others])
            row[f"over_{name}"] |= {"distance_error": standard_error(stops, others, blocks)}
        rows.append(row)
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| controller | distance [m] | slip [m/s] | distance / rules' front | distance / envelope "
        "| standard deviation of slip / envelope | energy / envelope | air / envelope | distance / bound | longest lock [s] |",
        "|:--|" + "--:|" * 9,
    ]
    for row in rows:
        cells = [row["controller"] + (f" ({row['ran_on']} of {row['stops']} ran on)" if row["ran_on"] else "")]
        beyond = " (beyond the front)" if row["over_envelope"]["beyond_front"] else ""
        cells += [f"{row['distance_m']:.0f}", f"{row['mean_slip_mps']:.2f}{beyond}"]
        for name in ("rules", "envelope"):
            ratio, error = row[f"over_{name}"]["distance_m_ratio"], row[f"over_{name}"]["distance_error"]
            cells.append("" if np.isnan(ratio) else f"{ratio:.3f} ± {error:.3f}")
        cells += [f"{row['over_envelope'][f'{figure}_ratio']:.2f}" for figure in REPORTED[1:]]
        lines.append("| " + " | ".join([*cells, f"{row['over_bound']:.2f}", f"{row['worst_locked_s']:.2f}"]) + " |")
    return "\n".join(lines)


def main(arguments: Arguments) -> None:
    """Replay and print."""
    rows = compare(arguments)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
