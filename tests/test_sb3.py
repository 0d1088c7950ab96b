"""Stable-Baselines3: its checker, the adaptor to its `VecEnv`, a short training."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import VecMonitor

from wsp_env.envs import IDS
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.parameters.quantity import ParameterError

ids = pytest.mark.parametrize("env_id", sorted(IDS))


@ids
@pytest.mark.parametrize("action", ["valve", "pressure"])
def test_their_checker_passes(env_id, action):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, action=action))


@ids
def test_adaptor_equals_the_vector_environment(env_id):
    n = 3
    options = {"time_limit_s": 2.5, "scenario": {"initial_speed": (0.2, 2.0), "mu_cd": (0.08, 0.09)}}
    adapted = BrakingVecEnv(env_id, n, **options)
    vector = gym.make_vec(env_id, num_envs=n, **options)
    adapted.seed(21)
    assert_array_equal(adapted.reset(), vector.reset(seed=21)[0])
    terminations = 0
    for _ in range(300):
        actions = np.full((n, *adapted.action_space.shape), 2)
        observation, reward, done, infos = adapted.step(actions)
        expected, expected_reward, terminated, truncated, info = vector.step(actions)
        assert_array_equal(observation, expected)
        assert_allclose(reward, expected_reward, rtol=1e-6)
        assert reward.dtype == np.float32
        assert_array_equal(done, terminated | truncated)
        for i in range(n):
            assert ("terminal_observation" in infos[i]) == done[i]
            if done[i]:
                assert_array_equal(infos[i]["terminal_observation"], info["final_obs"][i])
                assert infos[i]["TimeLimit.truncated"] is bool(truncated[i])
                assert infos[i]["position_m"] == info["final_info"]["position_m"][i]
                assert_allclose(infos[i]["reward_terms"]["air"], info["final_info"]["reward_terms"]["air"][i])
                terminations += terminated[i]
    assert terminations > 0


def test_seed_and_options_hold_for_one_reset():
    env = BrakingVecEnv("wsp_env/Bogie-v1", 2)
    env.seed(1)
    first = env.reset()
    second = env.reset()
    env.seed(1)
    assert_array_equal(env.reset(), first)
    assert not np.array_equal(first, second)
    env.set_options({"initial_speed": 30.0})
    assert_allclose(env.reset()[:, -2], 30.0 / 50.0)
    assert not np.allclose(env.reset()[:, -2], 30.0 / 50.0)


def test_what_their_interface_asks_for():
    env = BrakingVecEnv("wsp_env/Coach-v1", 3)
    assert env.num_envs == 3
    assert env.get_attr("num_envs", [0, 2]) == [3, 3]
    assert env.env_is_wrapped(VecMonitor) == [False] * 3
    assert len(env.env_method("reset", indices=[1])) == 1
    assert list(env.get_images()) == [None] * 3
    with pytest.raises(AttributeError, match="make the environment with other options"):
        env.set_attr("num_envs", 4)
    with pytest.raises(ParameterError, match="unknown environment 'Tram-v0'; valid: wsp_env/"):
        BrakingVecEnv("Tram-v0", 3)
    with pytest.raises(ParameterError, match="unknown environment option"):
        BrakingVecEnv("wsp_env/Coach-v1", 3, interval=0.1)
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("action", ["valve", "pressure"])
def test_ppo_trains(action):
    env = VecMonitor(BrakingVecEnv("wsp_env/Bogie-v1", 8, action=action, time_limit_s=2.0))
    model = PPO("MlpPolicy", env, n_steps=128, batch_size=256, n_epochs=2, seed=0, device="cpu")
    model.learn(2048)
    assert len(model.ep_info_buffer) >= 8
    action_, _ = model.predict(env.reset(), deterministic=True)
    env.step(action_)
