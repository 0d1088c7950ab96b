"""Controllers by rules with their own best settings, searched with as many simulated stops as a policy was trained with.

`python -m agents.rules --vehicle bogie` writes `agents/trained/bogie/rules.json`: for each price of sliding the thresholds that
make metres travelled plus the price of the metres slid least. The prices trace the front of what these rules can do.
With `--controller adaptive` the same for the adaptive controller, in `adaptive.json`.
For the command line: `wsp evaluate --controllers rule-based --set $(python -m agents.rules --show 2)`.
"""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
import tyro
from rich.progress import track

from agents.measure import Yardstick, mixed
from baselines.adaptive import AdaptiveController, AdaptiveParameters
from baselines.rule_based import RuleBasedParameters, RuleBasedWSP
from wsp_env.evaluation.controller import Controller

#: Threshold -> range of the search, around the defaults of the rules.
RANGES = {
    "slip_base_mps": (0.05, 1.0),
    "slip_per_speed": (0.005, 0.2),
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

#: The same of the adaptive controller.
ADAPTIVE_RANGES = {
    "slide_price": (0.3, 8.0),
    "settling_s": (0.08, 0.6),
    "dead_band": (0.0, 0.3),
    "reached_share": (0.0, 0.9),
    "smallest_slip_mps": (0.03, 0.4),
}


class Searched(NamedTuple):
    """A controller whose settings are searched."""

    controller: Any  # its class
    parameters: Any  # the class of its settings
    ranges: dict[str, tuple[float, float]]
    file: str


KINDS = {
    "rule-based": Searched(RuleBasedWSP, RuleBasedParameters, RANGES, "rules.json"),
    "adaptive": Searched(AdaptiveController, AdaptiveParameters, ADAPTIVE_RANGES, "adaptive.json"),
}

#: Seed of the stops of the search; others than those watched or held out.
SEARCHED = 3_000_017

#: Metres that a second of a locked wheel counts [m/s]: no locked wheel is worth its while (assumption).
LOCKED_PRICE_MPS = 10.0


@dataclasses.dataclass(frozen=True)
class RuleSearch:
    """What a search is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    controller: Literal["rule-based", "adaptive"] = "rule-based"
    stops: int = 3072  # simulated for each price: as many as a training brakes in 5 million decisions
    each: int = 12  # of them for each trial
    trials: int = 16  # of a generation
    elite: int = 5  # of them that the next generation is drawn around
    classic_share: float = 0.25  # of the stops under the classic law, as in the training
    air_price: float = 0.0  # metres travelled that a normal litre of air of one axle is worth
    slide_prices: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0)  # metres travelled that a metre of sliding is worth
    seed: int = 1
    out: Path = Path("agents/trained")
    show: str = ""  # price whose thresholds found before are printed as settings; nothing is searched then


class Trials:
    """Many sets of thresholds braking the same stops at once."""

    def __init__(self, arguments: RuleSearch) -> None:
        self.trials, self.kind, self.air_price = arguments.trials, KINDS[arguments.controller], arguments.air_price
        stops = mixed(arguments.vehicle, arguments.each, arguments.classic_share, SEARCHED)
        self.yardstick = Yardstick(arguments.vehicle, stops * arguments.trials)
        self.low, self.high = (np.array(ends) for ends in zip(*self.kind.ranges.values(), strict=True))

    def values(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Return the thresholds, each (P,), of points (P, thresholds) in the unit cube."""
        scaled = self.low + points * (self.high - self.low)
        return dict(zip(self.kind.ranges, scaled.T, strict=True))

    def cost(self, points: np.ndarray, slide_price: float) -> np.ndarray:
        """Return metres travelled and priced ones, mean over the stops, for each point: (P,) with P = trials."""
        each = len(self.yardstick.stops) // self.trials
        columns = {name: np.repeat(value, each)[:, None] for name, value in self.values(points).items()}
        found = self.yardstick.figures(self.kind.controller(_rows(self.kind, columns)))
        slid = found["mean_slip_mps"] * found["duration_s"]
        paid = found["distance_m"] + slide_price * slid + LOCKED_PRICE_MPS * found["locked_s"]
        paid = paid + self.air_price * found["air_nl"] / self.yardstick.vehicle.axles
        means: np.ndarray = paid.reshape(self.trials, each).mean(axis=1)
        return means


def _rows(kind: Searched, columns: dict[str, np.ndarray]) -> Any:
    """Return what a controller takes for its parameters: one row (N, 1) of settings for each stop."""
    return SimpleNamespace(**dataclasses.asdict(kind.parameters()) | columns)


def search(trials: Trials, arguments: RuleSearch, slide_price: float) -> dict[str, float]:
    """Return the best thresholds for a price, by the cross-entropy method: each generation is drawn around the last's best.

    The first generation spreads over the whole cube; the default thresholds are among it.
    """
    rng = np.random.default_rng(arguments.seed)
    defaults, names = trials.kind.parameters(), list(trials.kind.ranges)
    start = (np.array([getattr(defaults, name) for name in names]) - trials.low) / (trials.high - trials.low)
    points = rng.uniform(size=(arguments.trials, len(names)))
    points[0] = start
    mean, deviation, best, least = start, np.full(len(names), 0.3), start, np.inf
    generations = max(2, arguments.stops // (arguments.each * arguments.trials))
    for generation in track(range(generations), description=f"price {slide_price:g}"):
        if generation > 0:
            points = np.clip(rng.normal(mean, deviation, (arguments.trials, len(names))), 0.0, 1.0)
            points[0] = best
        reached = trials.cost(points, slide_price)
        order = np.argsort(reached)
        if reached[order[0]] < least:
            least, best = reached[order[0]], points[order[0]]
        elite = points[order[: arguments.elite]]
        mean = 0.3 * mean + 0.7 * elite.mean(axis=0)
        deviation = 0.3 * deviation + 0.7 * elite.std(axis=0) + 0.02
    values = trials.values(best[None])
    return {name: round(float(value[0]), 4) for name, value in values.items()}


def best_at(folder: Path, price: str) -> RuleBasedParameters:
    """Return the thresholds found before for a price; `SystemExit` names the prices where there are none for it."""
    best = read_best(folder)
    if price not in best:
        raise SystemExit(
            f"{folder / 'rules.json'} holds no price {price}; valid: {', '.join(best) or 'none'}: see agents.rules"
        )
    return best[price]


def read_best(folder: Path) -> dict[str, RuleBasedParameters]:
    """Return the thresholds found before, by price; none where no search was written."""
    return {price: RuleBasedParameters(**settings) for price, settings in _found(folder / "rules.json").items()}


def front(folder: Path, controller: str = "rule-based") -> dict[str, Controller]:
    """Return the controllers with the settings found before, by price; none where no search was written."""
    kind = KINDS[controller]
    found = _found(folder / kind.file)
    return {price: kind.controller(kind.parameters(**settings)) for price, settings in found.items()}


def _found(path: Path) -> dict[str, dict[str, float]]:
    """Return the settings of a file by price; none where there is no file."""
    return json.loads(path.read_text(encoding="utf-8"))["thresholds"] if path.exists() else {}


def show(folder: Path, price: str) -> str:
    """Return the thresholds of a price as settings for `wsp evaluate --set`."""
    best = best_at(folder, price)
    return " ".join(f"rule-based.{name}={getattr(best, name):g}" for name in RANGES)


def main(arguments: RuleSearch) -> None:
    """Search and write, or show."""
    folder = arguments.out / arguments.vehicle
    if arguments.show:
        print(show(folder, arguments.show))
        return
    folder.mkdir(parents=True, exist_ok=True)
    left_out = ("out", "slide_prices", "show")
    own, usual = (
        {name: value for name, value in dataclasses.asdict(one).items() if name not in left_out}
        for one in (arguments, RuleSearch(controller=arguments.controller))
    )
    file = folder / KINDS[arguments.controller].file
    found: dict[str, dict[str, float]] = {}
    trials: Trials | None = None
    # What a search of before does not name had its default.
    if file.exists() and usual | (before := json.loads(file.read_text(encoding="utf-8")))["search"] == own:
        found = before["thresholds"]  # an interrupted search goes on
    for price in arguments.slide_prices:
        if f"{price:g}" not in found:
            trials = trials or Trials(arguments)
            found[f"{price:g}"] = search(trials, arguments, price)
            file.write_text(json.dumps({"search": own, "thresholds": found}, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found))


if __name__ == "__main__":
    main(tyro.cli(RuleSearch))
