"""The runner of a policy folder: sees what the environment sees, runs without torch, refuses what does not fit."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from onnx import TensorProto, helper

from baselines.adaptive import AdaptiveController
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.evaluate import evaluate
from wsp_env.evaluation.policy import (
    CONTRACT,
    CONTRACT_VERSION,
    NETWORK,
    OUTPUTS,
    Contract,
    Policy,
    describe_measurement,
    describe_observation,
    load_policy,
    observer_constants,
)
from wsp_env.evaluation.programme import read_programme
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH, WHEELSET
from wsp_env.plant.port import Measurement, Stop


def contract(**changes):
    values = {
        "contract": CONTRACT_VERSION,
        "wsp_env": "0.1.0",
        "vehicle": "bogie",
        "axles": 2,
        "control_interval_s": 0.02,
        "action": "valve",
        "pressure_sensors": False,
        "measurement": describe_measurement(2, False),
        "observation": describe_observation(2, False),
        "observer": observer_constants(),
        "output": OUTPUTS,
        "limits": {},
        "training": {},
        "sha256": "",
    }
    return values | changes


def network(axles=2):
    """A network written by hand: the command of an axle is 1 where its estimated creepage is below 0.05, else -1."""
    size = len(describe_observation(axles, False))
    first = axles  # after the slips
    nodes = [
        helper.make_node("Slice", ["observation", "first", "last", "axis"], ["creepage"]),
        helper.make_node("Sub", ["limit", "creepage"], ["raw"]),
        helper.make_node("Sign", ["raw"], ["command"]),
    ]
    inputs = [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", size])]
    outputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", axles]) for name in OUTPUTS]
    numbers = {"first": first, "last": first + axles, "axis": 1}
    constants = [helper.make_tensor(name, TensorProto.INT64, [1], [value]) for name, value in numbers.items()]
    constants.append(helper.make_tensor("limit", TensorProto.FLOAT, [1], [0.05]))
    graph = helper.make_graph(nodes, "rule", inputs, outputs, constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9).SerializeToString()


def write(folder, content=None, **changes):
    content = network() if content is None else content
    (folder / NETWORK).write_bytes(content)
    values = contract(**({"sha256": hashlib.sha256(content).hexdigest()} | changes))
    (folder / CONTRACT).write_text(json.dumps(values))
    return str(folder)


def stop(**changes):
    values = {
        "mu_cd": 0.03, "tau": 2e-4, "initial_speed": 12.0, "mass": BOGIE.mass_kg, "demand": 1.0, "gradient": 0.0, "noise": 0.05,
        "key": 3, "radius": np.full(2, BOGIE.wheel_radius_m), "profile": np.ones(400), "coverage": np.ones(400),
    }  # fmt: skip
    return Stop(**(values | changes))


def test_a_folder_is_a_controller_and_does_what_its_network_says(tmp_path):
    policy = load(write(tmp_path))
    result = run(policy, BOGIE, [stop(), stop(mu_cd=0.05, initial_speed=15.0)])
    assert result.stopped.all()
    assert set(np.unique(result.command)) == {-1.0, 1.0}


def test_it_sees_what_the_environment_shows(tmp_path):
    """The command of the runner is the network's answer to the observation of the environment of the same stop."""
    environment = gym.make("wsp_env/Bogie-v1").unwrapped
    observation, _ = environment.reset(seed=4)
    policy = load_policy(write(tmp_path), guarded=False)
    policy.reset(1, BOGIE)
    done = False
    for _ in range(1500):
        expected = np.sign(np.float32(0.05) - observation[2:4])
        command = policy.act(environment.batch.measurement())[0]
        np.testing.assert_array_equal(command, expected)
        if done:
            break
        observation, _, terminated, truncated, _ = environment.step((command + 1.0).astype(int))
        done = terminated or truncated


def test_it_runs_without_torch(tmp_path):
    write(tmp_path)
    code = (
        "import sys; sys.modules['torch'] = None; sys.modules['stable_baselines3'] = None\n"
        "from wsp_env.evaluation.policy import load_policy\n"
        f"policy = load_policy({str(tmp_path)!r})\n"
        "assert 'pickle' not in vars(sys.modules['wsp_env.evaluation.policy'])\n"
        "print(policy.contract.vehicle)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "bogie"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"contract": CONTRACT_VERSION + 1}, "version 2"),
        ({"axles": 3}, "3 axles"),
        ({"axles": 1}, "1 axles, a bogie has 2"),
        ({"vehicle": "coach"}, "2 axles, a coach has 4"),
        ({"vehicle": "tram"}, "'tram'; valid: wheelset"),
        ({"measurement": describe_measurement(2, False)[::-1]}, r"measurement.* entry 1: .*'demand'.*, not .*'time'"),
        ({"observation": describe_observation(2, False)[:-1]}, "observation.* entry 34: None, not"),
        ({"control_interval_s": 0.0}, "control interval"),
        ({"control_interval_s": "fast"}, "control interval"),
        ({"action": "magnet"}, "magnet"),
        ({"pressure_sensors": True}, "measurement.* entry 4: None, not .*'pressure'"),
        ({"vehicle": ["bogie"]}, r"\['bogie'\], not of the kind str"),
        ({"axles": 2.0}, "not of the kind int"),
        ({"measurement": None}, "not of the kind list"),
        ({"observation": 3}, "not of the kind list"),
        ({"observer": [1]}, "not of the kind dict"),
        ({"pressure_sensors": "yes"}, "'yes'; valid: true, false"),
        ({"observer": observer_constants() | {"SPEED_SCALE": 40.0}}, r"observer.*: SPEED_SCALE: 40.0, not 50.0$"),
        ({"sha256": "0" * 64}, "sha256"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_contracts_that_do_not_fit_are_refused(tmp_path, changes, said):
    with pytest.raises(ParameterError, match=said):
        load(write(tmp_path, **changes))


def test_what_is_no_policy_is_refused(tmp_path):
    with pytest.raises(ParameterError, match=r"contract\.json cannot be read"):
        load(str(tmp_path))
    write(tmp_path)
    (tmp_path / CONTRACT).write_text("{")
    with pytest.raises(ParameterError, match="not JSON"):
        load_policy(tmp_path)
    (tmp_path / CONTRACT).write_text("[1]")
    with pytest.raises(ParameterError, match="lacks"):
        load_policy(tmp_path)
    write(tmp_path, content=b"no network")
    with pytest.raises(ParameterError, match=r"policy\.onnx is refused: it is damaged"):
        load_policy(tmp_path)
    write(tmp_path, content=network(axles=1))
    with pytest.raises(ParameterError, match="expected observation"):
        load_policy(tmp_path)
    write(tmp_path)
    (tmp_path / NETWORK).unlink()
    with pytest.raises(ParameterError, match=r"policy\.onnx cannot be read"):
        load_policy(tmp_path)
    with pytest.raises(ParameterError, match="no parameters"):
        load(write(tmp_path), {"gain": 1.0})


@pytest.mark.parametrize("vehicle", [WHEELSET, COACH])
def test_another_vehicle_is_refused(tmp_path, vehicle):
    with pytest.raises(ParameterError, match="2 axles"):
        load(write(tmp_path)).reset(1, vehicle)


def test_another_interval_is_refused(tmp_path):
    with pytest.raises(ParameterError, match=r"every 0\.02 s, but its measurements come every 0\.01 s"):
        run(load(write(tmp_path)), BOGIE, [stop()], Conduct(control_interval_s=0.01))


def test_a_programme_refuses_what_does_not_fit_before_anything_is_computed(tmp_path):
    folder = write(tmp_path)
    programme = read_programme()
    with pytest.raises(ParameterError, match=r"2 axles of a bogie, .* has 4"):
        evaluate({folder: {}}, programme, programme.cases, COACH, tmp_path / "out")
    seeing = tmp_path / "seeing"
    seeing.mkdir()
    described = {"measurement": describe_measurement(2, True), "observation": describe_observation(2, True)}
    with pytest.raises(ParameterError, match="cylinder pressures"):
        evaluate({write(seeing, pressure_sensors=True, **described): {}}, programme, programme.cases, BOGIE, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_missing_sensor_is_said():
    values = contract(
        pressure_sensors=True, measurement=describe_measurement(2, True), observation=describe_observation(2, True)
    )
    policy = Policy(Contract(**values), lambda observation, memory: (np.ones((len(observation), 2)), memory))
    policy.reset(1, BOGIE)
    measurement = Measurement(np.zeros(1), np.full((1, 2), 50.0), np.ones(1))
    with pytest.raises(ParameterError, match="cylinder pressures"):
        policy.act(measurement)
    assert policy.act(measurement._replace(pressure=np.ones((1, 2)))).shape == (1, 2)


def always_applying():
    return Policy(Contract(**contract()), lambda observation, memory: (np.ones((len(observation), 2)), memory))


def decide_thrice(controller, measurement, start_s):
    for decision in range(3):
        controller.act(measurement._replace(time=np.full(1, start_s + 0.02 * decision)))


@pytest.mark.parametrize("controller", [always_applying, AdaptiveController])
@pytest.mark.parametrize(
    ("measurement", "complaint"),
    [
        (Measurement(np.zeros(1), np.full((1, 4), 50.0), np.ones(1)), r"reset for 1 stops of 2 axles: \(1, 2\)"),
        (Measurement(np.zeros(1), np.full((50, 2), 50.0), np.ones(1)), r"wheel_speed has shape \(50, 2\)"),
        (Measurement(np.zeros(1), np.full(2, 50.0), np.ones(1)), r"wheel_speed has shape \(2,\)"),
        (Measurement(np.zeros(1), np.full((1, 2), 50.0), np.ones(2)), r"demand has shape \(2,\)"),
        (Measurement(np.zeros(1), np.full((1, 2), 50.0), np.array([100.0])), "demand must lie between 0"),
        (Measurement(np.zeros(1), np.full((1, 2), 50.0), np.array([np.nan])), "demand must lie between 0"),
    ],
)
def test_measurements_of_another_vehicle_are_refused_before_compiled_code_sees_them(controller, measurement, complaint):
    """At the first decisions and at a later one; a number of axles or stops too many wrote beyond the ends of arrays."""
    sound = Measurement(np.zeros(1), np.full((1, 2), 50.0), np.ones(1))
    for decisions in (0, 5):
        made = controller()
        made.reset(1, BOGIE)
        for decision in range(decisions):
            made.act(sound._replace(time=np.full(1, 0.02 * decision)))
        with pytest.raises(ValueError, match=complaint):
            decide_thrice(made, measurement, 0.02 * decisions)


@pytest.mark.parametrize("controller", [always_applying, AdaptiveController])
def test_who_decides_before_a_stop_begins_is_told(controller):
    with pytest.raises(ParameterError, match="call reset"):
        controller().act(Measurement(np.zeros(1), np.full((1, 2), 50.0), np.ones(1)))


@pytest.mark.parametrize("sensors", [False, True])
@pytest.mark.parametrize("vehicle", [WHEELSET, BOGIE, COACH])
def test_the_description_of_an_observation_has_its_length(vehicle, sensors):
    env = gym.make(f"wsp_env/{vehicle.name.title()}-v1", pressure_sensors=sensors)
    assert env.observation_space.shape == (len(describe_observation(vehicle.axles, sensors)),)


def test_shipped_networks_do_not_tell_where_they_were_made():
    networks = sorted((Path(__file__).parents[1] / "agents" / "trained").glob("*/policy.onnx"))
    assert networks
    assert not any(b'File "' in network.read_bytes() for network in networks)
