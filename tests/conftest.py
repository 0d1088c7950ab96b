"""What all tests share: no time limit for random tests, and kernels that are compiled once before the tests begin."""

import gc
from collections.abc import Iterator

import gymnasium as gym
import pytest
from example_diagnosis import named_gradient
from hypothesis import settings

import agents  # noqa: F401  # before torch: its threads then sleep while they wait, and pytest's processes share the cores
from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.parameters.uic_z1 import VEHICLES

# Without a time limit, as the first call of a kernel may compile it.
settings.register_profile("wsp", deadline=None)
settings.load_profile("wsp")


@pytest.hookimpl(wrapper=True)
def pytest_sessionstart(session: pytest.Session) -> Iterator[None]:
    """Compile the plant for every vehicle, which pytest-xdist's workers would do each by itself.

    They are started first: they collect the tests meanwhile, and get none to run before this is done.
    """
    config = session.config
    starts_workers = config.getoption("numprocesses", None) and not hasattr(config, "workerinput")
    compiles = starts_workers and not config.option.collectonly
    envs = [gym.make(f"wsp_env/{name.capitalize()}-v1") for name in VEHICLES] if compiles else []
    yield
    for env in envs:
        env.reset(seed=0)
        env.step(env.action_space.sample())


@pytest.fixture(scope="module", autouse=True)
def _what_was_there_before_is_not_collected() -> None:
    """Spare the garbage collector what earlier modules left: the MDF4 reader calls it for every file, seconds at a time."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def found() -> Diagnosis:
    """Return a made-up diagnosis that names a gradient."""
    return named_gradient()
