"""Controllers on vehicles that differ from the one they assume: `python -m agents.drawn --vehicle bogie`.

The stops are held out. Brakes are nominal, or brakes, radii, sensor noise and wear are drawn at random. All controllers assume
the nominal vehicle; `--told` lets them know fields of the true brake. The table gives each controller's figures as ratios to
the lower envelope of the others' fronts (see `agents.rivals`) in the same world at the controller's own mean slip; the ratio
of distances has its standard error. `--json` prints the means as well. For several trainings (`--runs`) a second table gives
mean, confidence interval and range.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.measure import HELD_OUT, Yardstick, low_adhesion
from agents.rivals import at_slip, classical, envelope
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement, Stop

#: What a vehicle's brakes may be (assumptions: tolerances of valves and pads): dead time, time constants of filling and of
#: venting and the rise of the demand [s], gain of all and of one axle and radius of each wheel over the nominal ones [-], lag
#: of one axle [s].
DEAD_S, FILL_S, VENT_S, RISE_S = (0.02, 0.06), (0.18, 0.35), (0.10, 0.22), (3.0, 5.0)
GAIN, GAIN_OF_ONE, RADIUS, LAG_S = 0.05, 0.1, 5e-4, (0.0, 0.03)

#: What else may slow it less or more, in the world "line": rise of the track over distance [-], drag beyond the believed one
#: [N s2/m2], change of the pads' friction with the speed [s/m] (assumptions).
GRADIENT, DRAG_NS2_PER_M2, PADS_S_PER_M = (-0.01, 0.01), (0.0, 2.5), (-0.004, 0.0)

#: What the wheels remove from the contaminant layer for those behind them, in the world "cleaning" [m/J]: up to the usual
#: recovery rate of the wheels themselves (assumption, no source).
REMOVAL_M_PER_J = (0.0, 1.9e-4)

#: The worlds of one further force each, at the ends of these ranges: rise of the track, mechanisms.
FORCES: dict[str, tuple[float, dict[str, dict[str, float]]]] = {
    "downhill": (GRADIENT[0], {}),
    "uphill": (GRADIENT[1], {}),
    "drag": (0.0, {"aerodynamic_drag": {"c_ns2_per_m2": DRAG_NS2_PER_M2[1]}}),
}

#: Worlds in which brakes, radii, noise and wear are all drawn.
ALL = ("all", "line", "cleaning")

#: Vehicles drawn; each brakes as many of the stops.
DRAWS = 8

#: Worn radius of one wheelset over the nominal one [-], and noise of all sensors [rad/s], of the worlds so called.
WORN = (0.01, 0.02, 0.03, 0.04)
NOISE = 0.3

#: Figures that are reported as ratios to the envelope, and all that is kept of every stop.
REPORTED = ("distance_m", "slip_deviation_mps", "contact_energy_mj", "air_nl")
KEPT = (*REPORTED, "mean_slip_mps", "locked_s")

#: Sets of stops drawn anew from those measured, with replacement, for a standard error (assumption: known to a twentieth).
RESAMPLED = 200

#: What stands before the name of a training in that of its policy.
_RUN = "policy of"

#: Fields of a drawn brake that controllers may be told.
Known = Literal["dead_time_s", "fill_time_constant_s", "vent_time_constant_s", "demand_rise_s", "torque_per_bar_nm"]

World = list[tuple[Vehicle, dict[str, dict[str, float]], list[Stop]]]

#: What is kept of a controller: figure -> its value in every stop (N,).
Stops = Mapping[str, Sequence[float]]


class Believing:
    """A controller that assumes another vehicle than the one that it brakes.

    Parameters
    ----------
    controller : the controller
    vehicle : the vehicle that it assumes

    """

    def __init__(self, controller: Controller, vehicle: Vehicle) -> None:
        self.controller, self.vehicle = controller, vehicle
        self.action = getattr(controller, "action", "valve")

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        self.controller.reset(n, self.vehicle)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A)."""
        return self.controller.act(measurement)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is compared."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    stops: int = 40  # in each world and under each law
    worlds: tuple[str, ...] = ("nominal", "drawn brakes")  # see `world`
    laws: tuple[str, ...] = ("recovering", "classic")  # "capped": recovering, but not beyond the creepages of the fit
    policies: tuple[Path, ...] = ()  # folders; none: agents/trained/VEHICLE
    runs: tuple[Path, ...] = ()  # folders of trainings with several seeds, whose policies are braked with too
    only: tuple[str, ...] = ()  # who is braked with, by the beginning of the name; none: all, and without rivals no ratios
    drawn_by: int = HELD_OUT  # seed of the stops and of what is drawn
    told: tuple[Known, ...] = ()  # fields of the true brake that the controllers know
    keep: Path | None = None  # file of what was measured; an interrupted run goes on with it
    json: bool = False


def drawn_vehicle(vehicle: Vehicle, rng: np.random.Generator) -> tuple[Vehicle, dict[str, dict[str, float]]]:
    """Draw the brakes of a vehicle: itself, and the mechanisms on one axle."""
    dead, fill, vent, rise = (float(rng.uniform(*ends)) for ends in (DEAD_S, FILL_S, VENT_S, RISE_S))
    gain, weak, axle = rng.normal(0.0, GAIN), rng.normal(0.0, GAIN_OF_ONE), float(rng.integers(vehicle.axles) + 1)
    brake = dataclasses.replace(
        vehicle.brake,
        dead_time_s=dead,
        fill_time_constant_s=fill,
        vent_time_constant_s=vent,
        demand_rise_s=rise,
        torque_per_bar_nm=vehicle.brake.torque_per_bar_nm * float(np.exp(gain)),
    )
    slow = {"lag_s": float(rng.uniform(*LAG_S)), "axle": float(rng.integers(vehicle.axles) + 1)}
    mechanisms = {"brake_gain_imbalance": {"gain": float(np.clip(weak, -0.3, 0.3)), "axle": axle}, "brake_delay": slow}
    return dataclasses.replace(vehicle, brake=brake), mechanisms


def drawn_line(rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Draw drag and pads of the world "line" as mechanisms."""
    drag, pads = float(rng.uniform(*DRAG_NS2_PER_M2)), float(rng.uniform(*PADS_S_PER_M))
    return {"aerodynamic_drag": {"c_ns2_per_m2": drag}, "pad_friction": {"per_speed_s_per_m": pads}}


def drawn_cleaning(rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Draw what wheels of the world "cleaning" remove as a mechanism."""
    return {"leading_axle_cleaning": {"removal_m_per_j": float(rng.uniform(*REMOVAL_M_PER_J))}}


def world(name: str, vehicle: Vehicle, law: str, count: int, seed: int) -> World:
    """Return the vehicles of a world with the stops of each.

    "nominal"; "drawn brakes"; "noise"; "worn" (one wheelset of each stop, by 1 to 4 %); "all" of these; "line": all, on
    gradients, with drag and fading pads; "downhill", "uphill" and "drag": nominal, with this force.
    """
    stops = low_adhesion(vehicle, law, count, seed)
    rng = np.random.default_rng([seed, 1])
    if name in ("drawn brakes", *ALL):
        stops = [_changed(stop, 1.0 + RADIUS * rng.normal(size=vehicle.axles)) for stop in stops]
    if name in ("worn", *ALL):
        wear = [WORN[i % len(WORN)] for i in range(count)]
        axles = rng.integers(vehicle.axles, size=count)
        one = np.eye(vehicle.axles)
        stops = [_changed(stop, 1.0 - worn * one[k]) for stop, worn, k in zip(stops, wear, axles, strict=True)]
    if name == "noise":
        stops = [dataclasses.replace(stop, noise=NOISE) for stop in stops]
    if name in ALL:
        stops = [dataclasses.replace(stop, noise=float(rng.uniform(0.0, NOISE))) for stop in stops]
    if name in ("nominal", "noise", "worn"):
        return [(vehicle, {}, stops)]
    if name in FORCES:
        gradient, mechanisms = FORCES[name]
        return [(vehicle, mechanisms, [dataclasses.replace(stop, gradient=gradient) for stop in stops])]
    if name not in ("drawn brakes", *ALL):
        valid = ", ".join(("nominal", "drawn brakes", "noise", "worn", *ALL, *FORCES))
        raise SystemExit(f"no world {name!r}; valid: {valid}")
    parts = [(*drawn_vehicle(vehicle, rng), stops[i::DRAWS]) for i in range(min(DRAWS, count))]
    if name == "cleaning":
        return [(own, mechanisms | drawn_cleaning(rng), of_it) for own, mechanisms, of_it in parts]
    if name == "all":
        return parts
    line = np.random.default_rng([seed, 2])
    parts = [(own, mechanisms | drawn_line(line), of_it) for own, mechanisms, of_it in parts]
    return [(own, mechanisms, [_sloping(stop, line) for stop in of_it]) for own, mechanisms, of_it in parts]


def _changed(stop: Stop, radius: np.ndarray) -> Stop:
    return dataclasses.replace(stop, radius=stop.radius * radius)


def _sloping(stop: Stop, rng: np.random.Generator) -> Stop:
    return dataclasses.replace(stop, gradient=float(rng.uniform(*GRADIENT)))


class Drawn:
    """The same stops of a world for every controller; as `agents.measure.Yardstick`, of several vehicles."""

    def __init__(self, believed: Vehicle, parts: World, told: Sequence[str] = ()) -> None:
        self.believed = [_told(believed, own, told) for own, _, _ in parts]
        self.parts = [Yardstick(own, stops, Conduct(mechanisms=mechanisms)) for own, mechanisms, stops in parts]

    def figures(self, controller: Controller) -> dict[str, np.ndarray]:
        """Return the figures of all stops, (N,) each."""
        found = [part.figures(Believing(controller, own)) for part, own in zip(self.parts, self.believed, strict=True)]
        return {name: np.concatenate([own[name] for own in found]) for name in found[0]}

    @property
    def blocks(self) -> np.ndarray:
        """Number of the draw (N,) that each stop shares with others: its vehicle, or itself where there is but one vehicle."""
        sizes = [len(part.stops) for part in self.parts]
        return np.arange(sizes[0]) if len(sizes) == 1 else np.repeat(np.arange(len(sizes)), sizes)


def _told(believed: Vehicle, true: Vehicle, fields: Sequence[str]) -> Vehicle:
    """Return the believed vehicle with these fields of the true one's brake."""
    known = {name: getattr(true.brake, name) for name in fields}
    return dataclasses.replace(believed, brake=dataclasses.replace(believed.brake, **known))


def means_of(found: Stops) -> dict[str, float]:
    """Return the means of a controller's figures, and the longest lock of its stops, `worst_locked_s` [s]."""
    own = {name: float(np.mean(values)) for name, values in found.items()}
    return own | {"worst_locked_s": float(np.max(found["locked_s"]))}


def standard_error(own: Stops, rivals: Sequence[Stops], blocks: np.ndarray) -> float:
    """Return the standard error of the ratio of distances of `against`: its scatter over stops drawn anew from those measured.

    Blocks (N,) of stops are drawn whole, and the same for everybody. nan without a rival.
    """
    sound = [rival for rival in rivals if np.max(rival["locked_s"]) == 0.0]
    rng, numbers, ratios = np.random.default_rng(0), np.unique(blocks), []
    for _ in range(RESAMPLED if sound else 0):
        chosen = np.concatenate([np.flatnonzero(blocks == one) for one in rng.choice(numbers, len(numbers))])
        other, mine = (
            [{name: np.mean(np.take(who[name], chosen)) for name in KEPT} for who in some] for some in (sound, [own])
        )
        ratios.append(mine[0]["distance_m"] / at_slip(other, float(mine[0]["mean_slip_mps"]))["distance_m"])
    return float(np.std(ratios, ddof=1)) if ratios else float("nan")


def against(own: Mapping[str, float], rivals: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Return a controller's figures over those of the rivals' envelope at its slip; `beyond` says that none slides as much.

    Rivals that lock a wheel do not count.
    """
    sound = [rival for rival in rivals if rival["worst_locked_s"] == 0.0]
    if not sound:
        return {f"{figure}_ratio": float("nan") for figure in REPORTED} | {"beyond_front": False, "rivals": 0}
    other = at_slip(sound, own["mean_slip_mps"])
    ratios = {f"{figure}_ratio": own[figure] / other[figure] for figure in REPORTED}
    most = max(point["mean_slip_mps"] for point in envelope(sound))
    return ratios | {"beyond_front": most < own["mean_slip_mps"], "rivals": len(sound)}


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each world, law and controller: its means, and over those of the others' envelope at its slip.

    A policy is compared with all classical controllers, one of these with the families that are not its own. What was measured
    before with the same arguments is read from `keep`.
    """
    vehicle, rows = VEHICLES[arguments.vehicle], list[dict[str, Any]]()
    families = classical(arguments.vehicle)
    shipped = (Path("agents/trained") / arguments.vehicle,)
    folders = {f"policy {folder.name}": folder for folder in arguments.policies or shipped}
    folders |= {f"{_RUN} {run.name}": run / "policy" for run in arguments.runs}
    policies = {name: load_policy(folder) for name, folder in folders.items()}
    for name in arguments.worlds:
        for law in arguments.laws:
            parts = world(name, under(vehicle, law), law, arguments.stops, arguments.drawn_by)
            yardstick = Drawn(vehicle, parts, arguments.told)
            every = {(family, who): one for family, own in families.items() for who, one in own.items()}
            every |= {("", who): one for who, one in policies.items()}
            if arguments.only:
                every = {key: one for key, one in every.items() if " ".join(key).strip().startswith(arguments.only)}
            found = {}
            for key, controller in every.items():
                what = f"{arguments.vehicle} {arguments.stops} {arguments.drawn_by} {name} {law}"
                what += "".join(f" {field}" for field in arguments.told)
                label = f"{what} {' '.join(key)} {_settings(controller)}"
                found[key] = _kept(arguments.keep, label) or measured(yardstick, controller)
                _keep(arguments.keep, label, found[key])
            for (family, who), own in found.items():
                rivals = [value for (other, _), value in found.items() if other not in ("", family)]
                row = means_of(own) | against(means_of(own), [means_of(rival) for rival in rivals])
                row["distance_error"] = standard_error(own, rivals, yardstick.blocks)
                rows.append({"world": name, "law": law, "controller": f"{family} {who}".strip()} | row)
    return rows


def measured(yardstick: Drawn, controller: Controller) -> Stops:
    """Return what is kept of a controller's stops."""
    found = yardstick.figures(controller)
    return {name: found[name].tolist() for name in KEPT}


def under(vehicle: Vehicle, law: str) -> Vehicle:
    """Return the vehicle on rail of that law; the cap is not reported to the controllers."""
    if law != "capped":
        return vehicle
    return dataclasses.replace(vehicle, contact=dataclasses.replace(vehicle.contact, traction_law="capped"))


def _settings(controller: Controller) -> str:
    """Return a name for a controller's settings, or for the network of a policy."""
    what = getattr(controller, "parameters", None) or getattr(controller, "contract", None)
    return hashlib.sha256(repr(what).encode()).hexdigest()[:8]


def _kept(path: Path | None, label: str) -> Stops | None:
    """Return what was measured before under a label."""
    found = json.loads(path.read_text(encoding="utf-8")) if path and path.exists() else {}
    kept: Stops | None = found.get(label)
    return kept


def _keep(path: Path | None, label: str, found: Stops) -> None:
    if path:
        before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        path.write_text(json.dumps(before | {label: dict(found)}) + "\n", encoding="utf-8")


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| world | law | controller | distance [m] | slip [m/s] | distance / envelope | standard deviation of slip / envelope "
        "| energy / envelope | air / envelope | longest lock [s] |",
        "|:--|:--|:--|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        ratios = [f"{row[f'{figure}_ratio']:.{3 if figure == 'distance_m' else 2}f}" for figure in REPORTED]
        ratios[0] += f" ± {row['distance_error']:.3f}"
        mark = " (beyond the front)" if row["beyond_front"] else ""
        cells = [row["world"], row["law"], row["controller"], f"{row['distance_m']:.0f}", f"{row['mean_slip_mps']:.2f}{mark}"]
        lines.append("| " + " | ".join([*cells, *ratios, f"{row['worst_locked_s']:.2f}"]) + " |")
    return "\n".join(lines)


def over_seeds(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return mean, 95 % confidence interval and range of the trainings among the rows as a table in Markdown.

    The last column counts those beyond the front.
    """
    lines = [
        "| world | law | trainings | distance / envelope | least to greatest | slip [m/s] "
        "| standard deviation of slip / envelope | energy / envelope | longest lock [s] | beyond the front |",
        "|:--|:--|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name, law in dict.fromkeys((row["world"], row["law"]) for row in rows):
        own = [row for row in rows if (row["world"], row["law"]) == (name, law) and row["controller"].startswith(_RUN)]
        found = {key: np.array([row[key] for row in own]) for key in ("distance_m_ratio", "mean_slip_mps", "worst_locked_s")}
        ratio = found["distance_m_ratio"]
        mean, error = interval(ratio)
        cells = [name, law, f"{len(own)}", f"{mean:.3f} ± {error:.3f}", f"{ratio.min():.3f} to {ratio.max():.3f}"]
        cells += [f"{found['mean_slip_mps'].mean():.2f}"]
        cells += [f"{np.mean([row[f'{figure}_ratio'] for row in own]):.2f}" for figure in REPORTED[1:3]]
        cells += [f"{found['worst_locked_s'].max():.2f}", f"{sum(row['beyond_front'] for row in own)}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Arguments) -> None:
    """Compare and print."""
    rows = compare(arguments)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))
    if len(arguments.runs) > 1 and not arguments.json:
        print(f"\n{over_seeds(rows)}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
