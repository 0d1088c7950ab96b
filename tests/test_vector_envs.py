"""The vector environment: N single environments, computed at once, begun anew as they end."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_allclose, assert_array_equal

from wsp_env.envs import IDS
from wsp_env.parameters.quantity import ParameterError

ids = pytest.mark.parametrize("env_id", sorted(IDS))
SHORT = {"initial_speed": (0.5, 3.0), "mu_cd": (0.06, 0.09), "demand": (0.8, 1.0)}  # stops of a few seconds


def plain(info, i):
    """Info of stop i without the masks that Gymnasium adds, terms of the reward spread out."""
    terms = {name: value[i] for name, value in info["reward_terms"].items()}
    return {name: value[i] for name, value in info.items() if name[0] != "_" and name != "reward_terms"} | terms


@ids
@pytest.mark.parametrize("action", ["valve", "pressure"])
def test_stops_equal_single_ones_through_their_ends(env_id, action):
    """Stop i is the single environment of seed + i; where it ends, it goes on as the single one after reset()."""
    n = 3
    options = {"action": action, "scenario": SHORT, "time_limit_s": 5.0}
    vector = gym.make_vec(env_id, num_envs=n, **options)
    singles = [gym.make(env_id, **options) for _ in range(n)]
    observation, info = vector.reset(seed=40)
    for i, single in enumerate(singles):
        own, own_info = single.reset(seed=40 + i)
        assert_array_equal(observation[i], own)
        assert_allclose(info["speed_mps"][i], own_info["speed_mps"], rtol=0)
    vector.action_space.seed(3)
    ended, truncations = 0, 0
    last = None
    for step in range(550):
        if step % 25 == 0:
            last = vector.action_space.sample()
            last = np.maximum(last, 1 if action == "valve" else 0.2)
        observation, reward, terminated, truncated, info = vector.step(last)
        for i, single in enumerate(singles):
            own, own_reward, own_terminated, own_truncated, own_info = single.step(last[i])
            assert (terminated[i], truncated[i]) == (own_terminated, own_truncated)
            assert_allclose(reward[i], own_reward, rtol=1e-12, atol=1e-15)
            if own_terminated or own_truncated:
                ended += 1
                truncations += own_truncated
                assert_array_equal(info["final_obs"][i], own)
                final = plain(info["final_info"], i)
                own_terms = own_info.pop("reward_terms")
                for name, value in (own_info | own_terms).items():
                    assert_array_equal(final[name], value, err_msg=name)
                own, own_info = single.reset()
            assert_array_equal(observation[i], own)
            assert_array_equal(info["wheel_speed_radps"][i], own_info["wheel_speed_radps"])
    assert ended > truncations
    assert truncations > 0


@ids
def test_numbers_do_not_depend_on_size_or_order_of_the_batch(env_id):
    seeds = [5, 9, 1, 7, 3]
    actions = np.random.default_rng(0).integers(0, 3, size=(120, 5, gym.make(env_id).action_space.shape[0]))
    runs = []
    for order in ([0, 1, 2, 3, 4], [4, 2, 0, 3, 1], [2]):
        vector = gym.make_vec(env_id, num_envs=len(order))
        vector.reset(seed=[seeds[i] for i in order])
        trace = [vector.step(action[order])[:2] for action in actions]
        runs.append((order, np.array([step[0] for step in trace]), np.array([step[1] for step in trace])))
    _, observations, rewards = runs[0]
    for order, other, other_rewards in runs[1:]:
        assert_array_equal(other, observations[:, order])
        assert_array_equal(other_rewards, rewards[:, order])


@ids
def test_gymnasiums_own_vectorisation_agrees(env_id):
    ours = gym.make_vec(env_id, num_envs=3)
    theirs = gym.make_vec(env_id, num_envs=3, vectorization_mode="sync")
    assert_array_equal(ours.reset(seed=8)[0], theirs.reset(seed=8)[0])
    ours.action_space.seed(1)
    for _ in range(60):
        actions = ours.action_space.sample()
        one, other = ours.step(actions), theirs.step(actions)
        assert_array_equal(one[0], other[0])
        assert_allclose(one[1], other[1], rtol=1e-12)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space


def test_mode_of_autoreset_is_declared_and_kept():
    vector = gym.make_vec("wsp_env/Bogie-v1", num_envs=3, time_limit_s=0.4)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    start, _ = vector.reset(seed=0)
    actions = np.full((3, 2), 2)
    for step in range(20):
        observation, _, terminated, truncated, info = vector.step(actions)
        assert ("final_obs" in info) == (step == 19)
    assert truncated.all()
    assert not terminated.any()
    assert_array_equal(info["_final_obs"], True)
    assert_array_equal(info["time_s"], 0.0)  # a new stop ...
    assert_allclose(info["final_info"]["time_s"], 0.4)  # ... after the old one's last step
    assert not np.allclose(observation, start)  # with new conditions
    assert all(vector.single_observation_space.contains(row) for row in info["final_obs"])
    assert "final_obs" not in vector.step(actions)[4]


def test_observations_lie_in_the_space_and_are_never_handed_out_twice():
    vector = gym.make_vec("wsp_env/Coach-v1", num_envs=6, time_limit_s=1.0)
    given = [vector.reset(seed=0)[0]]
    for _ in range(80):
        observation, reward, terminated, truncated, _ = vector.step(vector.action_space.sample())
        assert vector.observation_space.contains(observation)
        assert reward.shape == terminated.shape == truncated.shape == (6,)
        assert reward.dtype == np.float64
        assert terminated.dtype == truncated.dtype == bool
        for before in given:
            assert not np.shares_memory(before, observation)
        given.append(observation)


def test_reset_options_for_all_or_each():
    vector = gym.make_vec("wsp_env/Wheelset-v1", num_envs=3)
    _, info = vector.reset(seed=0, options={"mu_cd": 0.05, "initial_speed": [20.0, 25.0, 30.0], "track": "constant"})
    assert_array_equal(info["mu_cd"], 0.05)
    assert_array_equal(info["speed_mps"], [20.0, 25.0, 30.0])
    with pytest.raises(ParameterError, match="2 values, expected one or 3"):
        vector.reset(options={"mu_cd": [0.05, 0.06]})


def test_seeds_for_each():
    vector = gym.make_vec("wsp_env/Wheelset-v1", num_envs=2)
    first, _ = vector.reset(seed=[4, 4])
    assert_array_equal(first[0], first[1])
    again, _ = vector.reset(seed=[None, 4])
    assert not np.array_equal(again[0], first[0])
    assert_array_equal(again[1], first[1])
    with pytest.raises(ValueError, match="3 seeds for 2 environments"):
        vector.reset(seed=[1, 2, 3])
