"""What policies pay over the one that they began from: `python -m agents.gained --base FOLDER --policies FOLDER ...`.

Held-out stops on low adhesion, on vehicles that are drawn (`agents.drawn.world`) or nominal. Paid are the metres travelled and
the price of those slid, as in the base's training. The ratio to what the base pays is taken vehicle by vehicle; its interval is
over the vehicles, and below over the policies: several seeds of a training.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.drawn import DRAWS, Drawn, under, world
from agents.taught import paid
from agents.watch import LAWS
from wsp_env.evaluation.policy import Policy, load_policy
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import VEHICLES

#: Seed of the first set of stops; the others follow one by one. Nothing else is drawn by them.
DRAWN_BY = 8_105_001


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Measure what policies pay over the one that they began from."""

    base: Path  # policy folder that they began from
    policies: tuple[Path, ...]  # folders
    world: Literal["nominal", "drawn brakes", "noise", "worn", "all"] = "all"
    sets: int = 4  # of stops, each on vehicles of its own
    stops: int = 48  # of a set, under each law
    drawn_by: int = DRAWN_BY  # seed of the first set; the others follow one by one
    json: bool = False  # print JSON


def braked(policy: Policy, given: Arguments, law: str, price: float) -> dict[str, np.ndarray]:
    """Return what a policy paid, travelled and slid [m], air [Nl], longest lock [s] and stops that ran on of each vehicle (V,).

    Of a stop that runs on, what it paid until its time was over counts: too little.
    """
    believed, rows = VEHICLES[policy.contract.vehicle], list[list[float]]()
    for number in range(given.sets):
        parts = world(given.world, under(believed, law), law, given.stops, given.drawn_by + number)
        yardstick = Drawn(believed, parts)
        found, blocks = yardstick.figures(policy), yardstick.blocks
        found["slid_m"] = found["mean_slip_mps"] * found["duration_s"]
        found["paid_m"] = paid(found, price)
        names = ("paid_m", "distance_m", "slid_m", "air_nl")
        for vehicle in np.unique(blocks):
            own = {name: values[blocks == vehicle] for name, values in found.items()}
            ends = [float(own["locked_s"].max()), float(np.sum(~own["stopped"]))]
            rows.append([float(own[name].mean()) for name in names] + ends)
    return dict(zip(("paid", "travelled", "slid", "air", "locked_s", "ran_on"), np.array(rows).T, strict=True))


def compare(given: Arguments) -> list[dict[str, Any]]:
    """Return a row for each policy and law, and for both laws together."""
    base, *policies = (_load(folder) for folder in (given.base, *given.policies))
    for folder, policy in zip(given.policies, policies, strict=True):
        if policy.contract.vehicle != base.contract.vehicle:
            raise SystemExit(f"{folder} is for a {policy.contract.vehicle}, the base for a {base.contract.vehicle}")
    if given.stops < DRAWS or given.sets < 1:
        raise SystemExit(f"--stops {given.stops} --sets {given.sets} is impossible: at least {DRAWS} stops in 1 set")
    price = float(base.contract.training["arguments"]["slide_price"])
    before, rows = {law: braked(base, given, law, price) for law in LAWS}, list[dict[str, Any]]()
    for folder, policy in zip(given.policies, policies, strict=True):
        after = {law: braked(policy, given, law, price) for law in LAWS}
        ratios = {
            law: {name: after[law][name] / before[law][name] for name in ("paid", "travelled", "slid", "air")} for law in LAWS
        }
        both = {name: np.mean([ratios[law][name] for law in LAWS], axis=0) for name in ratios[LAWS[0]]}
        for law, own in {"both": both, **ratios}.items():
            mean, half = interval(own["paid"])
            some = [after[one] for one in (LAWS if law == "both" else [law])]
            means = {name: float(own[name].mean()) for name in ("travelled", "slid", "air")}
            ends = {
                "locked_s": max(float(one["locked_s"].max()) for one in some),
                "ran_on": int(sum(one["ran_on"].sum() for one in some)),
            }
            rows.append({"policy": str(folder), "law": law, "paid": mean, "half": half} | means | ends)
    return rows


def _load(folder: Path) -> Policy:
    try:
        policy = load_policy(folder)
    except ParameterError as error:
        raise SystemExit(str(error)) from None
    if "slide_price" not in policy.contract.training.get("arguments", {}):
        raise SystemExit(f"{folder} does not tell its price of sliding: it was not written by agents.train")
    return policy


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as tables in Markdown: each policy, and the mean of all if there are several."""
    lines = [
        "| policy | law | paid / base | travelled / base | slid / base | air / base | longest lock [s] | stops that run on |",
        "|:--|:--|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        figures = f"{row['travelled']:.3f} | {row['slid']:.2f} | {row['air']:.2f} | {row['locked_s']:.2f} | {row['ran_on']}"
        lines.append(f"| {row['policy']} | {row['law']} | {row['paid']:.4f} ± {row['half']:.4f} | {figures} |")
    if len({row["policy"] for row in rows}) > 1:
        lines += ["", "| policies | law | paid / base, ± over the policies | least to greatest |", "|--:|:--|--:|--:|"]
        for law in dict.fromkeys(row["law"] for row in rows):
            own = np.array([row["paid"] for row in rows if row["law"] == law])
            mean, half = interval(own)
            lines.append(f"| {len(own)} | {law} | {mean:.4f} ± {half:.4f} | {own.min():.4f} to {own.max():.4f} |")
    return "\n".join(lines)


def main(given: Arguments) -> None:
    """Compare and print."""
    rows = compare(given)
    print(json.dumps(rows, indent=1) if given.json else table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
