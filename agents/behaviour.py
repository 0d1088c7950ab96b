"""What a policy does, from traces: `python -m agents.behaviour --vehicle bogie` prints and draws docs/agents_behaviour.png.

The same held-out stops on rails that sliding cleans not at all, slowly and fast. The slip that the policy keeps is put beside
the slip that is worth its price there, which nobody can know who does not know the rail (`agents.teacher`).

With `--failures` it draws docs/agents_failures.png instead: where the policy fails (`FAILURES`, of `agents.study`), beside the
rules with their own best thresholds.
"""

import dataclasses
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from agents.measure import HELD_OUT, low_adhesion
from agents.rules import best_at
from agents.study import worlds
from agents.teacher import Teacher
from baselines.rule_based import RuleBasedWSP
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.policy import Policy, load_policy
from wsp_env.evaluation.runner import Conduct, measure, start_plant
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.port import Stop

#: Recovery rates [m/J]: the classic law, and slow, usual and fast cleaning within the training's range.
RECOVERIES = (0.0, 1.2e-4, 2e-4, 3e-4)

#: Bands of running speed [m/s].
BANDS = ((30.0, 45.0), (20.0, 30.0), (10.0, 20.0))

#: Worlds of `agents.study` in which a policy fails: it stops late, or slides far more than the rules.
FAILURES = ("pad_friction", "aerodynamic_drag", "mu_cd 0.012, extremely low", "sensor noise 0.3 rad/s")

#: Braking begins to be full after so long [s]; a wheelset braked less than this share of full pressure is let roll.
_BEGINNING_S, _ROLLS = 4.0, 0.15

_CONDUCT = Conduct()


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is looked at."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    folder: Path = Path()  # of the policy; none: agents/trained/VEHICLE
    stops: int = 12  # held-out ones, on each rail
    drawn: int = 0  # number of the stop that is drawn, below that of the stops
    failures: bool = False  # draw where the policy fails; prints nothing
    price: str = "3"  # of sliding, of the rules beside the failures
    out: Path = Path()  # none: docs/agents_behaviour.png, docs/agents_failures.png
    json: bool = False


@dataclasses.dataclass(frozen=True)
class Traces:
    """N stops by the policy, T decisions each; those that stand are left out of nothing: look at the speed."""

    time: np.ndarray  # (T,) [s]
    speed: np.ndarray  # (T, N) [m/s]
    slip: np.ndarray  # (T, N, A) [m/s]
    worth: np.ndarray  # (T, N, A) the slip worth its price there [m/s]
    pressure: np.ndarray  # (T, N, A) share of full pressure


def trace(controller: Controller, vehicle: str, stops: list[Stop], slide_price: float, conduct: Conduct = _CONDUCT) -> Traces:
    """Let a controller brake and look at every decision."""
    kind = VEHICLES[vehicle]
    plant = start_plant(kind, stops, conduct)
    teacher = Teacher(plant, slide_price)
    controller.reset(plant.n, kind)
    kept: dict[str, list[np.ndarray]] = {"speed": [], "slip": [], "worth": [], "pressure": []}
    while plant.moving.any() and len(kept["speed"]) * conduct.control_interval_s < conduct.time_limit_s:
        now = plant.truth()
        seen = (now.speed, now.slip_speed, teacher.targets(), now.pressure / kind.brake.full_pressure_bar)
        for name, value in zip(kept, seen, strict=True):
            kept[name].append(np.array(value))
        plant.step(controller.act(measure(plant, pressure_sensors=True)))
    time = conduct.control_interval_s * np.arange(len(kept["speed"]))
    return Traces(time, *(np.array(values) for values in kept.values()))


def summary(traces: Traces) -> dict[str, float]:
    """Return median slip and slip worth its price in every band of speed [m/s], and the share of time wheels are let roll."""
    braking = (traces.time > _BEGINNING_S)[:, None] & (traces.speed > BANDS[-1][0])
    braked = traces.pressure > _ROLLS
    found = {"let_roll": float(1.0 - braked[braking].mean())}
    for low, high in BANDS:
        mine = (braking & (traces.speed >= low) & (traces.speed < high))[..., None] & braked
        for name in ("slip", "worth"):
            values = getattr(traces, name)[mine]
            found[f"{name} {high:g} to {low:g}"] = float(np.median(values)) if values.size else float("nan")
    return found


def compare(policy: Policy, arguments: Arguments) -> tuple[list[dict[str, float]], dict[str, Traces]]:
    """Return a row for each rail, and its traces by title."""
    price = policy.contract.training["arguments"]["slide_price"]  # at which a slip is worth it
    stops = low_adhesion(VEHICLES[arguments.vehicle], "recovering", arguments.stops, HELD_OUT)
    rows, found = [], {}
    for tau in RECOVERIES:
        own = trace(policy, arguments.vehicle, [dataclasses.replace(stop, tau=tau) for stop in stops], price)
        rows.append({"tau_m_per_J": tau, **summary(own)})
        found["classic law" if tau == 0.0 else f"tau = {tau:.1e} m/J"] = own
    return rows, found


def failures(policy: Policy, arguments: Arguments) -> tuple[dict[str, Traces], dict[str, Traces]]:
    """Return the traces of the policy and of the rules where the policy fails, by world."""
    rules = RuleBasedWSP(best_at(Path("agents/trained") / arguments.vehicle, arguments.price))
    controllers: tuple[Controller, Controller] = policy, rules
    found: tuple[dict[str, Traces], dict[str, Traces]] = {}, {}
    for name, stops, mechanisms in worlds(arguments.vehicle, arguments.drawn + 1):
        if name in FAILURES:
            for traces, controller in zip(found, controllers, strict=True):
                traces[name] = trace(controller, arguments.vehicle, stops, 0.0, Conduct(mechanisms=mechanisms))
    return found


def table(rows: list[dict[str, float]]) -> str:
    """Return the rows as a table in Markdown: slip, and in brackets the slip worth its price."""
    names = [f"{high:g} to {low:g}" for low, high in BANDS]
    lines = [
        "| tau [m/J] | " + " | ".join(f"slip at {name} m/s" for name in names) + " | let roll |",
        "|--:|" + "--:|" * (len(names) + 1),
    ]
    for row in rows:
        cells = [f"{row[f'slip {name}']:.2f} ({row[f'worth {name}']:.2f})" for name in names]
        lines.append(f"| {row['tau_m_per_J']:.1e} | " + " | ".join(cells) + f" | {100.0 * row['let_roll']:.0f} % |")
    return "\n".join(lines)


def draw(found: Mapping[str, Traces], number: int, path: Path, rules: Mapping[str, Traces] | None = None) -> None:
    """Draw one stop in every world: speeds above, slips in the middle, pressures below; of the rules means of the axles.

    Without rules the slip that is worth its price is drawn beside.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, len(found), figsize=(12.0, 7.0), sharex="col", sharey="row", squeeze=False)
    for column, (name, one) in enumerate(found.items()):
        moving = one.speed[:, number] > 1.0
        time, speed = one.time[moving], one.speed[moving, number]
        slip, worth, pressure = (values[moving, number] for values in (one.slip, one.worth, one.pressure))
        for k in range(slip.shape[1]):
            axes[0, column].plot(time, speed - slip[:, k], linewidth=0.7, label=f"axle {k + 1}")
            axes[1, column].plot(time, slip[:, k], linewidth=0.7)
            axes[2, column].plot(time, pressure[:, k], linewidth=0.7)
        axes[0, column].plot(time, speed, color="black", label="vehicle")
        if rules is None:
            axes[1, column].plot(time, worth.mean(axis=1), color="black", linestyle=":", label="worth its price")
        else:
            other = rules[name]
            moving = other.speed[:, number] > 1.0
            means = (
                other.speed[moving, number],
                other.slip[moving, number].mean(axis=1),
                other.pressure[moving, number].mean(axis=1),
            )
            for axis, values in zip(axes[:, column], means, strict=True):
                axis.plot(other.time[moving], values, color="grey", linewidth=0.9, label="rules", zorder=0)
        axes[0, column].set_title(name)
        axes[2, column].set_xlabel("time [s]")
    for row, label in enumerate(("speed [m/s]", "slip speed [m/s]", "cylinder pressure / full")):
        axes[row, 0].set_ylabel(label)
    axes[1, 0].set_ylim(0.0, 4.0)
    for axis in axes[:2, 0]:
        axis.legend(frameon=False, fontsize=8)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def main(arguments: Arguments) -> None:
    """Look, print and draw."""
    if not 0 <= arguments.drawn < arguments.stops:
        raise SystemExit(f"there is no stop {arguments.drawn}: give --drawn 0 to {arguments.stops - 1}")
    policy = load_policy(arguments.folder if arguments.folder.name else Path("agents/trained") / arguments.vehicle)
    if arguments.failures:
        path = arguments.out if arguments.out.name else Path("docs/agents_failures.png")
        own, rules = failures(policy, arguments)
        draw(own, arguments.drawn, path, rules)
    else:
        path = arguments.out if arguments.out.name else Path("docs/agents_behaviour.png")
        rows, found = compare(policy, arguments)
        draw(found, arguments.drawn, path)
        print(json.dumps(rows, indent=1) if arguments.json else table(rows))
    print(path, file=sys.stderr)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
