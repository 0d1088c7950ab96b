"""What all tests share: no time limit for random tests, and an order in which kernels are compiled once."""

import gc
import os
from typing import Any

# Before numpy is loaded, and for the processes that tests start, too: the matrices are small, and pytest's processes share the
# cores. Where these were busy, a stop took twenty times as long to prepare with two threads of BLAS as with one.
os.environ |= {name: os.environ.get(name, "1") for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}

import pytest
from example_diagnosis import named_gradient
from hypothesis import settings

import agents  # noqa: F401  # before torch: its threads then sleep while they wait, and pytest's processes share the cores
from wsp_env.diagnosis.answer import Diagnosis

# Without a time limit, as the first call of a kernel may compile it.
settings.register_profile("wsp", deadline=None)
settings.load_profile("wsp")


#: Files in the order in which they are begun: long ones, as one begun last would keep a process waiting. The first compiles the
#: plant, which most others need, and takes minutes over it. Until then the second process does what needs none of it, or it
#: would compile the same.
BEGUN_FIRST = (
    "test_diagnosis.py",
    "test_recordings_quality.py",
    "test_suspect.py",
    "test_creep_curves.py",
    "test_contact_geometry.py",
    "test_contact_port.py",
    "test_contact_geometry_forces.py",
    "test_fuzz.py",
    "test_documents.py",
    "test_architecture.py",
    "test_mechanism_cards.py",
    "test_package.py",
    "test_concealed_proof.py",
    "test_diagnosis_actuator.py",
    "test_bound.py",
    "test_misread_speed.py",
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
    first = {name: place for place, name in enumerate(BEGUN_FIRST)}
    items.sort(key=lambda item: first.get(item.path.name, len(first)))


@pytest.fixture(scope="module", autouse=True)
def _what_was_there_before_is_not_collected() -> None:
    """Spare the garbage collector what earlier modules left: the MDF4 reader calls it for every file, seconds at a time."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def found() -> Diagnosis:
    """Return a made-up diagnosis that names a gradient."""
    return named_gradient()
