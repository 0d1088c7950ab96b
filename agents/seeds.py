"""The same training with several seeds: `python -m agents.seeds --runs out/agents/bogie-1 out/agents/bogie-2 ...`.

Prints, for the held-out stops of each world of the card, the policies' mean figures over those of the rules with their own best
thresholds, and over those that the rules' front has at the policy's own slip, with 95 % confidence intervals over the seeds;
and the watched score by which a seed is chosen to be shipped.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.card import WORLDS
from agents.measure import HELD_OUT, Yardstick
from agents.rules import read_best
from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.summary import interval

#: What stands in place of the rules' price where their front is taken at the policy's own slip.
SAME_SLIP = "same slip"

#: Figures that are reported, as ratios to the rules'.
REPORTED = ("distance_m", "mean_slip_mps", "slip_deviation_mps", "contact_energy_mj")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is compared."""

    runs: tuple[Path, ...]  # folders of trainings
    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    prices: tuple[str, ...] = ("2", "3")  # of sliding, of the rules' own best thresholds
    stops: int = 160  # in each world
    drawn_by: int = HELD_OUT  # their seed
    json: bool = False


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each world and price, and one at the same slip: mean ratios over the seeds and their intervals."""
    rows = []
    policies = [load_policy(run / "policy") for run in arguments.runs]
    best = read_best(Path("agents/trained") / arguments.vehicle)
    for world, (law, mechanisms) in WORLDS.items():
        yardstick = Yardstick.drawn(arguments.vehicle, law, arguments.stops, arguments.drawn_by, Conduct(mechanisms=mechanisms))
        own = [yardstick.means(policy) for policy in policies]
        rules = {price: yardstick.means(RuleBasedWSP(thresholds)) for price, thresholds in best.items()}
        alike = [at_slip(list(rules.values()), means["mean_slip_mps"]) for means in own]
        bound = float(yardstick.top.shortest()[0].mean())
        locked, short = max(means["locked_s"] for means in own), np.mean([means["distance_m"] for means in own]) / bound
        for price in (*arguments.prices, SAME_SLIP):
            row: dict[str, Any] = {"world": world, "price": price, "locked_s": locked, "over_bound": float(short)}
            for name in REPORTED:
                others = alike if price == SAME_SLIP else [rules[price]] * len(own)
                ratios = np.array([means[name] / other[name] for means, other in zip(own, others, strict=True)])
                row[name], row[f"{name}_ci"] = interval(ratios)
                row[f"{name}_seeds"] = ratios.tolist()
            rows.append(row)
    return rows


def at_slip(front: Sequence[Mapping[str, float]], slip: float) -> dict[str, float]:
    """Return the figures of a front of controllers at a mean slip [m/s], linear between its neighbours, its end beyond it."""
    ordered = sorted(front, key=lambda means: means["mean_slip_mps"])
    slips = [means["mean_slip_mps"] for means in ordered]
    return {name: float(np.interp(slip, slips, [means[name] for means in ordered])) for name in REPORTED}


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| world | rules' price | distance | slip | standard deviation of slip | energy | locked [s] | distance / bound |",
        "|:--|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        digits = dict(zip(REPORTED, (3, 2, 2, 2), strict=True))
        cells = [f"{row[name]:.{places}f} ± {row[f'{name}_ci']:.{places}f}" for name, places in digits.items()]
        lines.append(
            f"| {row['world']} | {row['price']} | "
            + " | ".join(cells)
            + f" | {row['locked_s']:.1f} | {row['over_bound']:.2f} |"
        )
    return "\n".join(lines)


def main(arguments: Arguments) -> None:
    """Compare and print."""
    scores = {str(run): load_policy(run / "policy").contract.training["watched_score"] for run in arguments.runs}
    rows = compare(arguments)
    if arguments.json:
        print(json.dumps({"watched": scores, "rows": rows}, indent=1))
    else:
        print(table(rows))
        print("\nwatched score: " + ", ".join(f"{run} {score:.4f}" for run, score in scores.items()))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
