"""Measures a policy folder on held-out stops and writes its model card: `python -m agents.card --vehicle bogie`."""

import csv
import dataclasses
import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents import settings
from agents.drawn import GRADIENT, NOISE
from agents.improve import Improvement
from agents.measure import COMPARED, HELD_OUT, INITIAL_ADHESION, INITIAL_SPEED_MPS, RECOVERY_M_PER_J, Yardstick
from agents.rules import read_best
from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.figures import FIGURES
from wsp_env.evaluation.policy import Contract, load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.uic_z1 import VEHICLES

#: Worlds in which a policy is measured: law and mechanisms. The mechanism at its usual size was not trained against.
WORLDS: dict[str, tuple[str, dict[str, dict[str, float]]]] = {
    "Recovering law": ("recovering", {}),
    "Classic law": ("classic", {}),
    "Recovering law, with `contaminant_memory` over 5 m": ("recovering", {"contaminant_memory": {"distance_m": 5.0}}),
}

#: Arguments of a training that its command need not name.
DEFAULTS, IMPROVED = settings.record(settings.Arguments()), settings.record(Improvement(Path()))

#: What the columns of the card are called.
_HEADINGS = (
    "distance [m]", "/ rules", "slip [m/s]", "standard deviation of slip [m/s]", "energy [MJ]", "creepage", "beyond limit [s]",
    "locked [s]", "air [Nl]", "utilisation",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is measured."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    folder: Path = Path()  # of the policy; none: agents/trained/VEHICLE
    stops: int = 40  # held-out ones under each law
    seed: int = HELD_OUT


def competitors(folder: Path) -> dict[str, Controller]:
    """Return whom the policy is compared with, by name; the rules first."""
    found: dict[str, Controller] = {"rule-based": load("rule-based")}
    for price, thresholds in read_best(folder).items():
        found[f"rules, best at price {price}"] = RuleBasedWSP(thresholds)
    found |= {"slip controller": load("slip"), "extremum seeker": load("extremum"), "no WSP": load("none")}
    return found | {"policy": load_policy(folder)}


def measure(controllers: Mapping[str, Controller], yardstick: Yardstick) -> list[dict[str, Any]]:
    """Return a row of means per controller, with the paired ratio of its distance to that of the rules and its interval."""
    rows = []
    rules: np.ndarray | None = None
    for name, controller in controllers.items():
        found = yardstick.figures(controller)
        row: dict[str, Any] = {"controller": name} | {figure: float(np.mean(found[figure])) for figure in COMPARED}
        rules = found["distance_m"] if rules is None else rules
        row["ratio"], row["ratio_ci"] = interval(found["distance_m"] / rules)
        row["stopped"] = bool(found["stopped"].all())
        rows.append(row)
    bound = yardstick.top.shortest()[0]
    assert rules is not None
    ratio, half = interval(bound / rules)
    return [
        *rows,
        {"controller": "bound", "distance_m": float(bound.mean()), "ratio": ratio, "ratio_ci": half, "stopped": True},
    ]


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = ["| controller | " + " | ".join(_HEADINGS) + " |", "|:--|" + "--:|" * len(_HEADINGS)]
    for row in rows:
        mark = "" if row["stopped"] else " (some ran on)"
        cells = [f"{row['distance_m']:.0f}{mark}", f"{row['ratio']:.3f} ± {row['ratio_ci']:.3f}"]
        digits = dict(zip(COMPARED[1:], (2, 2, 3, 2, 1, 1, 0, 3), strict=True))
        cells += [f"{row[figure]:.{places}f}" if figure in row else "" for figure, places in digits.items()]
        lines.append(f"| {row['controller']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw_curve(folder: Path) -> None:
    """Draw curve.csv to curve.png: the policy's figures over those of the rules as it learned, first from the teacher."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with (folder / "curve.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    decisions = [float(row["decisions"]) / 1e6 for row in rows]
    taught = [own for own, row in zip(decisions, rows, strict=True) if float(row["ppo_decisions"]) == 0.0]
    figure, axes = pyplot.subplots(1, 2, figsize=(9.0, 3.4), sharey=True)
    names = {"distance_m": "stopping distance", "mean_slip_mps": "mean slip", "contact_energy_mj": "contact energy"}
    for axis, law in zip(axes, ("recovering", "classic"), strict=True):
        for name, label in names.items():
            axis.plot(decisions, [float(row[f"{law}_{name}_ratio"]) for row in rows], marker=".", label=label)
        axis.axhline(1.0, color="grey", linewidth=0.8)
        if taught:
            axis.axvline(taught[-1], color="grey", linestyle=":", label="PPO begins")
        axis.set(title=f"{law} law", xlabel="million decisions", ylim=(0.4, 1.4))
    axes[0].set_ylabel("policy / rule-based WSP")
    axes[0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(folder / "curve.png", dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def _command(training: Mapping[str, Any]) -> str:
    """Return the commands of a training: of the imitation, and of what improved on it."""
    arguments, improved = training["arguments"], training.get("improved")
    found = f"`python -m agents.train --vehicle {arguments['vehicle']}{_options(arguments, DEFAULTS, 'vehicle')}`"
    if improved:
        found += f", then `python -m agents.improve --base FOLDER{_options(improved, IMPROVED, 'base')}`"
    return found


def _options(given: Mapping[str, Any], defaults: Mapping[str, Any], named: str) -> str:
    """Return the seed and all that is not as by default; `named` is named already."""
    own = {name: value for name, value in given.items() if name == "seed" or (value != defaults[name] and name != named)}
    return "".join(
        f" --{name.replace('_', '-')} " + (shlex.join(map(str, value)) if isinstance(value, list) else shlex.quote(str(value)))
        for name, value in own.items()
    )


def card(contract: Contract, sections: Mapping[str, str], stops: int) -> str:
    """Return the text of the model card."""
    arguments = contract.training["arguments"]
    units = "; ".join(f"{name}: {FIGURES[name][1]} [{FIGURES[name][0]}]" for name in COMPARED)
    drawn = {name: value for name, value in contract.limits.items() if name not in ("mechanisms", "full_brake_adhesion")}
    ranges = ", ".join(f"{name} {value}" for name, value in drawn.items())
    if contract.limits["mechanisms"]:
        ranges += f", mechanisms {json.dumps(contract.limits['mechanisms'])}"
    if arguments.get("world", "nominal") != "nominal":
        ranges += f"; brakes, gain and wear of one axle and sensor noise to {NOISE:g} rad/s drawn (`agents/varied.py`)"
    if arguments.get("world") == "line":
        ranges += f", gradient to {1000 * GRADIENT[1]:g} per mille, drag and fading pads, too"
    earlier = contract.training.get("observer", "")
    by_teacher = contract.training["decisions"] - contract.training["ppo_decisions"]
    learned = f"{by_teacher:,} decisions of imitation and {contract.training['ppo_decisions']:,} of PPO".replace(",", " ")
    brake, own = arguments["torque_per_bar_nm"], VEHICLES[contract.vehicle].brake.torque_per_bar_nm
    parts = [
        f"# Wheel slide protection, {contract.vehicle}, learned\n\n"
        f"A policy trained by imitation and PPO in wsp-env {contract.wsp_env}; `policy.onnx` holds normalisation, "
        "network and choice of the command, `contract.json` says what goes in and comes out. Run it with "
        f"`wsp evaluate --controllers rule-based agents/trained/{contract.vehicle} --vehicle {contract.vehicle}`.\n\n"
        f"For {contract.axles} axle(s), a decision every {contract.control_interval_s:g} s, "
        f"{'with' if contract.pressure_sensors else 'without'} cylinder-pressure sensors. For research; nobody has assessed it "
        "for use on a railway.",
        f"## Training\n\n{_command(contract.training)}: what had the best score on the watched stops after the imitation, at "
        f"{learned}; arguments and versions in `contract.json`.{earlier and f' It learned with {earlier}.'}\n\n"
        f"![curve](curve.png)\n\nConditions it was trained for: {ranges}, brakes of {brake:g} N m a bar (the vehicle's own: "
        f"{own:g}). Outside of them it was not trained.",
        f"## Measured\n\nMeans over {stops} held-out stops (seed {HELD_OUT}) on contaminated rail with an initial adhesion of "
        f"{INITIAL_ADHESION[0]} to {INITIAL_ADHESION[1]}, {INITIAL_SPEED_MPS[0]} to {INITIAL_SPEED_MPS[1]} m/s, any load, "
        f'full demand, tau {RECOVERY_M_PER_J[0]:g} to {RECOVERY_M_PER_J[1]:g} m/J; "/ rules" is the mean ratio to the '
        "rule-based WSP stop by stop, with its 95 % confidence interval over the stops. The bound keeps within the slide limit "
        "and knows no mechanisms.",
    ]
    parts += [f"### {title}\n\n{text}" for title, text in sections.items()]
    return "\n\n".join([*parts, f"Figures: {units}.", "Written by `python -m agents.card`."]) + "\n"


def main(arguments: Arguments) -> None:
    """Measure and write README.md, figures.json and curve.png into the folder."""
    folder = arguments.folder if arguments.folder.name else Path("agents/trained") / arguments.vehicle
    controllers = competitors(folder)
    sections, figures = {}, {}
    for title, (law, mechanisms) in WORLDS.items():
        conduct = Conduct(mechanisms=mechanisms)
        rows = measure(controllers, Yardstick.drawn(arguments.vehicle, law, arguments.stops, arguments.seed, conduct))
        sections[title], figures[title] = table(rows), rows
        print(title, sections[title], sep="\n", flush=True)
    (folder / "figures.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    (folder / "README.md").write_text(card(load_policy(folder).contract, sections, arguments.stops), encoding="utf-8")
    if (folder / "curve.csv").exists():
        draw_curve(folder)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
