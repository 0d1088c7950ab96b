"""The plant's step as a CUDA kernel, in numba's simulator: the same as on the CPU, vehicle by vehicle."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.port import Setup
from wsp_env.scenario import Scenario, draw

VEHICLES, STEPS = 3, 85

CODE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import test_gpu
from wsp_env.plant.longitudinal.gpu import GpuSteps
plant = test_gpu.started()
steps = GpuSteps(plant)
for command in test_gpu.commands():
    steps.step(command)
steps.fetch()
other = test_gpu.started()
for command in test_gpu.commands():
    other.step(command)
print(json.dumps([test_gpu.everything(plant), test_gpu.everything(other)]))
"""


def started():
    """Return bogies at different speeds on different rails, one of which stops within the test."""
    plant = LongitudinalPlant(BOGIE, VEHICLES, Setup(track_nodes=5, mechanisms={"load_transfer": {"body_height_m": 1.0}}))
    for index, speed in enumerate((0.1, 8.0, 30.0)):
        generator = np.random.default_rng(index)
        plant.start(index, draw(Scenario(), BOGIE, generator, 5, {"initial_speed": speed, "mu_cd": 0.03}))
    return plant


def commands():
    """Return valve commands (N, A) that apply, hold and vent."""
    return np.random.default_rng(0).choice([1.0, 1.0, 0.0, -1.0], size=(STEPS, VEHICLES, BOGIE.axles))


def everything(plant):
    """Return all numbers of a plant's state."""
    flat = []

    def collect(value):
        if isinstance(value, tuple):
            for item in value:
                collect(item)
        else:
            flat.extend(np.asarray(value, dtype=np.float64).ravel().tolist())

    collect((plant.state, plant.moving))
    return flat


@pytest.mark.slow
@pytest.mark.skipif(find_spec("numba.cuda.simulator") is None, reason="this numba has no CUDA simulator")
def test_a_step_of_bogies_as_a_cuda_kernel_is_that_of_the_cpu():
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", CODE, os.path.dirname(__file__)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    on_gpu, uncompiled = json.loads(done.stdout.splitlines()[-1])
    assert on_gpu == uncompiled  # the same functions of Python: to the last bit
    plant = started()
    for command in commands():
        plant.step(command)
    assert plant.moving.tolist() == [False, True, True]
    np.testing.assert_allclose(on_gpu, everything(plant), rtol=1e-9, atol=1e-12)  # exp and log may differ in the last bit
