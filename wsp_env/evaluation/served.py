"""The other side of `wsp_env.evaluation.isolated`: opens the file, runs its instances, answers."""

import ctypes
import math
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from wsp_env.evaluation.isolated import RefusedError
from wsp_env.servant import Message, serve

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
    """Serve requests until there are none."""
    opened: Opened | None = None

    def answer(request: dict[str, Any], arrays: list[np.ndarray]) -> Message:
        nonlocal opened
        made = np.empty(0)
        try:
            if request["do"] == "open":
                opened = open_file(Path(request["file"]))
                return {}, [made]
            assert opened is not None
            if request["do"] == "reset":
                opened.reset(request["n"], request["vehicle"])
            else:
                time, demand, *tables = arrays
                wheel, *pressure = (table.reshape(time.size, -1) for table in tables)
                made = opened.act(time, demand, wheel, pressure[0] if pressure else None)
        except RefusedError as error:
            return {"error": str(error)}, [made]
        except Exception as error:
            return {"error": f"cannot be run: {type(error).__name__}: {error}"}, [made]
        return {}, [made]

    serve(answer)
