"""One's own WSP in native code as a controller: a shared library with three functions, or an FMU; in a process of its own.

`c/wsp_controller.h` is the interface of a library, `c/my_wsp.c` a template. An FMU is co-simulation of FMI 2.0 or 3.0; a TOML
file beside it, of the same name, maps its variables.
"""

from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.evaluation.isolated import DECISION_LIMIT_S, OPENING_LIMIT_S, Isolated, NativeError
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle, check_vehicle
from wsp_env.plant.port import Measurement

#: Files in native code, by their ending.
LIBRARIES = (".so", ".dll", ".dylib")
FMU = ".fmu"

#: Source that somebody may take for a library.
_SOURCES = (".c", ".cc", ".cpp", ".h")


def is_native(name: str) -> bool:
    """Whether a controller's name is that of a file in native code."""
    return Path(name).suffix.lower() in (*LIBRARIES, FMU, *_SOURCES)


class NativeController:
    """A controller in a shared library or an FMU.

    `ParameterError` when it is made says what is wrong with the file; a failure while braking is a `NativeError`.

    Parameters
    ----------
    file : the library or FMU
    decision_limit_s : time for one decision on all stops [s] of the processor

    """

    action = "valve"

    def __init__(self, file: str | Path, decision_limit_s: float = DECISION_LIMIT_S) -> None:
        self._file, self._limit_s = Path(file), decision_limit_s
        who = f"controller {str(file)!r}"
        if self._file.suffix.lower() in _SOURCES:
            raise ParameterError(
                f"{who} is source: build it, gcc -std=c99 -O2 -shared -fPIC -o {self._file.stem}.so {self._file}"
            )
        if not self._file.is_file():
            raise ParameterError(f"{who}: there is no file {file}")
        self._process: Isolated | None = None
        try:
            self._opened()
        except NativeError as error:
            raise ParameterError(f"{who}: {error}") from None

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops of a vehicle."""
        check_vehicle(vehicle)
        self._axles = vehicle.axles
        self._opened().ask({"do": "reset", "n": n, "vehicle": described(vehicle)}, OPENING_LIMIT_S)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A)."""
        n = len(measurement.time)
        arrays = [measurement.time, measurement.demand, measurement.wheel_speed]
        if measurement.pressure is not None:
            arrays.append(measurement.pressure)
        assert self._process is not None
        command = self._process.ask({"do": "act"}, self._limit_s, *arrays)
        command = command.reshape(n, self._axles).copy()
        if (beyond := np.argwhere(np.abs(command) > 1.0)).size:
            stop, axle = beyond[0]
            raise NativeError(
                f"{self._file.name} gave {command[stop, axle]:g} for axle {axle + 1} of stop {stop + 1}: "
                "-1 vents, 0 holds, +1 applies; an FMU's other numbers are named in [commands] of the TOML file beside it"
            )
        return command

    def _opened(self) -> Isolated:
        """Return the process with the file open in it; a new one where the last has ended."""
        if self._process is None or not self._process.alive:
            process = Isolated(self._file.name)
            process.ask({"do": "open", "file": str(self._file.resolve())}, OPENING_LIMIT_S)
            self._process = process
        return self._process


def described(vehicle: Vehicle) -> dict[str, Any]:
    """Return what `wsp_vehicle` holds of a vehicle, in its order."""
    brake = vehicle.brake
    return {
        "axles": vehicle.axles,
        "wheel_radius_m": vehicle.wheel_radius_m,
        "mass_kg": vehicle.mass_kg,
        "payload_kg": vehicle.payload_kg,
        "full_pressure_bar": brake.full_pressure_bar,
        "torque_per_bar_nm": brake.torque_per_bar_nm,
        "demand_rise_s": brake.demand_rise_s,
        "dead_time_s": brake.dead_time_s,
        "fill_time_constant_s": brake.fill_time_constant_s,
        "vent_time_constant_s": brake.vent_time_constant_s,
    }
