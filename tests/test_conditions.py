"""Replayed conditions: `gym.make(..., conditions=...)`."""

import gymnasium as gym
import numpy as np
import pytest

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.parameters.quantity import ParameterError

CONDITIONS = {
    "vehicle": {"mass_kg": 20_000.0, "brake": {"torque_per_bar_nm": 2000.0}},
    "stops": [
        {"name": "A1", "mu_cd": 0.03, "tau": 1e-4, "initial_speed": 30.0, "load": 0.0, "track": [1.0, 0.9]},
        {"name": "A2", "mu_cd": 0.04, "demand": 0.8},
    ],
}


def test_each_reset_draws_one_of_the_stops_and_the_rest_as_ever():
    env = gym.make("wsp_env/Bogie-v1", conditions=CONDITIONS)
    batch = env.unwrapped.batch
    assert batch.vehicle.brake.torque_per_bar_nm == 2000.0
    seen, speeds = set(), set()
    for seed in range(20):
        _, info = env.reset(seed=seed)
        seen.add(float(info["mu_cd"]))
        if info["mu_cd"] == 0.04:
            speeds.add(float(info["speed_mps"]))
            assert batch.plant.conditions.demand[0] == 0.8
        else:
            assert info["mass_kg"] == 20_000.0
            np.testing.assert_array_equal(batch.plant.conditions.profile[0, :3], [1.0, 0.9, 0.9])
    assert seen == {0.03, 0.04}
    assert len(speeds) > 3  # what a stop leaves out is drawn


def test_a_stop_is_chosen_by_name_or_number_and_a_pin_goes_before_it():
    env = gym.make("wsp_env/Bogie-v1", conditions=CONDITIONS)
    assert env.reset(options={"condition": "A1"})[1]["speed_mps"] == 30.0
    assert env.reset(options={"condition": 1})[1]["mu_cd"] == 0.04
    assert env.reset(options={"condition": "A1", "mu_cd": 0.05})[1]["mu_cd"] == 0.05
    vector = gym.make_vec("wsp_env/Bogie-v1", num_envs=3, conditions=CONDITIONS)
    _, info = vector.reset(options={"condition": ["A1", "A2", "A1"]})
    assert info["mu_cd"].tolist() == [0.03, 0.04, 0.03]


def test_single_and_vector_draw_the_same_stops():
    vector = gym.make_vec("wsp_env/Bogie-v1", num_envs=4, conditions=CONDITIONS)
    together, _ = vector.reset(seed=5)
    for index in range(4):
        env = gym.make("wsp_env/Bogie-v1", conditions=CONDITIONS)
        np.testing.assert_array_equal(env.reset(seed=5 + index)[0], together[index])


def test_the_specification_survives_json():
    env = gym.make("wsp_env/Bogie-v1", conditions=CONDITIONS)
    again = gym.make(type(env.spec).from_json(env.spec.to_json()))
    np.testing.assert_array_equal(again.reset(seed=3)[0], env.reset(seed=3)[0])


@pytest.mark.parametrize(
    ("conditions", "says"),
    [
        ({"stops": [{"mu": 0.1}]}, "unknown quantity mu; valid: name, mu_cd"),
        ({"stop": []}, "unknown key stop; valid: vehicle, stops"),
        ({"vehicle": {"weight": 1.0}}, "unknown conditions: vehicle parameter weight"),
        ("A1", "must be a dictionary"),
    ],
)
def test_wrong_conditions_are_refused_when_made(conditions, says):
    with pytest.raises(ParameterError, match=says):
        gym.make("wsp_env/Bogie-v1", conditions=conditions)


def test_an_unknown_stop_lists_the_known_ones():
    with pytest.raises(ParameterError, match="unknown condition 'B1'; valid: A1, A2"):
        gym.make("wsp_env/Bogie-v1", conditions=CONDITIONS).reset(options={"condition": "B1"})
    with pytest.raises(ParameterError, match="unknown reset option 'condition'"):
        gym.make("wsp_env/Bogie-v1").reset(options={"condition": "A1"})
