"""The plant's front door: a plant of somebody else brakes in the environments and under the test programme."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from thirty_lines import PointMass

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant import make_plant
from wsp_env.plant.port import Measurement, Setup, Stop, Truth

ELSEWHERE = "thirty_lines:PointMass"


def a_stop(vehicle, **changes):
    axles = {"radius": np.full(vehicle.axles, vehicle.wheel_radius_m), "profile": np.ones(1), "coverage": np.ones(1)}
    usual = {"mu_cd": 0.04, "tau": 1e-4, "initial_speed": 20.0, "mass": vehicle.mass_kg, "demand": 1.0, "gradient": 0.0}
    return Stop(**(usual | {"noise": 0.0, "key": 1} | axles | changes))


@pytest.mark.parametrize("name", ["longitudinal", pytest.param("multibody", marks=pytest.mark.long), ELSEWHERE])
def test_every_plant_keeps_the_contract_of_the_port(name):
    """Shapes, a vehicle that stands stays as it is, readings are copies, a stop leaves nothing behind."""
    plant = make_plant(COACH, 3, Setup(), name)
    for i in range(3):
        plant.start(i, a_stop(COACH, initial_speed=5.0 + i))
    assert plant.moving.all()
    first, command = plant.reading(), np.ones((3, 4))
    kept = first.wheel_speed.copy()
    for _ in range(3000):
        plant.step(command)
        if not plant.moving.any():
            break
    assert not plant.moving.any()
    np.testing.assert_array_equal(first.wheel_speed, kept)
    truth = plant.truth()
    assert isinstance(truth, Truth)
    assert isinstance(plant.reading(), Measurement)
    assert truth.position.shape == (3,)
    assert truth.slip_speed.shape == plant.preview().shape == (3, 4)
    assert (np.diff(truth.position) > 0.0).all()
    position = truth.position.copy()
    plant.step(command)
    np.testing.assert_array_equal(plant.truth().position, position)
    plant.start(1, a_stop(COACH))
    assert plant.truth().position[1] == plant.truth().time[1] == 0.0


def test_a_plant_of_somebody_else_brakes_in_the_environments():
    env = gym.make("wsp_env/Bogie-v1", plant=ELSEWHERE)
    assert isinstance(env.unwrapped.batch.plant, PointMass)
    env.reset(seed=1)
    ended = False
    while not ended:
        _, reward, terminated, truncated, info = env.step([2, 2])
        ended = terminated or truncated
    assert terminated
    assert reward < 0.0
    assert 0.0 < info["position_m"] < 4000.0
    again = gym.make(type(env.spec).from_json(env.spec.to_json()))
    assert isinstance(again.unwrapped.batch.plant, PointMass)


def test_a_plant_of_somebody_else_is_measured_with_a_controller():
    stops = [a_stop(BOGIE, mu_cd=mu) for mu in (0.02, 0.06)]
    record = run(load("rule-based"), BOGIE, stops, Conduct(plant=ELSEWHERE))
    assert record.stopped.all()
    assert record.distance[0] > record.distance[1]


@pytest.mark.long
def test_a_plant_of_somebody_else_runs_under_the_test_programme(tmp_path):
    """The command in a process of its own: it finds the plant by PYTHONPATH and hands it on to its workers."""
    words = ["evaluate", "--vehicle", "wheelset", "--plant", ELSEWHERE, "--controllers", "rule-based", "--cases", "low-120"]
    command = [sys.executable, "-m", "wsp_env", *words, "--draws", "1", "--out", str(tmp_path), "--json"]
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parent}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    answer = json.loads(result.stdout)
    assert answer["failures"] == []
    assert {stop["controller"] for stop in answer["stops"]} >= {"rule-based", "perfect-knowledge"}
    assert all(0.0 < stop["distance_m"] < 3000.0 for stop in answer["stops"])


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nowhere", "unknown plant 'nowhere'; valid: longitudinal, multibody, or package.module:Class"),
        ("nowhere:Plant", "cannot be loaded: No module named 'nowhere'; PYTHONPATH=. finds a module in this folder"),
        ("thirty_lines:Nothing", "cannot be loaded"),
        (":", "unknown plant ':'"),
        (".:x", "unknown plant '.:x'"),
        (5, "unknown plant 5"),
        ("os:path", "cannot be made: TypeError"),
        ("json:JSONDecoder", "cannot be made: TypeError"),
        ("builtins:print", "is none: it lacks vehicle, n, setup"),
    ],
)
def test_plants_that_are_not_there(name, says):
    with pytest.raises(ParameterError, match=says):
        make_plant(BOGIE, 1, Setup(), name)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"control_interval_s": 1e-9}, "control_interval_s = 1e-09 s is impossible"),
        ({"control_interval_s": "x"}, "control_interval_s = x s is impossible"),
        ({"track_step_m": -5.0}, "track_step_m = -5.0 m is impossible"),
        ({"track_nodes": 0}, "track_nodes = 0 is impossible"),
    ],
)
def test_setups_that_cannot_be(values, says):
    with pytest.raises(ParameterError, match=says):
        Setup(**values)


def test_a_stop_that_does_not_fit_the_vehicle_is_refused():
    plant = make_plant(BOGIE)
    for wrong in ({"radius": np.full(3, 0.445)}, {"profile": np.ones(0), "coverage": np.ones(0)}, {"profile": np.ones(2)}):
        with pytest.raises(ParameterError, match="one radius an axle, and as many nodes of profile as of coverage"):
            plant.start(0, a_stop(BOGIE, **wrong))


@pytest.mark.parametrize("by_pressure", [False, True])
def test_the_preview_is_what_the_commands_on_their_way_make(by_pressure):
    """With the distributor full and the demand constant the pressures to come are those that come, to rounding."""
    plant = make_plant(BOGIE, 1, Setup(pressure_control=by_pressure))
    plant.start(0, a_stop(BOGIE, mu_cd=0.2, initial_speed=40.0))
    rng = np.random.default_rng(3)
    for _ in range(300):  # the distributor fills
        plant.step(np.ones((1, 2)))
    dead = round(BOGIE.brake.dead_time_s / plant.setup.control_interval_s)
    for _ in range(20):
        plant.step(rng.uniform(0.0, 1.0, (1, 2)) if by_pressure else rng.choice([-1.0, 0.0, 1.0], (1, 2)))
        foreseen, further = plant.preview(), plant.preview(0.0)
        for _ in range(dead):
            plant.step(np.zeros((1, 2)))
        np.testing.assert_allclose(plant.truth().pressure, foreseen, rtol=1e-12, atol=1e-12)
        plant.step(np.zeros((1, 2)))
        np.testing.assert_allclose(plant.truth().pressure, further, rtol=1e-12, atol=1e-12)


def test_whole_numbers_of_a_vehicle_are_floats():
    """Another type would have the plant compiled anew."""
    whole = dataclasses.replace(BOGIE, axle_positions_m=(0, 2), wheelset_inertia_kgm2=160, resistance_a_n=100)
    assert all(type(value) is float for value in (*whole.axle_positions_m, whole.wheelset_inertia_kgm2, whole.resistance_a_n))
