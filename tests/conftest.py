"""What all tests share: no time limit for random tests, and kernels that are compiled once before the tests begin."""

import gc

import gymnasium as gym
import pytest
from hypothesis import settings

import agents  # noqa: F401  # before torch: its threads then sleep while they wait, and pytest's processes share the cores
from wsp_env.parameters.uic_z1 import VEHICLES

# Without a time limit, as the first call of a kernel may compile it.
settings.register_profile("wsp", deadline=None)
settings.load_profile("wsp")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the plant for every vehicle before pytest-xdist starts its workers, each of which would do it by itself."""
    starts_workers = config.getoption("numprocesses", None) and not hasattr(config, "workerinput")
    if starts_workers and not config.option.collectonly:
        for name in VEHICLES:
            env = gym.make(f"wsp_env/{name.capitalize()}-v0")
            env.reset(seed=0)
            env.step(env.action_space.sample())


@pytest.fixture(scope="module", autouse=True)
def _what_was_there_before_is_not_collected() -> None:
    """Spare the garbage collector what earlier modules left: the MDF4 reader calls it for every file, seconds at a time."""
    gc.collect()
    gc.freeze()
