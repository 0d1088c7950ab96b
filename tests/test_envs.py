"""What every registered environment promises, one by one and in batches; in the manner of dm_control's suite_test."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import wsp_env
from wsp_env.envs import IDS
from wsp_env.envs.task import RewardWeights
from wsp_env.observer.estimate import full_brake
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.mechanisms import ALL
from wsp_env.plant.port import Measurement
from wsp_env.scenario import PINS

ids = pytest.mark.parametrize("env_id", sorted(IDS))
actions = pytest.mark.parametrize("action", ["valve", "pressure"])


def episode(env, seed, steps=150, options=None, keep=1):
    """Everything that an environment hands out in random steps, each action kept for `keep`: observations, rewards, infos."""
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed, options=options)
    observations, rewards, infos = [observation], [], [info]
    for i in range(steps):
        if i % keep == 0:
            action = env.action_space.sample()
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return observations, rewards, infos


def settle(env, seconds, action):
    """Repeat one action for a time; return the last step."""
    for _ in range(round(seconds / env.unwrapped.batch.task.control_interval_s)):
        last = env.step(action)
    return last


@ids
@actions
def test_gymnasiums_checker_passes(env_id, action, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, action=action).unwrapped)


@ids
@actions
def test_same_seed_same_episode(env_id, action):
    first, second = (episode(gym.make(env_id, action=action), 7) for _ in range(2))
    assert_array_equal(first[0], second[0])
    assert first[1] == second[1]
    other = episode(gym.make(env_id, action=action), 8)
    assert not np.array_equal(first[0][0], other[0][0])
    for info, again in zip(first[2], second[2], strict=True):
        for name, value in info.items():
            assert_array_equal(value, again[name], err_msg=name)


@ids
def test_reset_forgets_the_episode_before(env_id):
    env = gym.make(env_id)
    first = episode(env, 3, 60)
    episode(env, 4, 60)
    again = episode(env, 3, 60)
    assert_array_equal(first[0], again[0])
    assert first[1] == again[1]


@ids
def test_start_is_random_and_goes_on_being_so(env_id):
    env = gym.make(env_id)
    starts = [env.reset(seed=0 if i == 0 else None)[1] for i in range(12)]
    for name in ("speed_mps", "mu_cd", "tau_m_per_j", "mass_kg"):
        assert len({float(info[name]) for info in starts}) == 12, name


@ids
@actions
@pytest.mark.parametrize("pressure_sensors", [False, True])
def test_no_observation_is_constant_and_all_lie_in_the_space(env_id, action, pressure_sensors):
    env = gym.make(env_id, action=action, pressure_sensors=pressure_sensors)
    seen = np.array([observation for seed in range(3) for observation in episode(env, seed, 500, keep=40)[0]])
    assert seen.dtype == np.float32
    assert np.isfinite(seen).all()
    assert all(env.observation_space.contains(row) for row in seen)
    rail = 10 * VEHICLES[IDS[env_id]].axles + np.arange(9)  # only where wheels slide, see test_rail
    in_doubt = env.observation_space.shape[0] - 4  # only where all axles slide for long, see test_estimator
    assert (np.ptp(np.delete(seen, [*rail, in_doubt], axis=1), axis=0) > 1e-3).all()
    assert np.abs(seen).max() < env.observation_space.high[0]  # nothing is clipped in an ordinary episode


@ids
def test_no_array_is_handed_out_twice(env_id):
    observations, _, infos = episode(gym.make(env_id), 1, 8)
    arrays = [(-1, array) for array in observations]
    arrays += [(i, value) for i, info in enumerate(infos) for value in info.values() if isinstance(value, np.ndarray)]
    for i, (_, one) in enumerate(arrays):
        for _, other in arrays[:i]:
            assert not np.shares_memory(one, other)


@ids
def test_what_was_handed_out_can_be_spoilt(env_id):
    """Whoever writes into an observation or info must not change the stop."""
    clean, spoilt = gym.make(env_id), gym.make(env_id)
    clean.reset(seed=2)
    observation, info = spoilt.reset(seed=2)
    for _ in range(30):
        observation[:] = -99.0
        for value in info.values():
            if isinstance(value, np.ndarray):
                value[...] = 99
        expected = clean.step(clean.action_space.sample() * 0 + 2)
        observation, reward, _, _, info = spoilt.step(spoilt.action_space.sample() * 0 + 2)
        assert_array_equal(observation, expected[0])
        assert reward == expected[1]


@ids
def test_types_of_a_step(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert isinstance(observation, np.ndarray)
    assert type(reward) is float
    assert type(terminated) is bool
    assert type(truncated) is bool
    assert isinstance(info, dict)


@ids
@actions
def test_reward_is_the_sum_of_its_terms(env_id, action):
    _, rewards, infos = episode(gym.make(env_id, action=action), 5)
    for reward, info in zip(rewards, infos[1:], strict=True):
        assert set(info["reward_terms"]) == set(vars(RewardWeights()))
        assert_allclose(reward, sum(info["reward_terms"].values()), rtol=1e-12)
        assert all(term <= 0.0 for name, term in info["reward_terms"].items() if name != "rest_of_stop")


def test_reward_terms_are_what_their_names_say():
    weights = {"stopping_distance": 2.0, "time": 0.5, "slip": 1.5, "large_slip": 3.0, "locked_wheels": 4.0, "air": 5.0}
    env = gym.make("wsp_env/Bogie-v1", reward=weights, adhesion="classic")
    pins = {"mu_cd": 0.02, "demand": 1.0, "initial_speed": 30.0, "track": "constant"}
    info = start = env.reset(seed=0, options=pins)[1]
    totals = dict.fromkeys(vars(RewardWeights()), 0.0)
    locked = slid = 0.0
    for _ in range(500):
        info_before = info
        _, _, _, _, info = env.step([2, 1])  # the second axle never fills
        for name, term in info["reward_terms"].items():
            totals[name] += term
        travelled = info["position_m"] - info_before["position_m"]
        locked += travelled * info["locked"].mean()
        slid += np.maximum(info["slip_speed_mps"], 0.0).mean() * 0.02
        assert info["locked"].sum() <= 1
        assert_allclose(info["reward_terms"]["air"], -5.0 * (info["air_nl"] - info_before["air_nl"]), atol=1e-9)
    assert locked > 50.0
    assert_allclose(totals["stopping_distance"], -2.0 * info["position_m"], rtol=1e-9)
    assert_allclose(totals["time"], -0.5 * 10.0, rtol=1e-9)
    assert_allclose(totals["locked_wheels"], -4.0 * locked, rtol=1e-9)
    assert_allclose(totals["slip"], -1.5 * slid, rtol=1e-9)
    # A locked wheel slides with the vehicle's speed: beyond the limit by 0.7 of it, on one of two axles.
    assert_allclose(info["reward_terms"]["large_slip"], -3.0 * 0.7 / 2 * info["speed_mps"] * 0.02, rtol=1e-6)
    # What is paid for the speed lost: metres and seconds of the rest of a dry stop with all brakes, wheelsets turning.
    bogie = VEHICLES["bogie"]
    rotating = 2 * bogie.wheelset_inertia_kgm2 / bogie.wheel_radius_m**2
    dry = 2 * bogie.full_brake_torque_nm / bogie.wheel_radius_m / (start["mass_kg"] + rotating)
    lost = [v * v / (2.0 * dry) * 2.0 + v / dry * 0.5 for v in (start["speed_mps"], info["speed_mps"])]
    assert_allclose(totals["rest_of_stop"], lost[0] - lost[1], rtol=1e-9)


def test_weights_are_parameters():
    env = gym.make("wsp_env/Wheelset-v1", reward=dict.fromkeys(vars(RewardWeights()), 0.0))
    assert all(reward == 0.0 for reward in episode(env, 0, 50)[1])


@ids
def test_observation_is_built_from_measurements_and_own_commands_alone(env_id):
    env = gym.make(env_id)
    batch = env.unwrapped.batch
    observer = Observer(batch.vehicle, 0.02)
    observation, _ = env.reset(seed=11)
    assert_array_equal(observer.reset(batch.measurement())[0], observation)
    for _ in range(60):
        action = env.action_space.sample()
        observation = env.step(action)[0]
        assert_array_equal(observer.observe(batch.measurement(), action[None] - 1.0)[0], observation)
    assert set(Measurement._fields) == {"time", "wheel_speed", "demand", "pressure"}
    assert batch.measurement().pressure is None


@ids
def test_hidden_conditions_show_only_through_the_wheels(env_id):
    """Rolling freely, conditions that no sensor measures leave no trace in the observation."""
    seen = []
    for mu_cd, tau, load in ((0.02, 1e-4, 0.0), (0.09, 4e-4, 1.0)):
        env = gym.make(env_id)
        pins = {"mu_cd": mu_cd, "tau": tau, "load": load, "initial_speed": 30.0, "demand": 0.0, "sensor_noise": 0.0}
        env.reset(seed=1, options=pins)
        seen.append([env.step(env.action_space.sample() * 0)[0] for _ in range(40)])
    assert_allclose(seen[0], seen[1], atol=1e-6)


@ids
def test_pressures_are_seen_only_where_they_are_measured(env_id):
    vehicle = VEHICLES[IDS[env_id]]
    without, with_ = gym.make(env_id), gym.make(env_id, pressure_sensors=True)
    axles = vehicle.axles
    assert without.observation_space.shape == with_.observation_space.shape == (10 * axles + 14,)
    assert not without.unwrapped.batch.measurement().pressure
    without.reset(seed=0)
    with_.reset(seed=0)
    for _ in range(40):
        action = without.action_space.sample()
        blind, sighted = without.step(action)[0], with_.step(action)
        share = sighted[4]["pressure_bar"] / vehicle.brake.full_pressure_bar * full_brake(vehicle) / 0.1
        assert_allclose(sighted[0][3 * axles : 4 * axles], share, rtol=1e-6)
        assert_allclose(blind[3 * axles : 4 * axles], share, atol=0.01)  # estimated from the commands


@ids
def test_classic_law_is_no_recovery(env_id):
    classic = gym.make(env_id, adhesion="classic")
    pinned = gym.make(env_id)
    one, other = episode(classic, 6, 200), episode(pinned, 6, 200, {"tau": 0.0})
    assert_array_equal(one[0], other[0])
    assert all(info["tau_m_per_j"] == 0.0 for info in one[2])
    for info in one[2][1:]:
        sliding = np.abs(info["slip_speed_mps"]) > 0.1
        assert_allclose(info["adhesion"][sliding], info["adhesion_d"][sliding], rtol=1e-12)


@ids
def test_pins_hold(env_id):
    vehicle = VEHICLES[IDS[env_id]]
    env = gym.make(env_id)
    pins = {"mu_cd": 0.033, "tau": 1.2e-4, "initial_speed": 27.0, "load": 0.25, "demand": 0.8, "gradient": 0.004}
    pins |= {"sensor_noise": 0.05, "track": "varying"}
    assert set(pins) == set(PINS)
    observation, info = env.reset(seed=0, options=pins)
    assert info["mu_cd"] == 0.033
    assert info["tau_m_per_j"] == 1.2e-4
    assert_allclose(info["speed_mps"], 27.0)
    assert_allclose(info["mass_kg"], vehicle.mass_kg + 0.25 * vehicle.payload_kg)
    assert_allclose(observation[-1], 0.8 * full_brake(vehicle) / 0.1, rtol=1e-6)
    conditions = env.unwrapped.batch.plant.conditions
    assert conditions.gradient[0] == 0.004
    assert conditions.noise[0] == 0.05
    assert 0.005 < conditions.profile[0].std() < 0.05
    _, info = env.reset(seed=0)
    assert info["mu_cd"] != 0.033  # a pin holds for one episode


@ids
def test_vehicle_brakes_to_standstill(env_id):
    env = gym.make(env_id)
    env.reset(seed=0, options={"mu_cd": 0.09, "initial_speed": 22.0, "demand": 1.0, "track": "constant"})
    action = np.full(env.action_space.shape, 2)
    for _ in range(5000):
        _, _, terminated, truncated, info = env.step(action)
        assert not truncated
        if terminated:
            break
    assert terminated
    assert info["speed_mps"] == 0.0
    assert_allclose(info["wheel_speed_radps"], 0.0)
    assert 22.0**2 / 2 / 1.2 < info["position_m"] < 600.0  # no shorter than full braking from the first moment


@ids
@pytest.mark.parametrize(("limit", "steps"), [({"time_limit_s": 1.0}, 50), ({"track_limit_m": 59.9}, 100)])
def test_limits_truncate(env_id, limit, steps):
    env = gym.make(env_id, **limit)
    env.reset(seed=0, options={"initial_speed": 30.0, "demand": 0.0})
    taken, truncated = 0, False
    while not truncated:
        _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=int))
        assert not terminated
        taken += 1
    assert taken == steps
    assert info["time_s"] >= 1.0 - 1e-9 or info["position_m"] >= 59.9


@pytest.mark.parametrize("interval", [0.01, 0.04, 0.05, 0.1])
def test_interval_in_seconds_keeps_the_brake_as_it_is(interval):
    """Commands given at the same times act at the same times, whatever the number of steps between them."""
    pressures = []
    for step in (0.02, interval):
        env = gym.make("wsp_env/Bogie-v1", control_interval_s=step)
        env.reset(seed=0, options={"mu_cd": 0.09, "demand": 0.6, "initial_speed": 30.0, "track": "constant"})
        settle(env, 4.0, [2, 2])
        info = settle(env, 0.2, [0, 2])[4]
        assert_allclose(info["time_s"], 4.2, rtol=1e-9)
        pressures.append(info["pressure_bar"])
    assert_allclose(pressures[1], pressures[0], rtol=2e-3)


def test_pressure_action_spans_none_to_the_demand():
    env = gym.make("wsp_env/Bogie-v1", action="pressure")
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    env.reset(seed=0, options={"mu_cd": 0.09, "demand": 0.5, "initial_speed": 40.0, "track": "constant"})
    settle(env, 4.0, [1.0, 1.0])
    full = VEHICLES["bogie"].brake.full_pressure_bar
    assert_allclose(settle(env, 2.0, [1.0, -1.0])[4]["pressure_bar"], [0.5 * full, 0.0], atol=1e-3)
    assert_allclose(settle(env, 2.0, [0.0, -0.5])[4]["pressure_bar"], [0.25 * full, 0.125 * full], atol=1e-3)
    assert_allclose(settle(env, 2.0, [9.0, -9.0])[4]["pressure_bar"], [0.5 * full, 0.0], atol=1e-3)  # clipped to the box


def test_valve_action_vents_holds_and_applies():
    env = gym.make("wsp_env/Coach-v1")
    assert env.action_space == gym.spaces.MultiDiscrete([3, 3, 3, 3])
    env.reset(seed=0, options={"mu_cd": 0.09, "demand": 0.5, "initial_speed": 40.0, "track": "constant"})
    before = settle(env, 3.0, [2, 2, 2, 2])[4]["pressure_bar"]
    settle(env, 0.1, [0, 1, 2, 0])
    after = settle(env, 1.0, [0, 1, 2, 1])[4]["pressure_bar"]
    assert after[0] < 0.01
    assert_allclose(after[1], before[1], rtol=1e-3)
    assert after[2] >= before[2]
    assert 0.1 < after[3] < before[3]


@ids
def test_spec_survives_json(env_id):
    options = {
        "action": "pressure", "control_interval_s": 0.05, "mechanisms": {"load_transfer": {"body_height_m": 1.2}},
        "scenario": {"mu_cd": (0.03, 0.05), "tracks": ("varying",)}, "reward": {"air": 0.0}, "vehicle": {"mass_kg": 20_000.0},
    }  # fmt: skip
    env = gym.make(env_id, **options)
    spec = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    again = gym.make(spec)
    first, second = episode(env, 1, 30), episode(again, 1, 30)
    assert_array_equal(first[0], second[0])
    assert first[1] == second[1]


@ids
def test_environment_is_made_without_importing_the_package_by_hand(env_id):
    env = gym.make(f"wsp_env:{env_id}")
    assert env.unwrapped.batch.vehicle == VEHICLES[IDS[env_id]]
    assert wsp_env.envs.IDS[env_id] == IDS[env_id]


@pytest.mark.parametrize("name", sorted(ALL))
def test_every_mechanism_can_be_switched_on(name):
    env = gym.make("wsp_env/Coach-v1", mechanisms={name: {}})
    observations, rewards, _ = episode(env, 0, 100)
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()


@ids
@given(seed=st.integers(0, 2**31 - 1))
@settings(max_examples=5)
def test_any_seed_gives_a_sound_episode(env_id, seed):
    observations, rewards, infos = episode(gym.make(env_id), seed, 200)
    assert np.isfinite(observations).all()
    assert np.isfinite(rewards).all()
    for info in infos:
        assert np.abs(info["adhesion"]).max() <= 0.28 / 0.4
        assert (info["wheel_speed_radps"] >= 0.0).all()
        assert (info["pressure_bar"] >= 0.0).all()
