"""Recorded stops with a known truth: the creepage of every axle is prescribed, the law gives the forces, these the speed.

The wheel speeds and torques that belong to them follow from eqs. (2) and (11), so no controller and no plant is needed.
"""

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.parameters.velim import CONTACT

AXLES = 4
MASS_KG = 43000.0
INERTIA_KGM2 = 160.0
RADIUS_M = 0.445
GRAVITY = 9.81
WHEEL_LOAD_N = MASS_KG * GRAVITY / (2 * AXLES)
SAMPLE_S = 0.01
COASTING_S = 1.0

_FINE = 5  # integration steps per sample
_KNOTS_M = 10.0  # mu_cd along the track is drawn at places this far apart, straight lines between


def creepages(time_s: np.ndarray, peak: float) -> np.ndarray:
    """Creepage [-] (T, axles): zero while coasting, then swinging about a level of its own for each axle."""
    braking = np.clip(time_s - COASTING_S, 0.0, None)[:, None]
    axle = np.arange(AXLES)
    swing = 1.0 + 0.4 * np.sin(2 * np.pi * braking / (2.5 + 0.3 * axle) + axle)
    return peak * (0.5 + 0.5 * axle / (AXLES - 1)) * (1.0 - np.exp(-((braking / 0.8) ** 3))) * swing


def stop(
    tau: float,
    mu_cd: float,
    speed_mps: float = 35.0,
    duration_s: float = 12.0,
    peak: float = 0.25,
    noise: float = 0.0,
    seed: int = 0,
) -> dict[str, np.ndarray]:
    """Return the columns of a recording in the native format; `noise` 1 is that of good sensors."""
    return stops(tau, [mu_cd], speed_mps, duration_s, peak, noise, [seed])[0]


def stops(
    tau: float,
    mu_cd: Sequence[float],
    speed_mps: float = 35.0,
    duration_s: float = 12.0,
    peak: float = 0.25,
    noise: float = 0.0,
    seeds: Sequence[int] = (0,),
    uneven: float = 0.0,
) -> list[dict[str, np.ndarray]]:
    """Return several stops, one for each mu_cd; `uneven` is the relative standard deviation of mu_cd along the track."""
    drawn = tuple(seeds) if uneven else (0,) * len(mu_cd)  # the rail alone depends on them
    time, creepage, speed, force = _driven(tau, tuple(mu_cd), speed_mps, duration_s, peak, drawn, uneven)
    return [_columns(time, creepage, speed[:, k], force[:, k], noise, seed) for k, seed in enumerate(seeds)]


@functools.lru_cache(maxsize=64)
def _driven(
    tau: float,
    mu_cd: tuple[float, ...],
    speed_mps: float,
    duration_s: float,
    peak: float,
    seeds: tuple[int, ...],
    uneven: float,
) -> tuple[np.ndarray, ...]:
    """Return time (T,), creepage (T, axles), speed (T, N), force (T, N, axles); kept, as many tests ask for the same stops."""
    step = SAMPLE_S / _FINE
    time = step * np.arange(int(duration_s / step))
    creepage = creepages(time, peak)
    speed = np.empty((len(time), len(mu_cd)))
    force = np.empty((len(time), len(mu_cd), AXLES))
    speed[0] = speed_mps
    place = np.zeros(len(mu_cd))
    knots = 1 + int(speed_mps * duration_s / _KNOTS_M)
    along = [
        mu * (1.0 + uneven * np.random.default_rng([seed, 1]).standard_normal(knots + 1))
        for mu, seed in zip(mu_cd, seeds, strict=True)
    ]
    rail, which = np.array(along), np.arange(len(mu_cd))
    for i in range(len(time)):
        knot, beyond = np.divmod(place / _KNOTS_M, 1.0)
        left, right = (rail[which, knot.astype(int) + k] for k in (0, 1))
        v, here = speed[i][:, None], ((1.0 - beyond) * left + beyond * right)[:, None]
        force[i] = 2 * WHEEL_LOAD_N * degraded_adhesion(creepage[i] * v, v, WHEEL_LOAD_N, here, tau, CONTACT.law)
        if i + 1 < len(time):
            speed[i + 1] = speed[i] - step * force[i].sum(axis=1) / MASS_KG
        place += step * speed[i]
    return time, creepage, speed, force


def _columns(
    time: np.ndarray, creepage: np.ndarray, speed: np.ndarray, force: np.ndarray, noise: float, seed: int
) -> dict[str, np.ndarray]:
    wheel = (1.0 - creepage) * speed[:, None] / RADIUS_M
    torque = RADIUS_M * force - INERTIA_KGM2 * np.gradient(wheel, time[1], axis=0)
    rng = np.random.default_rng(seed)
    kept = slice(None, None, _FINE)
    n = len(time[kept])
    columns = {"time_s": time[kept].copy(), "vehicle_speed_mps": speed[kept] + 0.01 * noise * rng.standard_normal(n)}
    for k in range(AXLES):
        columns[f"axle{k + 1}_wheel_speed_radps"] = wheel[kept, k] + 0.02 * noise * rng.standard_normal(n)
        columns[f"axle{k + 1}_brake_torque_nm"] = torque[kept, k] + 50.0 * noise * rng.standard_normal(n)
    return columns


def write_campaign(
    folder: Path,
    runs: dict[str, dict[str, np.ndarray]],
    tune: list[str] | None = None,
    validate: list[str] | None = None,
    suffix: str = ".csv",
) -> Path:
    """Write a campaign folder; every run is tuned on unless said otherwise."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [
        "[campaign]",
        'name = "synthetic"',
        f"tune = {tune if tune is not None else list(runs)}",
        f"validate = {validate or []}",
        f"sample_time_s = {SAMPLE_S}",
        "[vehicle]",
        f"axles = {AXLES}",
        f"mass_kg = {MASS_KG}",
        f"wheelset_inertia_kgm2 = {INERTIA_KGM2}",
        f"wheel_radius_m = {RADIUS_M}",
        f"gravity_mps2 = {GRAVITY}",
        'brake_torque_source = "measured"',
        "[contact]",
        'set = "velim"',
    ]
    for place, (name, columns) in enumerate(runs.items()):
        frame = pl.DataFrame(columns)
        if suffix == ".parquet":
            frame.write_parquet(folder / f"{name}{suffix}")
        else:
            frame.write_csv(folder / f"{name}{suffix}")
        lines += [f"[runs.{name}]", f'file = "{name}{suffix}"', f"start_position_m = {1000.0 * place}"]
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder
