"""Options and pins that cannot be: refused when the environment is made or reset, in one sentence."""

import math

import gymnasium as gym
import numpy as np
import pytest

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.parameters.quantity import ParameterError

BOGIE = "wsp_env/Bogie-v1"

OPTIONS = [
    ({"scenario": {"demand": (0.5, 2.0)}}, "demand = .* must lie in"),
    ({"scenario": {"mu_cd": (0.02, 0.5)}}, "beyond kinetic_friction_r"),
    ({"scenario": {"load": (0.0, 1.5)}}, "load = .* must lie in"),
    ({"scenario": {"gradient": (-0.5, 0.5)}}, "gradient = .* must lie in"),
    ({"scenario": {"tau": (0.0, 5.0)}}, "tau = .* must lie in"),
    ({"scenario": {"tracks": "constant"}}, "must be a list of some of constant"),
    ({"scenario": {"variation": "a"}}, "variation = 'a' is impossible"),
    ({"vehicle": {"contact": {"kinetic_friction_r": 0.07}}}, "beyond kinetic_friction_r"),
    ({"vehicle": {"brake": 3}}, "brake = 3 must be a dictionary"),
    ({"slide_limit_speed_mps": math.nan}, "slide_limit_speed_mps = nan is impossible"),
    ({"slide_limit_speed_mps": -1.0}, "slide_limit_speed_mps = -1.0 is impossible"),
    ({"track_limit_m": 1e12}, "track_limit_m = 1000000000000.0 is impossible"),
    ({"pressure_sensors": "no"}, "must be True or False"),
    ({"no_such_option": None}, "unknown environment option no_such_option; valid: action"),
    ({"mechanisms": {"load_transfer": 0.5}}, "must be a dictionary of any of body_height_m"),
    ({"conditions": {"stops": 3}}, "must be a list of dictionaries"),
]

PINS = [
    ([1], "must be a dictionary"),
    ({"track": []}, "empty list"),
    ({"track": "gravel"}, "unknown track 'gravel'; valid: constant"),
    ({"track": ["much", "little"]}, "has 2 values, expected one or 1"),
    ({"sensor_noise": -1.0}, "sensor_noise = -1 is impossible"),
    ({"tau": 2.0}, r"tau = 2 is impossible: it must lie in \[0, 1\] m/J"),
]


@pytest.mark.parametrize(("options", "says"), OPTIONS)
def test_an_option_that_cannot_be_is_refused_when_made(options, says):
    with pytest.raises(ParameterError, match=says):
        gym.make(BOGIE, **options)


@pytest.mark.parametrize(("pins", "says"), PINS)
def test_a_pin_that_cannot_be_is_refused_at_reset(pins, says):
    with pytest.raises(ParameterError, match=says):
        gym.make(BOGIE).unwrapped.reset(seed=0, options=pins)


def test_a_profile_along_the_track_is_one_for_all_or_one_for_each():
    def profile(env, options):
        env.reset(seed=0, options=options)
        return env.unwrapped.batch.plant.conditions.profile[:, :3].tolist()

    assert profile(gym.make(BOGIE), {"track": [1.0, 0.5, 0.2]}) == [[1.0, 0.5, 0.2]]
    vector = gym.make_vec(BOGIE, num_envs=2)
    assert profile(vector, {"track": [1.0, 0.5]}) == [[1.0, 0.5, 0.5]] * 2
    assert profile(vector, {"track": ["constant", [1.0, 0.5, 0.2]]}) == [[1.0, 1.0, 1.0], [1.0, 0.5, 0.2]]


def test_stable_baselines_pins_every_stop_by_itself_or_not_at_all():
    batch = BrakingVecEnv(BOGIE, 3)
    batch.set_options([{"mu_cd": 0.03}, {"mu_cd": 0.05}, {"mu_cd": 0.06}])
    batch.reset()
    np.testing.assert_array_equal(batch.env.batch.plant.conditions.mu_cd, [0.03, 0.05, 0.06])
    batch.set_options([{"mu_cd": 0.03}, {}, {}])
    with pytest.raises(ParameterError, match="every stop must pin the same"):
        batch.reset()


def test_nothing_is_drawn_before_a_stop_has_begun():
    with pytest.raises(RuntimeError, match="render before reset"):
        gym.make(BOGIE, render_mode="ansi").unwrapped.render()
