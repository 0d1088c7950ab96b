"""Pictures and texts of a stop."""

import gymnasium as gym
import numpy as np
import pytest

from wsp_env.parameters.quantity import ParameterError


def after(mode, steps, env_id="wsp_env/Bogie-v1"):
    env = gym.make(env_id, render_mode=mode)
    env.reset(seed=0, options={"demand": 1.0})
    for _ in range(steps):
        env.step(np.full(env.action_space.shape, 2))
    return env


@pytest.mark.parametrize("env_id", ["wsp_env/Wheelset-v1", "wsp_env/Coach-v1"])
def test_picture_shows_the_stop_so_far(env_id):
    env = after("rgb_array", 30, env_id)
    picture = env.render()
    assert picture.shape == (600, 900, 3)
    assert picture.dtype == np.uint8
    assert 0.5 < (picture == 255).mean() < 0.99  # lines on white
    for _ in range(100):
        env.step(np.full(env.action_space.shape, 2))
    later = env.render()
    assert (later != picture).any()
    assert not np.shares_memory(later, picture)
    env.close()


def test_text_has_a_line_per_axle():
    env = after("ansi", 150, "wsp_env/Coach-v1")
    text = env.render()
    lines = text.splitlines()
    assert lines[0].startswith("t    3.00 s")
    assert len(lines) == 2 + 4
    _, rolling, slip, pressure, f, f_d, f_r = (float(word) for word in lines[2].split())
    info = env.unwrapped.batch.truth()
    assert rolling == pytest.approx(0.445 * info["wheel_speed_radps"][0, 0], abs=0.01)
    assert slip == pytest.approx(info["slip_speed_mps"][0, 0], abs=0.01)
    assert pressure == pytest.approx(info["pressure_bar"][0, 0], abs=0.01)
    assert f_d - 0.001 <= f <= f_r + 0.001


def test_window():
    """Without a display: matplotlib's backend that draws nowhere."""
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    env = after("human", 12)
    assert env.render() is None
    assert len(plt.get_fignums()) == 1
    env.close()
    assert not plt.get_fignums()
    plt.ioff()


def test_mode_must_be_known_and_given():
    with pytest.raises(ParameterError, match="render_mode 'gif' is unknown; valid: rgb_array, human, ansi"):
        gym.make("wsp_env/Bogie-v1", render_mode="gif")
    env = gym.make("wsp_env/Bogie-v1").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode='rgb_array'"):
        assert env.render() is None
    with pytest.raises(ParameterError, match="vector environments do not render"):
        gym.make_vec("wsp_env/Bogie-v1", num_envs=2, render_mode="rgb_array")


def test_pace_is_that_of_the_control_interval():
    assert gym.make("wsp_env/Bogie-v1", control_interval_s=0.05).metadata["render_fps"] == 20
