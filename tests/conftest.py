"""What all tests share: no time limit for random tests, and kernels that are compiled once before the tests begin."""

import gc
import os
from collections.abc import Iterator
from typing import Any

# Before numpy is loaded, and for the processes that tests start, too: the matrices are small, and pytest's processes share the
# cores. Where these were busy, a stop took twenty times as long to prepare with two threads of BLAS as with one.
os.environ |= {name: os.environ.get(name, "1") for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}

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


#: Files that take half a minute and more, the longest first. They are begun first: one begun last would keep a process waiting.
LONG = (
    "test_diagnosis.py",
    "test_concealed_proof.py",
    "test_mechanism_cards.py",
    "test_practice_mechanisms.py",
    "test_diagnosis_actuator.py",
    "test_suspect.py",
    "test_estimator.py",
    "test_package.py",
    "test_evaluation.py",
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Let one process run all tests of a file, whatever `--dist` says: what a file's tests share is then made once.

    Marks of groups cannot do that: pytest-xdist 3.8 loses them under pytest 9.2 and says nothing (its issue 1386).
    """
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # in the order of the collection, not by the number of tests
    return LoadFileScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long files first."""
    items.sort(key=lambda item: LONG.index(item.path.name) if item.path.name in LONG else len(LONG))


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
