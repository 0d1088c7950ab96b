"""How a controller tolerates a vehicle that differs from the one it assumes: `python -m agents.tolerances --vehicle bogie`.

Each tolerance changes one property of the vehicle. The controller brakes it twice: first it assumes the nominal vehicle, then
it knows the true one. The first distance over that of the nominal vehicle is the cost of the tolerance. The second distance
over the first is what an observer could gain that learned the true property while braking.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.drawn import Believing
from agents.measure import CHOSEN_BY, Yardstick, low_adhesion
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Stop


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """What differs: fields of the brake by factors, one axle by a mechanism, the stops by a function."""

    factors: Mapping[str, float] = dataclasses.field(default_factory=dict)
    mechanisms: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    stop: Callable[[Stop], Stop] = lambda stop: stop

    def of(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle that brakes."""
        own = {name: factor * getattr(vehicle.brake, name) for name, factor in self.factors.items()}
        return dataclasses.replace(vehicle, brake=dataclasses.replace(vehicle.brake, **own))


def _noisy(stop: Stop) -> Stop:
    return dataclasses.replace(stop, noise=0.3)


def _worn(stop: Stop) -> Stop:
    return dataclasses.replace(stop, radius=stop.radius * np.where(np.arange(len(stop.radius)) == 0, 0.98, 1.0))


def _heavy(stop: Stop) -> Stop:
    return dataclasses.replace(stop, mass=1.1 * stop.mass)


def _falling(stop: Stop) -> Stop:
    return dataclasses.replace(stop, gradient=-0.01)


#: What is tried; sizes are those of tolerances of valves, pads and sensors (assumptions, as in `agents.drawn`).
TOLERANCES = {
    "as believed": Tolerance(),
    "dead time x 1.5": Tolerance({"dead_time_s": 1.5}),
    "filling x 1.4": Tolerance({"fill_time_constant_s": 1.4}),
    "filling x 0.7": Tolerance({"fill_time_constant_s": 0.7}),
    "venting x 1.4": Tolerance({"vent_time_constant_s": 1.4}),
    "venting x 0.7": Tolerance({"vent_time_constant_s": 0.7}),
    "all three x 1.4": Tolerance({"dead_time_s": 1.4, "fill_time_constant_s": 1.4, "vent_time_constant_s": 1.4}),
    "demand's rise x 1.25": Tolerance({"demand_rise_s": 1.25}),
    "demand's rise x 0.75": Tolerance({"demand_rise_s": 0.75}),
    "torque + 10 %": Tolerance({"torque_per_bar_nm": 1.1}),
    "torque - 10 %": Tolerance({"torque_per_bar_nm": 0.9}),
    "torque of one axle - 20 %": Tolerance(mechanisms={"brake_gain_imbalance": {"gain": -0.2, "axle": 1.0}}),
    "mass + 10 %": Tolerance(stop=_heavy),
    "10 per mille downhill": Tolerance(stop=_falling),
    "first wheelset worn 2 %": Tolerance(stop=_worn),
    "sensor noise 0.3 rad/s": Tolerance(stop=_noisy),
}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is measured."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    controllers: tuple[str, ...] = ("adaptive",)  # names or folders of policies
    tolerances: tuple[str, ...] = tuple(TOLERANCES)
    laws: tuple[str, ...] = ("recovering", "classic")
    stops: int = 8  # of each law
    drawn_by: int = CHOSEN_BY  # seed of the stops
    keep: Path | None = None  # file of what was measured; an interrupted run goes on with it
    json: bool = False


def braked(controller: Controller, tolerance: Tolerance, law: str, told: bool, arguments: Arguments) -> dict[str, list[float]]:
    """Return distance [m], mean slip [m/s] and locked time [s] of the stops.

    With `told` the controller knows the true vehicle, else it assumes the nominal one.
    """
    nominal = VEHICLES[arguments.vehicle]
    vehicle = tolerance.of(nominal)
    stops = [tolerance.stop(stop) for stop in low_adhesion(nominal, law, arguments.stops, arguments.drawn_by)]
    yardstick = Yardstick(vehicle, stops, Conduct(mechanisms=tolerance.mechanisms))
    found = yardstick.figures(controller if told else Believing(controller, nominal))
    return {name: found[name].tolist() for name in ("distance_m", "mean_slip_mps", "locked_s")}


def measure(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each tolerance, law and controller."""
    kept: dict[str, Any] = {}
    if arguments.keep and arguments.keep.exists():
        kept = json.loads(arguments.keep.read_text(encoding="utf-8"))
    rows = []
    for name in arguments.tolerances:
        for law in arguments.laws:
            for who in arguments.controllers:
                controller = load_policy(who) if Path(who).is_dir() else load(who)
                found = []
                for told in (False, True) if TOLERANCES[name].factors else (False,):
                    label = f"{arguments.vehicle} {arguments.stops} {arguments.drawn_by} {who} {law} {name} {told}"
                    if label not in kept:
                        kept[label] = braked(controller, TOLERANCES[name], law, told, arguments)
                        if arguments.keep:
                            arguments.keep.write_text(json.dumps(kept), encoding="utf-8")
                    found.append({key: np.array(value) for key, value in kept[label].items()})
                rows.append({"tolerance": name, "law": law, "controller": who} | _row(found))
    return _over_the_first(rows)


def _row(found: Sequence[Mapping[str, np.ndarray]]) -> dict[str, Any]:
    own = found[0]
    row = {
        "distances": own["distance_m"],
        "slip_mps": float(own["mean_slip_mps"].mean()),
        "lock_s": float(own["locked_s"].max()),
    }
    if len(found) > 1:
        ratio, half = interval(found[1]["distance_m"] / own["distance_m"])
        row |= {"told": ratio, "told_ci": half, "told_slip_mps": float(found[1]["mean_slip_mps"].mean())}
    return row


def _over_the_first(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Put distances over those of the first tolerance under the same law."""
    first = {(row["law"], row["controller"]): row["distances"] for row in reversed(rows)}
    for row in rows:
        ratio, half = interval(row["distances"] / first[row["law"], row["controller"]])
        row |= {"over": ratio, "over_ci": half}
    return [{key: value for key, value in row.items() if key != "distances"} for row in rows]


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| tolerance | law | controller | distance / as believed | slip [m/s] | longest lock [s] "
        "| true brake known: distance / nominal brake assumed | slip [m/s] |",
        "|:--|:--|:--|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        told = [f"{row['told']:.3f} ± {row['told_ci']:.3f}", f"{row['told_slip_mps']:.2f}"] if "told" in row else ["", ""]
        cells = [row["tolerance"], row["law"], Path(row["controller"]).name, f"{row['over']:.3f} ± {row['over_ci']:.3f}"]
        lines.append("| " + " | ".join([*cells, f"{row['slip_mps']:.2f}", f"{row['lock_s']:.2f}", *told]) + " |")
    return "\n".join(lines)


def main(arguments: Arguments) -> None:
    """Measure and print."""
    rows = measure(arguments)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
