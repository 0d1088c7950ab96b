"""From a campaign to its files: what the recorders make of its stops, and campaign.toml, in the native format."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.other_truth import contact
from experiments.other_truth.campaign import Campaign, Rows
from experiments.other_truth.effects import EFFECTS
from experiments.other_truth.plant import GRAVITY_MPS2, ROW_S
from experiments.other_truth.records import Array, Sizes
from experiments.other_truth.sound import SOUND, generator, wander

#: White noise of every channel, times the noise of the campaign: vehicle [m/s], wheel [rad/s], pressure [bar].
WHITE = (0.012, 0.02, 0.008)
COUNT_RADPS = 0.004  # of a wheel speed; the vehicle's is half of it in m/s


class Recorders(NamedTuple):
    """What records a campaign."""

    rate_hz: int
    torque: str  # "pressure": pressures; "computed": torques from pressures; "measured": true torques
    starts_known: bool
    noise: float


def draw_recorders(campaign: Campaign, names: list[str]) -> Recorders:
    """Draw what records a campaign with some effects: they have to show in it."""
    rng = campaign.rng
    rate = int(rng.choice([20, 25, 50, 100, 200]))
    # What acts behind the pressure is unseen only where pressures are recorded.
    behind = any(EFFECTS[name].slot == "brake torque" for name in names)
    torque = str(rng.choice(["computed", "pressure"] if behind else ["computed", "pressure", "measured"]))
    known = bool(rng.random() < 0.75) or any(name in ("adhesion_patch", "curve_resistance") for name in names)
    return Recorders(rate, torque, known, float(rng.uniform(0.4, 1.2)))


def record(campaign: Campaign, index: int, rows: Rows, recorders: Recorders, late_s: float) -> dict[str, Array]:
    """Return the columns of a stop's file; the vehicle's speed is late by `late_s` [s]."""
    rng, rate = campaign.rng, recorders.rate_hz
    size = {kind: SOUND[kind].size if kind in campaign.sound else 0.0 for kind in SOUND}
    fine = ROW_S * np.arange(len(rows.speed))
    clock = np.arange(int(fine[-1] * rate)) / rate
    samples = len(clock)
    at = np.clip(clock + size["time_jitter"] / rate * rng.standard_normal(samples), 0.0, fine[-1])
    spray = wander(generator(campaign.seed * 1009 + 700 + index), samples, size["radar_spray"], 0.15 * rate)
    if size["radar_spray"] > 0.0:
        spray -= 0.08 * (np.convolve(rng.random(samples) < 0.05 / rate, np.ones(max(1, rate // 4)), mode="same") > 0.5)
    noise = [deviation * recorders.noise for deviation in WHITE]
    speed = np.interp(at - late_s, fine, rows.speed) + spray + noise[0] * rng.standard_normal(samples)
    count = max(size["coarse_counts"], COUNT_RADPS)
    table = {"time_s": clock, "vehicle_speed_mps": np.round(speed / (count / 2)) * (count / 2)}
    drift = size["pressure_drift"] * rng.uniform(-1.5, 1.5) * np.linspace(-0.5, 0.5, samples)
    gain = (1.0 + size["torque_gain"] * rng.standard_normal()) * (1.0 + drift)
    per_bar = campaign.vehicle.torque_per_bar_nm
    for j in range(campaign.axles):
        wheel, bar, torque = (np.interp(at, fine, values[:, j]) for values in (rows.wheel, rows.pressure, rows.torque))
        wheel = np.maximum(0.0, wheel + noise[1] * rng.standard_normal(samples))
        table[f"axle{j + 1}_wheel_speed_radps"] = np.round(wheel / count) * count
        white = noise[2] * rng.standard_normal(samples)
        pressure = np.round(bar * gain + white, 3)
        if recorders.torque == "pressure":
            table[f"axle{j + 1}_cylinder_pressure_bar"] = pressure
        else:
            read = pressure * per_bar if recorders.torque == "computed" else torque * gain + white * per_bar
            table[f"axle{j + 1}_brake_torque_nm"] = np.round(read, 1)
    return table


def write(campaign: Campaign, sizes: Sizes, recorders: Recorders, folder: Path) -> dict[str, float]:
    """Write campaign.toml and the files of all stops into a folder; return the true mu_cd by run."""
    count = len(campaign.runs)
    tune = max(2, round(0.62 * count))
    names = [f"A{i + 1}" if i < tune else f"B{i + 1 - tune}" for i in range(count)]
    lines = []
    for i, (name, run) in enumerate(zip(names, campaign.runs, strict=True)):
        table = record(campaign, i, campaign.stop(i, sizes), recorders, sizes.clock_offset)
        columns = np.column_stack(list(table.values()))
        np.savetxt(folder / f"{name}.csv", columns, delimiter=",", header=",".join(table), comments="", fmt="%.4f")
        believed = run.mu_cd * campaign.rng.uniform(0.9, 1.1)
        lines += [f"[runs.{name}]", f'file = "{name}.csv"', f"kinetic_friction_d = {believed:.4f}"]
        lines += ([f"start_position_m = {run.position_m:.2f}"] if recorders.starts_known else []) + [""]
    text = [*_head(campaign, recorders, folder.name, names[:tune], names[tune:]), *_contact(campaign.mu_cd), *lines]
    (folder / "campaign.toml").write_text("\n".join(text), encoding="utf-8")
    return {name: run.mu_cd for name, run in zip(names, campaign.runs, strict=True)}


def _head(campaign: Campaign, recorders: Recorders, name: str, tune: list[str], validate: list[str]) -> list[str]:
    vehicle = campaign.vehicle
    source = "measured" if recorders.torque == "measured" else "cylinder pressure times the nominal gain"
    return [
        "[campaign]",
        f'name = "{name}"',
        f"tune = {json.dumps(tune)}",
        f"validate = {json.dumps(validate)}",
        f"sample_time_s = {1 / recorders.rate_hz}",
        "",
        "[vehicle]",
        f"axles = {campaign.axles}",
        f"axle_positions_m = {[round(float(position), 2) for position in vehicle.positions_m]}",
        f"mass_kg = {vehicle.mass_kg}",
        f"wheel_radius_m = {vehicle.radius_m}",
        f"wheelset_inertia_kgm2 = {vehicle.inertia_kgm2}",
        f"gravity_mps2 = {GRAVITY_MPS2}",
        f'brake_torque_source = "{source}"',
        *([f"torque_per_bar_nm = {vehicle.torque_per_bar_nm}"] if recorders.torque == "pressure" else []),
        "",
    ]


def _contact(mu_cd: float) -> list[str]:
    return [
        "[contact]",
        f"semi_axis_a_m = {contact.SEMI_AXIS_A_M}",
        f"semi_axis_b_m = {contact.SEMI_AXIS_B_M}",
        f"kalker_c11 = {contact.KALKER_C11}",
        f"shear_modulus_pa = {contact.SHEAR_MODULUS_PA}",
        f"polach_k_ad = {contact.K_AD}",
        f"polach_k_sd = {contact.K_SD}",
        f"polach_k_ar = {contact.K_AR}",
        f"polach_k_sr = {contact.K_SR}",
        f"friction_ratio_d = {contact.RATIO}",
        f"friction_ratio_r = {contact.RATIO}",
        f"friction_decrease_d_spm = {contact.DECREASE_D_SPM}",
        f"friction_decrease_r_spm = {contact.DECREASE_R_SPM}",
        f"kinetic_friction_r = {contact.MU_CR}",
        f"kinetic_friction_d = {mu_cd:.3f}",
        "",
    ]
