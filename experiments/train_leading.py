"""A static rule along a train: the leading axles slide more than is good for them, and clean the rail for all others.

    python -m experiments.train_leading [--stops 8]

The train, the rail and the sizes of the cleaning are those of `experiments.train_conditioning`. The adaptive controller
brakes, and holds the first axles at a creepage of their own (`leading_axles`, `leading_creepage`). Paid are metres travelled
and, at the controller's own price, metres slid.
"""

import argparse

import numpy as np

from baselines.adaptive import AdaptiveController, AdaptiveParameters
from experiments.train_conditioning import COACHES, CONDITIONS, REMOVALS
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import train
from wsp_env.scenario import Scenario, draw

#: Leading axles and their creepage [-]: none, one axle, the first bogie, coach and two coaches.
RULES = ((0, 0.0), (1, 0.1), (1, 0.2), (2, 0.1), (2, 0.2), (4, 0.1), (4, 0.2), (8, 0.1), (8, 0.2))


def rows(stops: int) -> list[list[str]]:
    """Return the cells of the table: a row for each rule, and for each size of the cleaning distance, price and energy."""
    vehicle = train(COACH, COACHES)
    drawn = [draw(Scenario(), vehicle, np.random.default_rng(seed), 1, CONDITIONS) for seed in range(stops)]
    top, found = ceiling(vehicle, drawn), list[list[str]]()
    for axles, creepage in RULES:
        own = AdaptiveParameters(leading_axles=float(axles), leading_creepage=creepage)
        cells = [f"{axles} at {creepage:g}" if axles else "none"]
        for removal in REMOVALS:
            conduct = Conduct(mechanisms={"leading_axle_cleaning": {"removal_m_per_j": removal}})
            result = run(AdaptiveController(own), vehicle, drawn, conduct)
            of_it = figures(result, top)
            paid = of_it["distance_m"] + own.slide_price * of_it["mean_slip_mps"] * result.duration
            energy, locked = of_it["contact_energy_mj"].mean(), of_it["locked_s"].max()
            cells.append(f"{of_it['distance_m'].mean():.0f}, {paid.mean():.0f}, {energy:.2f}" + (", locked" if locked else ""))
        found.append(cells)
    return found


def main() -> None:
    """Brake and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=8, help="stops for each rule and size of the cleaning")
    arguments = parser.parse_args()
    if arguments.stops < 1:
        parser.error("--stops must be at least 1")
    heads = [f"cleaning {removal:.1e} m/J" if removal else "no cleaning" for removal in REMOVALS]
    print("stop [m], paid [m], energy of the worst wheelset [MJ]\n")
    print("\n".join("| " + " | ".join(row) + " |" for row in (["leading axles", *heads], ["---"] * 5, *rows(arguments.stops))))


if __name__ == "__main__":
    main()
