"""A mechanism of another package, tried in a process of its own by `test_mechanism_cards`: `further_mechanism.py FOLDER`.

The package is `rail_joints.py`, written by the test with the entry point that names it. What is found is printed as JSON.
"""

import dataclasses
import json
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
from plant_cases import a_stop
from synthetic_stops import MASS_KG, SAMPLE_S, write_campaign

from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.diagnosis.report import write_report
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.velim import CONTACT
from wsp_env.plant import make_plant
from wsp_env.plant.mechanisms.__main__ import table
from wsp_env.plant.port import Setup, Stop
from wsp_env.recordings import CampaignWarning, read_campaign

NAME = "rail_joints"
MU_CD, TAU = 0.06, 2e-4
DURATION_S, LEAST_MPS = 14.0, 5.0


def braked() -> float:
    """Return how much slower a bogie is after 5 s of full brake with the mechanism than without [m/s].

    The environment's plant brakes alone: its observer, compiled anew in this process as well, knows of no mechanism.
    """
    speeds = []
    for mechanisms in ({}, {NAME: {}}):
        batch = gym.make("wsp_env/Bogie-v1", mechanisms=mechanisms).unwrapped.batch
        batch.plant.start(0, a_stop(batch.vehicle))
        for _ in range(250):
            batch.plant.step(np.ones((1, batch.vehicle.axles)))
        speeds.append(float(batch.plant.truth().speed[0]))
    return speeds[0] - speeds[1]


def recorded(seed: int, speed_mps: float, mu_cd: float) -> dict[str, np.ndarray]:
    """Return the columns of a coach's stop under an ideal slip control, with the mechanism on the rail."""
    vehicle = dataclasses.replace(COACH, contact=CONTACT)
    plant = make_plant(vehicle, 1, Setup(SAMPLE_S, mechanisms={NAME: {}}, pressure_control=True))
    radius = np.full(vehicle.axles, vehicle.wheel_radius_m)
    plant.start(0, Stop(mu_cd, TAU, speed_mps, MASS_KG, 1.0, 0.0, 0.0, 0, radius, np.ones(1), np.ones(1)))
    load, full = MASS_KG * vehicle.gravity_mps2 / (2 * vehicle.axles), vehicle.full_brake_torque_nm
    rng, rows = np.random.default_rng(seed), []
    axle = np.arange(vehicle.axles)
    for i in range(int(DURATION_S / SAMPLE_S)):
        true = plant.truth()
        if true.speed[0] < LEAST_MPS:
            break
        wanted = 0.06 + 0.04 * np.sin(2.0 * np.pi * i * SAMPLE_S / (2.5 + 0.3 * axle) + axle)
        held = 2.0 * load * true.adhesion[0] * radius / full
        share = np.clip(held + 0.1 * (wanted * true.speed[0] - true.slip_speed[0]), 0.0, 1.0)
        torque = vehicle.brake.torque_per_bar_nm * true.pressure[0]
        rows.append((true.time[0], true.speed[0], *true.wheel_speed[0], *torque))
        plant.step(share[None])
    values = np.array(rows).T
    noise = (0.0, 0.01, *[0.02] * vehicle.axles, *[50.0] * vehicle.axles)
    values += np.array(noise)[:, None] * rng.standard_normal(values.shape)
    names = [f"axle{k + 1}_{what}" for what in ("wheel_speed_radps", "brake_torque_nm") for k in range(vehicle.axles)]
    return dict(zip(("time_s", "vehicle_speed_mps", *names), values, strict=True))


def diagnosed(folder: Path) -> Diagnosis:
    """Return the diagnosis of two such stops."""
    runs = {"A1": recorded(1, 35.0, MU_CD), "B1": recorded(2, 30.0, 1.1 * MU_CD)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        return diagnose(read_campaign(write_campaign(folder / "campaign", runs, ["A1"], ["B1"])))


if __name__ == "__main__":
    out = Path(sys.argv[1])
    found = diagnosed(out)
    write_report(out / "report.html", found)
    print(json.dumps({"slower_mps": braked(), "diagnosis": found.to_json(), "table": table()}))
