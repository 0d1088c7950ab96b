"""The plant's step compiled for CUDA, which needs no GPU: `python -m experiments.cuda_compile [--architectures 8.0 9.0]`.

    pip install numba-cuda nvidia-cuda-nvcc-cu12 nvidia-cuda-nvrtc-cu12

numba-cuda types the kernel of `wsp_env.plant.longitudinal.gpu` and NVVM writes PTX; NVIDIA's assembler `ptxas` then says what
it takes on an architecture: registers of a thread, stack and what is spilled to memory for lack of registers. Nothing is run.
"""

import os
import re
import subprocess
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import tyro
from rich.console import Console

from wsp_env.compiled import cuda_kernel, plain
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.longitudinal.gpu import ARGUMENTS, THREADS, advance_row
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.longitudinal.step import ROWS
from wsp_env.plant.port import Setup
from wsp_env.report import Table, terminal_table

#: What ptxas says of a kernel.
_SAID = {
    "registers": r"Used (\d+) registers",
    "stack [B]": r"(\d+) bytes stack frame",
    "spilled [B]": r"(\d+) bytes spill stores",
}

#: 32-bit registers of a multiprocessor and threads that it holds at most, alike on 8.0 and 9.0 (CUDA C++ Programming Guide,
#: technical specifications per compute capability).
REGISTERS, MOST_THREADS = 65536, 2048


def toolkit() -> Path:
    """Return the folder of NVIDIA's compiler as pip installs it."""
    spec = find_spec("nvidia.cuda_nvcc")
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError("this needs pip install numba-cuda nvidia-cuda-nvcc-cu12 nvidia-cuda-nvrtc-cu12")
    return Path(next(iter(spec.submodule_search_locations)))


def given(vehicle: str) -> tuple[Any, ...]:
    """Return examples of the kernel's arguments, for three vehicles."""
    plant = LongitudinalPlant(VEHICLES[vehicle], 3, Setup())
    own, axles = plain((plant.state, plant.conditions, plant._physics)), plant.vehicle.axles
    return (
        np.ones((3, axles)), plant.vehicle.contact.law, own, plain(plant.constants), plant.moving, np.empty((3, ROWS, axles)),
    )  # fmt: skip


def ptx_of(vehicle: str, architecture: str) -> str:
    """Return the kernel's PTX."""
    os.environ.setdefault("CUDA_HOME", str(toolkit()))
    import numba
    from numba import cuda
    from numba.cuda import dispatcher

    major, minor = map(int, architecture.split("."))
    # For the functions that a kernel calls numba-cuda takes the capability of the machine's GPU, of which there is none.
    untyped, compiler, asked = cast(Any, numba), cast(Any, cuda), cast(Any, dispatcher)
    asked.get_current_device = lambda: SimpleNamespace(compute_capability=(major, minor))
    kernel: Any = cuda_kernel(advance_row, ARGUMENTS)
    signature = untyped.void(*(untyped.typeof(one) for one in given(vehicle)))
    text, _ = compiler.compile_ptx(kernel.py_func, signature, cc=(major, minor))
    return str(text)


def assembled(ptx: str, architecture: str) -> tuple[dict[str, int], int]:
    """Return what `ptxas` says of the kernel, and the bytes of its cubin."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "step.ptx").write_text(ptx)
        done = subprocess.run(
            [toolkit() / "bin" / "ptxas", "-v", f"-arch=sm_{architecture.replace('.', '')}", "-o", "step.cubin", "step.ptx"],
            cwd=folder, capture_output=True, text=True, check=True,
        )  # fmt: skip
        found = {name: re.search(pattern, done.stderr + done.stdout) for name, pattern in _SAID.items()}
        return {name: int(one[1]) for name, one in found.items() if one}, (Path(folder) / "step.cubin").stat().st_size


def main(vehicles: tuple[str, ...] = ("bogie", "coach"), architectures: tuple[str, ...] = ("8.0", "9.0")) -> None:
    """Compile and print.

    Parameters
    ----------
    vehicles
        Whose plants are compiled.
    architectures
        Compute capabilities.

    """
    rows = []
    for vehicle in vehicles:
        for architecture in architectures:
            begun = time.process_time()
            ptx = ptx_of(vehicle, architecture)
            took = time.process_time() - begun
            said, size = assembled(ptx, architecture)
            blocks = REGISTERS // (said["registers"] * THREADS)
            together = min(MOST_THREADS, blocks * THREADS)
            figures = (*(str(said.get(name, "?")) for name in _SAID), f"{size / 1000:.0f}", str(together))
            rows.append((vehicle, architecture, f"{took:.0f}", str(ptx.count("\n")), *figures))
            print(*rows[-1], flush=True)
    heads = ("vehicle", "architecture", "compiled [s]", "lines of PTX", *_SAID, "cubin [kB]", "threads at once")
    Console(width=140).print(terminal_table(Table(heads, rows)))


if __name__ == "__main__":
    tyro.cli(main)
