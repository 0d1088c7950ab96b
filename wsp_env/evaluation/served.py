"""The other side of `wsp_env.evaluation.isolated`: opens the file, runs its instances, answers."""

import ctypes
import json
import math
import os
import sys
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from wsp_env import child
from wsp_env.evaluation.isolated import RefusedError

#: Version of `wsp_controller.h`.
INTERFACE = 1


class Opened(Protocol):
    """A file whose controllers are run."""

    def reset(self, n: int, vehicle: dict[str, Any]) -> None:
        """Begin n new stops."""

    def act(self, time: np.ndarray, demand: np.ndarray, wheel: np.ndarray, pressure: np.ndarray | None) -> np.ndarray:
        """Return commands (N, A)."""


class _Vehicle(ctypes.Structure):
    _fields_ = (
        ("interface", ctypes.c_int32),
        ("axles", ctypes.c_int32),
        *((name, ctypes.c_double) for name in (
            "wheel_radius_m", "mass_kg", "payload_kg", "full_pressure_bar", "torque_per_bar_nm", "demand_rise_s", "dead_time_s",
            "fill_time_constant_s", "vent_time_constant_s",
        )),
    )  # fmt: skip


_Doubles = ctypes.POINTER(ctypes.c_double)


class _Measurement(ctypes.Structure):
    _fields_ = (
        ("time_s", ctypes.c_double),
        ("demand", ctypes.c_double),
        ("wheel_speed_radps", _Doubles),
        ("pressure_bar", _Doubles),
    )


class Library:
    """A shared library with the functions of `wsp_controller.h`."""

    def __init__(self, file: Path) -> None:
        try:
            self._code = ctypes.CDLL(str(file))
        except OSError as error:
            raise RefusedError(f"is no shared library that runs on this machine ({error})") from None
        missing = [name for name in ("wsp_init", "wsp_step", "wsp_free") if not hasattr(self._code, name)]
        if missing:
            raise RefusedError(f'lacks {", ".join(missing)} of wsp_controller.h; in C++ they need extern "C"')
        try:
            version = ctypes.c_int32.in_dll(self._code, "wsp_interface").value
        except ValueError:
            raise RefusedError(
                "does not say its version: write WSP_CONTROLLER once in its source, see wsp_controller.h"
            ) from None
        if version != INTERFACE:
            raise RefusedError(
                f"was built for version {version} of wsp_controller.h, this is version {INTERFACE}: build it anew"
            )
        self._code.wsp_init.argtypes = [ctypes.POINTER(_Vehicle), ctypes.POINTER(ctypes.c_void_p)]
        self._code.wsp_step.argtypes = [ctypes.c_void_p, ctypes.POINTER(_Measurement), _Doubles]
        self._code.wsp_free.argtypes = [ctypes.c_void_p]
        self._code.wsp_free.restype = None
        self._running: list[ctypes.c_void_p] = []

    def reset(self, n: int, vehicle: dict[str, Any]) -> None:
        """Begin n new stops."""
        for controller in self._running:
            self._code.wsp_free(controller)
        self._running = []
        self._axles = int(vehicle["axles"])
        given = _Vehicle(INTERFACE, **vehicle)
        for _ in range(n):
            controller = ctypes.c_void_p()
            if result := self._code.wsp_init(ctypes.byref(given), ctypes.byref(controller)):
                raise RefusedError(f"refused a vehicle of {self._axles} axles: wsp_init returned {result}")
            self._running.append(controller)

    def act(self, time: np.ndarray, demand: np.ndarray, wheel: np.ndarray, pressure: np.ndarray | None) -> np.ndarray:
        """Return commands (N, A)."""
        command = np.full(wheel.shape, math.nan)
        for i, controller in enumerate(self._running):
            seen = _Measurement(time[i], demand[i], _row(wheel, i), None if pressure is None else _row(pressure, i))
            if result := self._code.wsp_step(controller, ctypes.byref(seen), _row(command, i)):
                raise RefusedError(f"failed in stop {i + 1}: wsp_step returned {result}")
        return command


def _row(table: np.ndarray, i: int) -> Any:
    return ctypes.cast(table.ctypes.data + i * table.strides[0], _Doubles)


def open_file(file: Path) -> Opened:
    """Return what runs a file."""
    if file.suffix.lower() == ".fmu":
        from wsp_env.evaluation.fmu import Fmu

        return Fmu(file)
    return Library(file)


def main() -> None:
    """Serve requests from standard input until it ends; what native code prints goes nowhere."""
    child.become_worker()
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    requests = os.fdopen(0, "rb", closefd=False)
    opened: Opened | None = None
    _send(answers, b"ready\n")
    while line := requests.readline():
        request = json.loads(line)
        arrays = [np.frombuffer(requests.read(8 * length)) for length in request["lengths"]]
        child.limit_processor(request["limit_s"])
        try:
            if request["do"] == "open":
                opened = open_file(Path(request["file"]))
                made = np.empty(0)
            elif request["do"] == "reset":
                assert opened is not None
                opened.reset(request["n"], request["vehicle"])
                made = np.empty(0)
            else:
                assert opened is not None
                n = arrays[0].size
                tables = [np.ascontiguousarray(array.reshape(n, -1)) for array in arrays[2:]]
                made = np.ascontiguousarray(opened.act(arrays[0], arrays[1], tables[0], tables[1] if len(tables) > 1 else None))
        except RefusedError as error:
            _send(answers, json.dumps({"error": str(error)}).encode() + b"\n")
        except Exception as error:
            _send(answers, json.dumps({"error": f"cannot be run: {type(error).__name__}: {error}"}).encode() + b"\n")
        else:
            _send(answers, json.dumps({"length": made.size}).encode() + b"\n" + made.tobytes())
        child.limit_processor(math.inf)
    sys.exit(0)


def _send(pipe: BinaryIO | Any, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[pipe.write(left) :]
