"""Adhesion along a train of ten coaches: how far the wheels of the first coaches clean the rail for the last.

    python -m experiments.train_conditioning [--stops 8] [--out docs/train.png]

The train brakes with the rule-based WSP on every wheelset, on a rail of uniform friction, for some sizes of the mechanism
`leading_axle_cleaning`, none among them. Printed is a table by coach, drawn are the axles. The size of the cleaning has no
source: what is shown is how the result depends on it, not how large it is on a railway.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.runner import Conduct, StopRecords, run
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import train
from wsp_env.parameters.vehicle_figures import asked_adhesion
from wsp_env.parameters.velim import TAU_M_PER_J, TEST_SPEEDS_MPS
from wsp_env.scenario import Scenario, draw

COACHES = 10

#: Sizes of the cleaning [m/J]: none, a quarter of the mechanism's typical value, that value, four times as much.
REMOVALS = (0.0, 0.5e-5, 2e-5, 8e-5)

#: Extremely low adhesion, the recovery rate and the first speed of the seed paper, full brake, an empty train.
CONDITIONS = {
    "mu_cd": 0.03, "tau": TAU_M_PER_J, "initial_speed": TEST_SPEEDS_MPS["A1"], "demand": 1.0, "load": 0.0, "gradient": 0.0,
    "track": "constant",
}  # fmt: skip

#: The means are taken once the brake is full, while the train runs faster than this [m/s]; below it slides are short.
SLOWEST_MPS = 8.0

_COLOURS = ("#000000", "#56B4E9", "#0072B2", "#D55E00")


def brake(removal: float, stops: int) -> StopRecords:
    """Brake that many stops, which differ in the noise of their sensors, with one size of the cleaning [m/J]."""
    vehicle = train(COACH, COACHES)
    drawn = [draw(Scenario(), vehicle, np.random.default_rng(seed), 1, CONDITIONS) for seed in range(stops)]
    mechanisms = {"leading_axle_cleaning": {"removal_m_per_j": removal}}
    return run(RuleBasedWSP(), vehicle, drawn, Conduct(mechanisms=mechanisms))


def means(result: StopRecords) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean used adhesion [-] and slip speed [m/s] of every axle (A,), over all stops."""
    counted = (result.speed > SLOWEST_MPS) & (result.time > COACH.brake.demand_rise_s)[:, None]
    return result.adhesion[counted].mean(axis=0), result.slip[counted].mean(axis=0)


def table(found: dict[float, tuple[np.ndarray, np.ndarray]]) -> str:
    """Return mean used adhesion and slip by coach as a table in Markdown."""
    heads = [f"adhesion, {_size(removal)} | slip" for removal in found]
    lines = ["| coach | " + " | ".join(heads) + " |", "|---" * (1 + 2 * len(found)) + "|"]
    for coach in range(COACHES):
        own = slice(coach * COACH.axles, (coach + 1) * COACH.axles)
        cells = [f"{adhesion[own].mean():.3f} | {slip[own].mean():.2f}" for adhesion, slip in found.values()]
        lines.append(f"| {coach + 1} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def picture(found: dict[float, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Draw mean used adhesion and slip of every axle, coach by coach."""
    figure = Figure(figsize=(9, 6), dpi=110, layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    axles = np.arange(1, COACHES * COACH.axles + 1)
    for colour, (removal, (adhesion, slip)) in zip(_COLOURS, found.items(), strict=True):
        for axis, values in ((top, adhesion), (bottom, slip)):
            axis.plot(axles, values, "o-", color=colour, markersize=3.5, linewidth=1.2, label=f"cleaning {_size(removal)}")
    for axis in (top, bottom):
        for coach in range(0, COACHES, 2):
            axis.axvspan(coach * COACH.axles + 0.5, (coach + 1) * COACH.axles + 0.5, color="0.93", zorder=0)
        axis.grid(alpha=0.3)
        axis.set_ylim(bottom=0.0)
    asked = asked_adhesion(COACH, COACH.mass_kg)
    top.axhline(asked, color="0.4", linestyle="--", linewidth=1.0, label="what full brake asks for")
    top.set_ylabel("mean used adhesion coefficient [-]")
    bottom.set_ylabel("mean slip speed [m/s]")
    bottom.set_xlabel("axle from the front [-], coaches shaded in turn")
    bottom.set_xlim(0.5, len(axles) + 0.5)
    top.legend(fontsize=8, loc="lower left")
    return figure


def _size(removal: float) -> str:
    return f"{removal:.1e} m/J" if removal else "none"


def main() -> None:
    """Brake, print the table, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=8, help="stops for each size of the cleaning")
    parser.add_argument("--out", type=Path, default=Path("docs/train.png"), help="the picture")
    arguments = parser.parse_args()
    if arguments.stops < 1:
        parser.error("--stops must be at least 1")
    results = {removal: brake(removal, arguments.stops) for removal in REMOVALS}
    found = {removal: means(result) for removal, result in results.items()}
    print(table(found))
    for removal, result in results.items():
        locked = (result.speed[..., None] - result.slip < 0.3) & (result.speed > SLOWEST_MPS)[..., None]
        print(
            f"cleaning {_size(removal)}: {result.distance.mean():.0f} m, locked {0.02 * locked.sum() / arguments.stops:.1f} s"
        )
    picture(found).savefig(arguments.out)
    print(arguments.out)


if __name__ == "__main__":
    main()
