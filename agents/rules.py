"""The rule-based WSP with its own best thresholds, searched with as many simulated stops as a policy was trained with.

`python -m agents.rules --vehicle bogie` writes `agents/trained/bogie/rules.json`: thresholds for the same objective as the
policy's, metres travelled plus the price of the metres slid.
"""

import dataclasses
import json
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.progress import track
from scipy.stats import qmc

from agents.measure import Yardstick
from baselines.rule_based import RuleBasedParameters, RuleBasedWSP

#: Threshold -> range of the search, around the defaults of the rules.
RANGES = {
    "slip_base_mps": (0.05, 1.0),
    "slip_per_speed": (0.01, 0.2),
    "slip_large_factor": (1.2, 4.0),
    "slip_release_factor": (0.02, 0.8),
    "deceleration_mps2": (1.0, 8.0),
    "deceleration_large_mps2": (2.0, 12.0),
    "recovered_mps2": (-1.0, 2.0),
    "reaccelerated_mps2": (1.0, 8.0),
    "pulse_on_s": (0.02, 0.2),
    "pulse_off_s": (0.0, 0.5),
    "pulsing_s": (0.0, 4.0),
}

#: Seed of the stops of the search; others than those watched or held out.
SEARCHED = 3_000_017


@dataclasses.dataclass(frozen=True)
class Search:
    """What a search is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    stops: int = 2000  # simulated in all: about what a training brakes in 4 million decisions
    each: int = 12  # of them for each trial, alternately under both laws with the share of the training
    slide_price: float = 2.0  # as of the training
    seed: int = 1
    out: Path = Path("agents/trained/bogie")


def search(arguments: Search) -> dict[str, float]:
    """Return the best thresholds: half of the trials spread over all ranges, the others around the best so far."""
    laws = {"recovering": arguments.each * 3 // 4, "classic": arguments.each - arguments.each * 3 // 4}
    yardsticks = [Yardstick(arguments.vehicle, law, count, SEARCHED) for law, count in laws.items()]
    low, high = (np.array(ends) for ends in zip(*RANGES.values(), strict=True))
    trials = max(2, arguments.stops // arguments.each)
    spread = qmc.LatinHypercube(len(RANGES), rng=arguments.seed).random(trials // 2)
    rng = np.random.default_rng(arguments.seed)
    defaults = RuleBasedParameters()
    best = (np.array([getattr(defaults, name) for name in RANGES]) - low) / (high - low)
    least = cost(yardsticks, RuleBasedParameters(), arguments.slide_price)
    for trial in track(range(1, trials), description="rules"):
        if trial < len(spread):
            point = spread[trial]
        else:
            width = 0.2 * (1.0 - trial / trials) + 0.02
            changed = rng.uniform(size=len(best)) < 0.4
            point = np.clip(best + changed * rng.normal(0.0, width, len(best)), 0.0, 1.0)
        values = {name: float(value) for name, value in zip(RANGES, low + point * (high - low), strict=True)}
        reached = cost(yardsticks, dataclasses.replace(defaults, **values), arguments.slide_price)
        if reached < least:
            least, best = reached, point
    return {name: round(float(value), 4) for name, value in zip(RANGES, low + best * (high - low), strict=True)}


def cost(yardsticks: list[Yardstick], parameters: RuleBasedParameters, slide_price: float) -> float:
    """Return the mean over the stops of metres travelled, plus the price of metres slid and of a locked wheel (10 m/s)."""
    total, count = 0.0, 0
    for yardstick in yardsticks:
        found = yardstick.figures(RuleBasedWSP(parameters))
        slid = found["mean_slip_mps"] * found["duration_s"]
        total += float(np.sum(found["distance_m"] + slide_price * slid + 10.0 * found["locked_s"]))
        count += len(found["distance_m"])
    return total / count


def main(arguments: Search) -> None:
    """Search and write."""
    values = search(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    searched = {"stops": arguments.stops, "slide_price": arguments.slide_price, "seed": arguments.seed, "parameters": values}
    (arguments.out / "rules.json").write_text(json.dumps(searched, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(values))


if __name__ == "__main__":
    main(tyro.cli(Search))
