"""A policy under the conditions of recorded stops: `python -m agents.replayed CAMPAIGN ...`, folders with campaign.toml.

The law is tuned on each campaign, every stop gets its initial speed, demand, load, mu_cd and tau, as `wsp replay` does. Prints
the figures of the card: means over the stops of each campaign, over those of the rules with their own best thresholds.
"""

import dataclasses
import json
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from agents.measure import Yardstick
from agents.rules import best_at
from agents.seeds import REPORTED
from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.replay import braked
from wsp_env.evaluation.summary import interval
from wsp_env.recordings import CampaignWarning, conditions, read_campaign, tune


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is replayed."""

    campaigns: Annotated[tuple[Path, ...], tyro.conf.Positional]
    vehicle: Literal["wheelset", "bogie", "coach"] = "coach"
    folder: Path = Path()  # of the policy; none: agents/trained/VEHICLE
    price: str = "3"  # of sliding: the rules' own best thresholds for it are compared with
    json: bool = False


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each campaign and one for all: mean ratios to the rules, of the distance with its 95 % interval."""
    shipped = Path("agents/trained") / arguments.vehicle
    policy = load_policy(arguments.folder if arguments.folder.name else shipped)
    rules = RuleBasedWSP(best_at(shipped, arguments.price))
    rows: list[dict[str, Any]] = []
    found: dict[str, list[dict[str, np.ndarray]]] = {"policy": [], "rules": []}
    bounds: list[np.ndarray] = []
    for folder in arguments.campaigns:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CampaignWarning)  # `wsp validate` tells of them
            campaign = read_campaign(folder)
        vehicle, stops, _ = braked(campaign, conditions(campaign, tune(campaign)))
        yardstick = Yardstick(vehicle, stops)
        for name, controller in (("policy", policy), ("rules", rules)):
            found[name].append(yardstick.figures(controller))
        bounds.append(yardstick.top.shortest()[0])
        rows.append(_row(campaign.name, found["policy"][-1], found["rules"][-1], bounds[-1]))
    if len(rows) > 1:
        joined = {name: {key: np.concatenate([one[key] for one in each]) for key in each[0]} for name, each in found.items()}
        rows.append(_row("all", joined["policy"], joined["rules"], np.concatenate(bounds)))
    return rows


def _row(name: str, own: dict[str, np.ndarray], rules: dict[str, np.ndarray], bound: np.ndarray) -> dict[str, Any]:
    ratio, half = interval(own["distance_m"] / rules["distance_m"])
    row: dict[str, Any] = {"campaign": name, "stops": len(bound), "ratio": ratio, "ratio_ci": half}
    row |= {figure: float(own[figure].mean() / rules[figure].mean()) for figure in REPORTED[1:]}
    row |= {"locked_s": float(own["locked_s"].max()), "stopped": bool(own["stopped"].all())}
    return row | {"over_bound": float(own["distance_m"].mean() / bound.mean())}


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| campaign | stops | distance / rules | slip / rules | standard deviation of slip / rules | energy / rules "
        "| locked [s] | distance / bound |",
        "|:--|" + "--:|" * 7,
    ]
    for row in rows:
        cells = [
            str(row["stops"]),
            f"{row['ratio']:.3f} ± {row['ratio_ci']:.3f}" + ("" if row["stopped"] else " (some ran on)"),
        ]
        cells += [f"{row[figure]:.2f}" for figure in REPORTED[1:]] + [f"{row['locked_s']:.1f}", f"{row['over_bound']:.2f}"]
        lines.append(f"| {row['campaign']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Arguments) -> None:
    """Replay and print."""
    rows = compare(arguments)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
