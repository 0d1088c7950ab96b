"""Stops of the coach, recorded sample by sample with what only a plant in space knows."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from baselines.rule_based import RuleBasedParameters, RuleBasedWSP
from wsp_env.parameters.track_geometry import TrackGeometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.velim import CONTACT, SAMPLE_TIME_S, TAU_M_PER_J
from wsp_env.plant import make_plant
from wsp_env.plant.port import Measurement, Setup, Stop, further_truth, given_up

#: The controller decides at every second sample.
DECIDES_EVERY = 2

#: Standard deviations of the recorded channels (assumption: good sensors): speed [m/s], wheel speed [rad/s], torque [N m].
NOISE = (0.01, 0.02, 50.0)


class Planned(NamedTuple):
    """One stop of a campaign."""

    name: str
    speed_mps: float
    mu_cd: float
    coast_s: float = 2.0  # rolling freely before the brake is applied
    demand: float = 1.0
    start_m: float = 0.0  # where it begins along the line; 0 in all stops of a campaign: nobody knows
    believed_mu_cd: float | None = None  # by the test team; None: the mean of all stops


class Driven(NamedTuple):
    """What happened in one stop of T samples with A axles."""

    time: np.ndarray  # (T,) [s]
    speed: np.ndarray  # (T,) [m/s]
    deceleration: np.ndarray  # (T,) [m/s2]
    slip: np.ndarray  # (T, A) [m/s]
    wheel_speed: np.ndarray  # (T, A) [rad/s]
    torque: np.ndarray  # (T, A) [N m]
    wheel_load: np.ndarray  # (T, A) mean of both wheels [N]; the static load where the plant does not say
    distance: float  # [m]
    more: dict[str, np.ndarray]  # what the plant knows further, (T, ...) by name


def drive(
    stops: Sequence[Planned],
    plant: str = "multibody",
    track: TrackGeometry | None = None,
    sample_s: float = SAMPLE_TIME_S,
    keep: Sequence[str] = (),
    vehicle: Vehicle = COACH,
    thresholds: Mapping[str, float] | None = None,
) -> list[Driven]:
    """Brake the stops, all at once, with the rule-based controller.

    `RuntimeError` for a stop that the plant gives up.

    Parameters
    ----------
    keep : what else of `further_truth` is kept
    thresholds : of the controller, in place of its own

    """
    setup = Setup(sample_s, track_geometry=track)
    vehicle = dataclasses.replace(vehicle, contact=CONTACT)
    made = make_plant(vehicle, len(stops), setup, plant)
    radius, flat = np.full(vehicle.axles, vehicle.wheel_radius_m), np.ones(1)
    for i, stop in enumerate(stops):
        made.start(i, Stop(stop.mu_cd, TAU_M_PER_J, stop.speed_mps, vehicle.mass_kg, 0.0, 0.0, 0.0, i, radius, flat, flat))
    controller = RuleBasedWSP(dataclasses.replace(RuleBasedParameters(), **(thresholds or {})))
    controller.reset(len(stops), vehicle)
    coast, demand = np.array([stop.coast_s for stop in stops]), np.array([stop.demand for stop in stops])
    samples: list[tuple[np.ndarray, ...]] = []
    moved: list[np.ndarray] = []
    command = np.ones((len(stops), vehicle.axles))
    step = 0
    while made.moving.any():
        made.conditions.demand[:] = np.where(step * sample_s >= coast, demand, 0.0)
        if step % DECIDES_EVERY == 0:
            seen: Measurement = made.reading()._replace(pressure=None)
            command = np.asarray(controller.act(seen), dtype=np.float64)
        now = made.truth()
        further = further_truth(made)
        loads = further.get("wheel_load_n")
        load_n = np.full(now.pressure.shape, vehicle.static_wheel_load_n) if loads is None else loads.mean(axis=2)
        torque = vehicle.brake.torque_per_bar_nm * now.pressure
        one = (now.speed, now.deceleration, now.slip_speed, now.wheel_speed, torque, load_n, *(further[name] for name in keep))
        samples.append(tuple(values.copy() for values in one))
        moved.append(made.moving.copy())
        made.step(command)
        step += 1
    if lost := given_up(made):
        raise RuntimeError(f"given up: {lost}")
    columns = [np.array(values) for values in zip(*samples, strict=True)]
    lengths, distance = np.array(moved).sum(axis=0), made.truth().position
    return [
        _driven(sample_s, [values[:length, i] for values in columns], float(distance[i]), keep)
        for i, length in enumerate(lengths)
    ]


def _driven(sample_s: float, columns: list[np.ndarray], distance: float, keep: Sequence[str]) -> Driven:
    """Return one stop from its columns in the order in which they were sampled."""
    speed, deceleration, slip, wheel_speed, torque, load_n, *more = columns
    time = sample_s * np.arange(len(speed))
    further = dict(zip(keep, more, strict=True))
    return Driven(time, speed, deceleration, slip, wheel_speed, torque, load_n, distance, further)


def along_the_line(stops: Sequence[Planned], line: TrackGeometry, vehicle: Vehicle = COACH, **more: Any) -> list[Driven]:
    """Brake stops that begin at their places of one line, whose curves all lie ahead of them; `more` as for `drive`."""
    driven = []
    for stop in stops:
        curves = tuple(dataclasses.replace(curve, begin_m=curve.begin_m - stop.start_m) for curve in line.curves)
        driven += drive([stop], track=dataclasses.replace(line, curves=curves), vehicle=vehicle, **more)
    return driven


def table(driven: Driven, seed: int) -> pl.DataFrame:
    """Return a stop as the recording of sensors with `NOISE`."""
    rng = np.random.default_rng(seed)
    n = len(driven.time)
    columns = {"time_s": driven.time, "vehicle_speed_mps": driven.speed + NOISE[0] * rng.standard_normal(n)}
    for k in range(driven.torque.shape[1]):
        columns[f"axle{k + 1}_wheel_speed_radps"] = driven.wheel_speed[:, k] + NOISE[1] * rng.standard_normal(n)
        columns[f"axle{k + 1}_brake_torque_nm"] = driven.torque[:, k] + NOISE[2] * rng.standard_normal(n)
    return pl.DataFrame(columns)


def write_campaign(
    folder: Path,
    name: str,
    stops: Sequence[Planned],
    driven: Sequence[Driven],
    validate: Sequence[str],
    vehicle: Vehicle = COACH,
    blind: Sequence[int] = (),
) -> None:
    """Write a campaign folder: what a test team would believe of the coach, and one table per run.

    `blind` are axles, from 1, whose wheel speeds are not recorded.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for i, (stop, one) in enumerate(zip(stops, driven, strict=True)):
        table(one, i).drop(f"axle{k}_wheel_speed_radps" for k in blind).write_parquet(folder / f"{stop.name}.parquet")
    tune = [stop.name for stop in stops if stop.name not in validate]
    believed = float(np.mean([stop.mu_cd for stop in stops]))
    lines = [
        "[campaign]", f'name = "{name}"', f"tune = {tune}", f"validate = {list(validate)}",
        f"sample_time_s = {SAMPLE_TIME_S}", "[vehicle]", f"axles = {vehicle.axles}",
        f"axle_positions_m = {list(vehicle.axle_positions_m)}", f"mass_kg = {vehicle.mass_kg}",
        f"wheelset_inertia_kgm2 = {vehicle.wheelset_inertia_kgm2}", f"wheel_radius_m = {vehicle.wheel_radius_m}",
        f"gravity_mps2 = {vehicle.gravity_mps2}", f"resistance_n = {[float(value) for value in vehicle.resistance]}",
        f"missing_axles = {list(blind)}", 'brake_torque_source = "measured"', "[contact]",
        'set = "velim"', f"kinetic_friction_d = {believed}",
    ]  # fmt: skip
    for stop in stops:
        lines += [f"[runs.{stop.name}]", f'file = "{stop.name}.parquet"', f"start_position_m = {stop.start_m}"]
        if stop.believed_mu_cd is not None:
            lines.append(f"kinetic_friction_d = {stop.believed_mu_cd}")
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
