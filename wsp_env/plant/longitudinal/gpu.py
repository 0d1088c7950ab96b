"""The longitudinal plant's step on a GPU, a thread for each vehicle; see docs/gpu.md for how far it is.

Each thread calls the compiled step of the CPU with a batch of one, its own row of every array: no equation stands here.
"""

from typing import Any

import numpy as np

from wsp_env.compiled import cuda_kernel, inlined, on_device, plain, row_taker
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.longitudinal.state import batch
from wsp_env.plant.longitudinal.step import ROWS, advance
from wsp_env.plant.mechanisms import NULL
from wsp_env.plant.port import Setup

#: Threads of a block: two warps of 32; a step needs many registers, which all threads of a block share (assumption).
THREADS = 64

#: Arguments of `advance_row` behind the vehicle's index.
ARGUMENTS = "command, believed, own, constants, moving, work"

_own = row_taker(plain(batch(1, COACH, Setup(), NULL)[:3]))


@inlined
def advance_row(
    i: int, command: np.ndarray, believed: Any, own: Any, constants: Any, moving: np.ndarray, work: np.ndarray
) -> None:
    """Advance vehicle i by one control interval, if it moves.

    Parameters
    ----------
    command, believed, moving : as the plant's own step takes them
    own : state, conditions and physics of all vehicles as `plain` tuples
    constants : `PlantConstants` as plain tuples
    work : (N, ROWS, A) scratch

    """
    one = i + 1
    state, conditions, physics = _own(own, i)
    advance(command[i:one], believed, (state, conditions, physics, constants), moving[i:one], work[i])


class GpuSteps:
    """Steps a plant whose stops were started, on the GPU, until `fetch` brings its state back.

    Parameters
    ----------
    plant : whose state is copied

    """

    def __init__(self, plant: LongitudinalPlant) -> None:
        self._n = plant.n
        self._kernel = cuda_kernel(advance_row, ARGUMENTS)
        self._host = (plain((plant.state, plant.conditions, plant._physics)), plain(plant.constants), plant.moving)
        self._device = on_device(self._host)
        self._work = on_device(np.empty((plant.n, ROWS, plant.vehicle.axles)))
        self._law = plant.vehicle.contact.law

    def step(self, command: np.ndarray) -> None:
        """Advance all vehicles by one control interval under the commands (N, A), see `wsp_env.plant.command`."""
        blocks = -(-self._n // THREADS)
        commands = on_device(np.asarray(command, dtype=np.float64))
        self._kernel[blocks, THREADS](commands, self._law, *self._device, self._work)

    def fetch(self) -> None:
        """Copy what the GPU holds into the plant."""
        _copy(self._device, self._host)


def _copy(device: Any, host: Any) -> None:
    if isinstance(host, tuple):
        for there, here in zip(device, host, strict=True):
            _copy(there, here)
    elif isinstance(host, np.ndarray):
        device.copy_to_host(host)
