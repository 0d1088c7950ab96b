"""One case becomes a campaign folder: drawn, driven, recorded, written; and its label."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from experiments.concealed import setup as believed
from experiments.concealed.effects import ALL, SENSOR_FAULTS, Place, library_names
from experiments.concealed.interest import drive, key
from experiments.concealed.plan import CONFOUNDED, Case
from experiments.concealed.records import PlannedStop
from experiments.concealed.sensors import SAMPLE_S
from experiments.concealed.setup import TUNE, VALIDATE, Setup, draw, torque_for


@dataclasses.dataclass(frozen=True)
class Concealed:
    """An effect as it is in one case."""

    name: str
    size: float  # in the effect's unit, signed
    multiple: float  # of the smallest effect of interest
    place: Place


def build(case: Case, seed: int, attempt: int, sizes: dict[str, float], shrink: float) -> tuple[Setup, list[Concealed]]:
    """Draw a case; attempts differ in everything drawn, `shrink` only in the sizes of the effects.

    Parameters
    ----------
    sizes : smallest sizes of interest, see `interest.sizes`

    """
    rng = np.random.default_rng([seed, case.index, attempt])
    setup = draw(rng, case.axles, case.noise, case.measured_torque)
    if case.recipe >= 0:
        setup = _arranged(setup, case)
    concealed = []
    for name in case.effects:
        effect = ALL[name]
        place = _place(setup, case, rng)
        sign = -1.0 if effect.signed and rng.random() < 0.5 else 1.0
        interest = sizes[key(name, place.variant)]
        size = sign * min(case.multiple * shrink * interest, effect.largest)
        setup = effect.apply(setup, size, place)
        concealed.append(Concealed(name, size, abs(size) / interest, place))
    return setup, concealed


def _place(setup: Setup, case: Case, rng: np.random.Generator) -> Place:
    """Choose an axle, and a stretch of track that several stops meet while they slide."""
    first = float(np.median([run.position + run.speed * (run.coast + 2.0) for run in setup.runs.values()]))
    track = first + float(rng.uniform(30.0, 200.0))
    return Place(int(rng.integers(case.axles)), track, float(rng.uniform(40.0, 90.0)), case.repeat)


def _arranged(setup: Setup, case: Case) -> Setup:
    recipe = CONFOUNDED[case.recipe]

    def arrange(run: PlannedStop) -> PlannedStop:
        changes: dict[str, Any] = {}
        if recipe.coast_s is not None:
            changes["coast"] = recipe.coast_s
        if recipe.speed_mps is not None:
            changes["speed"] = recipe.speed_mps
        if recipe.end_speed_mps is not None:
            changes["end_speed"] = recipe.end_speed_mps
        if recipe.demand is not None:
            changes["demand"] = torque_for(recipe.demand * setup.believed_mu_cd, setup.vehicle)
        return run._replace(**changes)

    return dataclasses.replace(setup, runs={name: arrange(run) for name, run in setup.runs.items()})


def write(folder: Path, case: Case, setup: Setup, seed: int, attempt: int) -> dict[str, float]:
    """Drive the runs and write campaign.toml and the tables; return the stopping distances [m] by run."""
    folder.mkdir(parents=True, exist_ok=True)
    driven = drive(setup, np.random.default_rng([seed, case.index, attempt, 1]))
    suffix = "parquet" if case.index % 2 else "csv"
    for name, (columns, _) in driven.items():
        frame = pl.DataFrame(columns)
        if suffix == "csv":
            frame.write_csv(folder / f"{name}.csv")
        else:
            frame.write_parquet(folder / f"{name}.parquet")
    (folder / "campaign.toml").write_text(_toml(case, setup, suffix), encoding="utf-8")
    return {name: distance for name, (_, distance) in driven.items()}


def _toml(case: Case, setup: Setup, suffix: str) -> str:
    source = "measured" if setup.measured_torque else "cylinder pressure times the nominal gain"
    positions = [float(x) for x in setup.vehicle.offset]
    head = f"""# What the test team believed; it may be incomplete.
[campaign]
name = "{case.name}"
tune = {json.dumps(TUNE)}
validate = {json.dumps(VALIDATE)}
sample_time_s = {SAMPLE_S}

[vehicle]
axles = {setup.axles}
axle_positions_m = {positions}
mass_kg = {believed.MASS_PER_AXLE_KG * setup.axles}
wheelset_inertia_kgm2 = {believed.INERTIA_KGM2}
wheel_radius_m = {believed.RADIUS_M}
gravity_mps2 = {believed.GRAVITY_MPS2}
brake_torque_source = "{source}"

[contact]
semi_axis_a_m = {believed.SEMI_AXIS_A_M}
semi_axis_b_m = {believed.SEMI_AXIS_B_M}
kalker_c11 = {believed.C11}
shear_modulus_pa = {believed.SHEAR_MODULUS_PA:.1f}
polach_k_ad = {believed.K_AD}
polach_k_sd = {believed.K_SD}
polach_k_ar = {believed.K_AR}
polach_k_sr = {believed.K_SR}
friction_ratio_d = {believed.RATIO}
friction_ratio_r = {believed.RATIO}
friction_decrease_d_spm = {believed.GAMMA_D_SPM}
friction_decrease_r_spm = {believed.GAMMA_R_SPM}
kinetic_friction_r = {believed.MU_CR}
kinetic_friction_d = {setup.believed_mu_cd}
"""
    runs = [
        f'\n[runs.{name}]\nfile = "{name}.{suffix}"\n'
        + (f"start_position_m = {run.position:.2f}\n" if case.start_positions else "")
        for name, run in setup.runs.items()
    ]
    return head + "".join(runs)


def label(
    case: Case, setup: Setup, concealed: list[Concealed], distances: dict[str, float], effect_m: dict[str, float]
) -> dict[str, Any]:
    """Return what is true of the case; `effect_m` are the distances that the same stops take without the effects."""
    moved = [distances[name] / effect_m[name] - 1.0 for name in distances]
    verdict = {"null": "adequate", "foreign": "discovered", "fault": "data"}.get(case.kind, "named")
    alien = [one for one in concealed if ALL[one.name].slots]
    return {
        "class": case.kind,
        "sensor_fault": any(name in SENSOR_FAULTS for name in case.effects),
        "verdict": verdict,
        "mechanisms": library_names(case.effects),
        "slots": [slot for one in alien for slot in ALL[one.name].slots],
        "slot_axles": [one.place.axle % case.axles + 1 for one in alien if ALL[one.name].on_axle],
        "effects": [
            {
                "name": one.name,
                "quantity": ALL[one.name].quantity,
                "size": one.size,
                "unit": ALL[one.name].unit,
                "multiple": one.multiple,
                **one.place._asdict(),
            }
            for one in concealed
        ],
        "why_confounded": CONFOUNDED[case.recipe].why if case.recipe >= 0 else "",
        "distance_change": float(np.mean(moved)),
        "fault": case.fault,
        "start_positions": case.start_positions,
        "noise": case.noise,
        "axles": case.axles,
        "measured_torque": case.measured_torque,
        "tau_m_per_J": setup.law.tau,
        "mu_cd": {name: run.mu_cd for name, run in setup.runs.items()},
    }
