"""An FMU as a controller: co-simulation of FMI 2.0 or 3.0, one instance a stop, used again for the next one.

It takes wheel speeds [rad/s], the demand and perhaps cylinder pressures [bar], and gives commands. Where its variables have
other names, a TOML file beside it (`mine.toml` for `mine.fmu`) says so:

    [variables]                     # ours = the FMU's; {axle} counts from 1
    wheel_speed = "omega[{axle}]"
    command = "valve_{axle}"
    [commands]                      # what the FMU gives for each; here the defaults
    vent = -1
    hold = 0
    apply = 1
    [parameters]                    # of the FMU
    slip_threshold = 1.2

A unit that the FMU states is converted; without one ours is taken.
"""

import ctypes
import dataclasses
import platform
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from wsp_env.evaluation.isolated import RefusedError
from wsp_env.parameters.document import DocumentError, read_toml

#: Ours: unit, causality in the FMU, whether there is one for each axle, whether it may be missing.
OURS = {
    "wheel_speed": ("rad/s", "input", True, False),
    "demand": ("", "input", False, True),
    "pressure": ("bar", "input", True, True),
    "command": ("", "output", True, False),
}

_UNPACKED_BYTES = 500_000_000  # an FMU of more is refused


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of an FMU."""

    name: str
    number: int  # its value reference
    causality: str
    real: bool
    unit: str


@dataclasses.dataclass(frozen=True)
class Described:
    """What modelDescription.xml says."""

    version: int
    token: str
    model: str
    variables: Mapping[str, Variable]


def describe(root: ElementTree.Element) -> Described:
    """Return a model description; `RefusedError` for one of another version or kind."""
    version = root.get("fmiVersion", "")
    if not version.startswith(("2.0", "3.0")):
        raise RefusedError(f"is of FMI {version or 'unknown'}; versions 2.0 and 3.0 are run")
    whole = int(version[0])
    simulation = root.find("CoSimulation")
    if simulation is None:
        raise RefusedError("is for model exchange only; export it for co-simulation")
    found = {}
    for item in root.find("ModelVariables") or ():
        inner = item.find("Real") if whole == 2 else item
        real = inner is not None and (whole == 2 or item.tag == "Float64") and item.find("Dimension") is None
        name = item.get("name", "")
        unit = inner.get("unit", "") if inner is not None else ""
        found[name] = Variable(name, int(item.get("valueReference", "-1")), item.get("causality", "local"), real, unit)
    token = root.get("guid" if whole == 2 else "instantiationToken", "")
    return Described(whole, token, simulation.get("modelIdentifier", ""), found)


class Fmu:
    """An FMU unpacked and loaded."""

    def __init__(self, file: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wsp-fmu-")
        place = Path(self._folder.name)
        try:
            with zipfile.ZipFile(file) as archive:
                if sum(item.file_size for item in archive.infolist()) > _UNPACKED_BYTES:
                    raise RefusedError("is too large")
                archive.extractall(place)
            self._described = describe(ElementTree.parse(place / "modelDescription.xml").getroot())
        except (zipfile.BadZipFile, OSError, ElementTree.ParseError, ValueError) as error:
            raise RefusedError(f"is no FMU ({error})") from None
        self._map = _map_of(file.with_suffix(".toml"))
        self._code = _Binary(_library(place, self._described), self._described, place)
        self._instances: list[ctypes.c_void_p] = []

    def reset(self, n: int, vehicle: dict[str, Any]) -> None:
        """Begin n new stops; instances that there are begin anew."""
        axles = int(vehicle["axles"])
        self._wheel = self._of("wheel_speed", axles)
        self._demand = self._of("demand", 1)
        self._pressure = self._of("pressure", axles)
        self._command = self._of("command", axles)
        for instance in self._instances:
            self._code.reset(instance)
        while len(self._instances) < n:
            self._instances.append(self._code.instance(f"stop {len(self._instances) + 1}"))
        parameters = self._map.get("parameters", {})
        numbers = [self._variable(name, "parameter").number for name in parameters]
        for instance in self._instances[:n]:
            self._code.set(instance, numbers, list(map(float, parameters.values())))
            self._code.initialise(instance)
        self._n, self._time = n, np.full(n, np.nan)
        self._interval = 0.02

    def act(self, time: np.ndarray, demand: np.ndarray, wheel: np.ndarray, pressure: np.ndarray | None) -> np.ndarray:
        """Return commands (N, A)."""
        since = time - self._time
        if np.isfinite(since).all():
            self._interval = float(np.max(since))
        self._time = time.copy()
        command = np.empty(wheel.shape)
        numbers, factors = self._command
        for i in range(self._n):
            instance = self._instances[i]
            self._put(instance, self._wheel, wheel[i])
            self._put(instance, self._demand, demand[i : i + 1])
            if pressure is not None:
                self._put(instance, self._pressure, pressure[i])
            elif self._pressure[0]:
                raise RefusedError("needs cylinder pressures: wsp evaluate --pressure-sensors")
            self._code.step(instance, float(time[i]), self._interval)
            command[i] = self._code.get(instance, numbers) / factors
        return self._ours(command)

    def _ours(self, command: np.ndarray) -> np.ndarray:
        """Return commands as ours, from the FMU's nearest one."""
        said = self._map.get("commands", {})
        theirs = np.array([float(said.get(name, value)) for name, value in (("vent", -1.0), ("hold", 0.0), ("apply", 1.0))])
        if list(theirs) == [-1.0, 0.0, 1.0]:
            return command
        return np.argmin(np.abs(command[..., None] - theirs), axis=-1) - 1.0

    def _put(self, instance: ctypes.c_void_p, target: tuple[list[int], np.ndarray], values: np.ndarray) -> None:
        numbers, factors = target
        if numbers:
            self._code.set(instance, numbers, (np.nan_to_num(values, nan=0.0) * factors).tolist())

    def _of(self, ours: str, count: int) -> tuple[list[int], np.ndarray]:
        """Return the FMU's variables for one of ours, and by what ours is multiplied to have their units."""
        unit, causality, per_axle, optional = OURS[ours]
        form = str(self._map.get("variables", {}).get(ours, f"{ours}[{{axle}}]" if per_axle else ours))
        names = [form.replace("{axle}", str(axle + 1)) for axle in range(count if per_axle else 1)]
        if optional and ours not in self._map.get("variables", {}) and names[0] not in self._described.variables:
            return [], np.empty(0)
        found = [self._variable(name, causality) for name in names]
        if len(set(names)) < len(names):
            raise RefusedError(f"is mapped to one variable {form} for all axles: write {{axle}} where its number stands")
        return [one.number for one in found], np.array([_factor(one, ours, unit) for one in found])

    def _variable(self, name: str, causality: str) -> Variable:
        known = self._described.variables
        if name not in known:
            near = [one.name for one in known.values() if one.causality == causality][:12]
            raise RefusedError(
                f"has no variable {name}; its {causality}s: {', '.join(near) or 'none'}; a TOML file beside it maps them"
            )
        found = known[name]
        if found.causality != causality:
            article = "a" if causality == "parameter" else "an"
            raise RefusedError(f"has {name} as {found.causality}, where {article} {causality} is needed")
        if not found.real:
            raise RefusedError(f"has {name} as another type than a real number")
        return found


def _factor(variable: Variable, ours: str, unit: str) -> float:
    """Return by what ours is multiplied to stand in the unit of the FMU's variable."""
    if variable.unit in ("", unit) or (unit == "" and variable.unit in ("1", "-")):
        return 1.0
    from wsp_env.recordings.errors import CampaignError
    from wsp_env.recordings.units import conversion

    try:
        return 1.0 / conversion(variable.unit, unit, ours, f"variable {variable.name}")
    except CampaignError as error:
        raise RefusedError(f"states a unit that does not fit: {error}") from None


def _map_of(file: Path) -> dict[str, Any]:
    """Return the tables of the map beside an FMU; empty ones without it."""
    if not file.is_file():
        return {}
    try:
        document = read_toml(file)
    except DocumentError as error:
        raise RefusedError(f"has a map {file.name} that {error}") from None
    valid = {"variables": set(OURS), "commands": {"vent", "hold", "apply"}, "parameters": None}
    for table, content in document.items():
        if table not in valid or not isinstance(content, dict):
            raise RefusedError(f"has a map {file.name} with {table}; valid: {', '.join(f'[{name}]' for name in valid)}")
        names = valid[table]
        if names is not None and (wrong := sorted(set(content) - names)):
            raise RefusedError(f"has a map {file.name} with {', '.join(wrong)} in [{table}]; valid: {', '.join(sorted(names))}")
        kind, said = (str, "a name in quotes") if table == "variables" else (int | float, "a number")
        for name, value in content.items():
            if not isinstance(value, kind) or isinstance(value, bool):
                raise RefusedError(f"has a map {file.name} with {name} = {value!r} in [{table}]: {said} is needed")
    return document


def _library(place: Path, described: Described) -> Path:
    """Return the binary for this machine; `RefusedError` says for which there are some."""
    arm = platform.machine().lower() in ("arm64", "aarch64")
    system, ending = {"linux": ("linux", ".so"), "win32": ("windows", ".dll")}.get(sys.platform, ("darwin", ".dylib"))
    short = {"linux": "linux", "windows": "win", "darwin": "darwin"}[system]
    wanted = f"{short}64" if described.version == 2 else f"{'aarch64' if arm else 'x86_64'}-{system}"
    file = place / "binaries" / wanted / f"{described.model}{ending}"
    if not file.is_file():
        there = sorted(one.name for one in (place / "binaries").glob("*")) if (place / "binaries").is_dir() else []
        raise RefusedError(f"has no binary for this machine ({wanted}); it has {', '.join(there) or 'none'}")
    return file


class _Callbacks2(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("logger", "allocateMemory", "freeMemory", "stepFinished", "componentEnvironment")
    )


class _Binary:
    """The functions of an FMU of either version."""

    def __init__(self, file: Path, described: Described, place: Path) -> None:
        try:
            self._code = ctypes.CDLL(str(file))
        except OSError as error:
            raise RefusedError(f"has a binary that cannot be loaded ({error})") from None
        self._described, self._place = described, place
        self._prefix = f"fmi{described.version}"
        libc = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
        self._log = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)(
            lambda *said: None
        )
        address = [ctypes.cast(one, ctypes.c_void_p).value for one in (self._log, libc.calloc, libc.free)]
        self._callbacks = _Callbacks2(*address, None, None)

    def instance(self, name: str) -> ctypes.c_void_p:
        """Return a new instance."""
        said, token = name.encode(), self._described.token.encode()
        resources = self._place / "resources"
        if self._described.version == 2:
            make = self._function("Instantiate")
            make.restype = ctypes.c_void_p
            made = make(said, 1, token, resources.as_uri().encode(), ctypes.byref(self._callbacks), 0, 0)
        else:
            make = self._function("InstantiateCoSimulation")
            make.restype = ctypes.c_void_p
            no, none = ctypes.c_bool(False), ctypes.c_void_p(None)
            place = f"{resources}/".encode()
            made = make(said, token, place, no, no, no, no, none, ctypes.c_size_t(0), none, none, none)
        if not made:
            what = "guid" if self._described.version == 2 else "instantiationToken"
            raise RefusedError(f"could not be instantiated: do its binary and its model description belong together ({what})?")
        return ctypes.c_void_p(made)

    def initialise(self, instance: ctypes.c_void_p) -> None:
        """Bring an instance to its start."""
        no, zero = ctypes.c_int(0), ctypes.c_double(0.0)
        if self._described.version == 2:
            self._do("SetupExperiment", instance, no, zero, zero, no, zero)
            self._do("EnterInitializationMode", instance)
        else:
            self._do("EnterInitializationMode", instance, ctypes.c_bool(False), zero, zero, ctypes.c_bool(False), zero)
        self._do("ExitInitializationMode", instance)

    def reset(self, instance: ctypes.c_void_p) -> None:
        """Put an instance back to what it was when it was made."""
        self._do("Reset", instance)

    def set(self, instance: ctypes.c_void_p, numbers: list[int], values: Iterable[float]) -> None:
        """Set real variables."""
        count = len(numbers)
        if count:
            given = ((ctypes.c_uint * count)(*numbers), ctypes.c_size_t(count), (ctypes.c_double * count)(*values))
            self._do(*self._real("Set"), instance, *given, *self._length(count))

    def get(self, instance: ctypes.c_void_p, numbers: list[int]) -> np.ndarray:
        """Return real variables."""
        count = len(numbers)
        made = (ctypes.c_double * count)()
        given = ((ctypes.c_uint * count)(*numbers), ctypes.c_size_t(count), made)
        self._do(*self._real("Get"), instance, *given, *self._length(count))
        return np.array(made)

    def step(self, instance: ctypes.c_void_p, time: float, duration: float) -> None:
        """Take a step."""
        start, length = ctypes.c_double(time), ctypes.c_double(duration)
        if self._described.version == 2:
            self._do("DoStep", instance, start, length, ctypes.c_int(1))
            return
        flags, last = [ctypes.c_bool(False) for _ in range(3)], ctypes.c_double(0.0)
        self._do("DoStep", instance, start, length, ctypes.c_bool(True), *map(ctypes.byref, flags), ctypes.byref(last))

    def _real(self, verb: str) -> tuple[str]:
        return (f"{verb}Real" if self._described.version == 2 else f"{verb}Float64",)

    def _length(self, count: int) -> tuple[ctypes.c_size_t, ...]:
        return () if self._described.version == 2 else (ctypes.c_size_t(count),)

    def _function(self, name: str) -> Any:
        try:
            return getattr(self._code, f"{self._prefix}{name}")
        except AttributeError:
            raise RefusedError(f"lacks the function {self._prefix}{name}") from None

    def _do(self, name: str, *given: Any) -> None:
        status = self._function(name)(*given)
        if status > 1:  # neither OK nor warning
            raise RefusedError(f"failed: {self._prefix}{name} returned status {status}")
