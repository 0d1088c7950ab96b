"""What a wheel-slide-protection controller is, and how one is found by name.

A controller is any object with `reset` and `act`; it needs nothing from this package. It works on a batch of N stops and sees
measurements only, so that the same object runs in an environment, on replayed conditions or in anybody's own simulator.
"""

import ast
import contextlib
import dataclasses
import importlib
import importlib.util
import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, Protocol, runtime_checkable

import numpy as np

from wsp_env.child import TookTooLongError, limited
from wsp_env.evaluation.native import NativeController, is_native
from wsp_env.evaluation.policy import load_policy
from wsp_env.parameters.quantity import ParameterError, replace
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

#: Short names of the controllers that come with the project.
SHORT_NAMES = {
    "none": "baselines.none:NoWSP",
    "rule-based": "baselines.rule_based:RuleBasedWSP",
    "slip": "baselines.slip_control:SlipController",
    "extremum": "baselines.extremum_seeking:ExtremumSeeker",
    "adaptive": "baselines.adaptive:AdaptiveController",
}


#: Time that a file may take to be run, or a controller to be made [s] of the processor (assumption: it may import torch).
LOADING_LIMIT_S = 60.0
_TOO_LONG = f"takes more than {LOADING_LIMIT_S:g} s of the processor to be loaded"


@runtime_checkable
class Controller(Protocol):
    """The protocol.

    A controller may also have an attribute `parameters`, a dataclass that the command line can set and its class is made
    with, and `action = "pressure"` if it commands pressures, -1 none to +1 the demanded one, instead of valves.
    """

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops of a vehicle."""

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""


def load(name: str, parameters: Mapping[str, Any] | None = None) -> Controller:
    """Return the controller of a name, with `parameters` replacing fields of its `parameters` dataclass.

    `name` is one of `SHORT_NAMES`, a policy's folder (see `wsp_env.evaluation.policy`), a shared library or an FMU (see
    `wsp_env.evaluation.native`; it runs in a process of its own), an import path `package.module:Class` or a file
    `path/to/file.py:Class` (the class may be left out where the file holds one only), which may import, at its top,
    what lies beside it. `ParameterError` says what could not be found. A file is run as Python: load only controllers that you
    trust; policies of others come as folders without code.
    """
    if name not in SHORT_NAMES and Path(name).is_dir():
        if parameters:
            raise ParameterError(f"controller {name!r} is a policy: it has no parameters to set")
        return load_policy(name)
    if name not in SHORT_NAMES and is_native(name):
        if parameters:
            raise ParameterError(f"controller {name!r} is native code: it has no parameters to set")
        return NativeController(name)
    place, _, attribute = SHORT_NAMES.get(name, name).partition(":")
    module = _module(name, place)
    if attribute:
        if not hasattr(module, attribute):
            raise ParameterError(f"controller {name!r}: {place} has no {attribute}")
        made = getattr(module, attribute)
    else:
        classes = [item for item in vars(module).values() if isinstance(item, type) and item.__module__ == module.__name__]
        controllers = [item for item in classes if hasattr(item, "act") and hasattr(item, "reset")]
        if not controllers:
            raise ParameterError(
                f"controller {name!r}: {place} holds no class with the methods reset(n, vehicle) and act(measurement)"
            )
        if len(controllers) != 1:
            raise ParameterError(
                f"controller {name!r}: {place} holds {len(controllers)} classes with reset and act; name one as {place}:Class"
            )
        made = controllers[0]
    controller = _made(name, made)
    if not isinstance(controller, Controller):
        raise ParameterError(f"controller {name!r} lacks reset(n, vehicle) or act(measurement)")
    if parameters:
        present = getattr(controller, "parameters", None)
        if not dataclasses.is_dataclass(present) or isinstance(present, type):
            raise ParameterError(f"controller {name!r} has no parameters to set")
        for key, value in parameters.items():
            if _is_number(getattr(present, key, None)) and not _is_number(value):
                raise ParameterError(f"parameter {key} of {name} must be a number, got {value!r}")
        changed = replace(present, parameters, f"parameter of {name}")
        controller = _made(name, made, changed)
    assert isinstance(controller, Controller)  # as the first one was
    return controller


def read_settings(controllers: Sequence[str], settings: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the parameters to set of every controller, from texts such as "rule-based.slip_base_mps=0.4".

    `ParameterError` for a text that is not of this form or names another controller.
    """
    chosen: dict[str, dict[str, Any]] = {name: {} for name in controllers}
    for setting in settings:
        target, equals, text = setting.partition("=")
        name, _, parameter = target.rpartition(".")
        if not equals or name not in chosen:
            raise ParameterError(
                f"setting {setting!r}: write CONTROLLER.PARAMETER=VALUE with a controller from {', '.join(controllers)}"
            )
        try:
            chosen[name][parameter] = ast.literal_eval(text)
        except (ValueError, SyntaxError):  # a word
            chosen[name][parameter] = text
    return chosen


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _made(name: str, made: object, *parameters: object) -> object:
    try:
        with limited(LOADING_LIMIT_S), _staying():
            return made(*parameters) if isinstance(made, type) else made
    except TookTooLongError:
        raise ParameterError(f"controller {name!r} {_TOO_LONG}") from None
    except (Exception, SystemExit) as error:  # whatever third-party code raises
        raise ParameterError(f"controller {name!r} cannot be made: {type(error).__name__}: {error}") from error


def _module(name: str, place: str) -> ModuleType:
    path = Path(place)
    if path.suffix == ".py":
        if not path.is_file():
            raise ParameterError(f"controller {name!r}: there is no file {place}")
        spec = importlib.util.spec_from_file_location(f"controller_{path.stem}", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # dataclasses look their module up there
        try:
            with _beside(path), limited(LOADING_LIMIT_S), _staying():
                spec.loader.exec_module(module)
        except TookTooLongError:
            raise ParameterError(f"controller {name!r}: {place} {_TOO_LONG}") from None
        except (Exception, SystemExit) as error:  # whatever third-party code raises
            raise ParameterError(f"controller {name!r}: {place} cannot be run: {type(error).__name__}: {error}") from error
        return module
    if len(path.parts) > 1:
        raise ParameterError(f"controller {name!r}: there is no such folder or file")
    try:
        return importlib.import_module(place)
    except ImportError as error:
        raise ParameterError(
            f"controller {name!r} was not found ({error}); valid: {', '.join(SHORT_NAMES)}, package.module:Class, "
            "file.py:Class, the folder of a policy"
        ) from None


@contextlib.contextmanager
def _staying() -> Iterator[None]:
    """Make an error of os._exit in this thread, which would end the process without a word."""
    end, here = os._exit, threading.get_ident()

    def refuse(status: int) -> NoReturn:
        if threading.get_ident() != here:  # that of `wsp_env.child`, whose parent is gone
            end(status)
        raise SystemExit(f"it calls os._exit({status}); a controller must not end its process")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = end


@contextlib.contextmanager
def _beside(path: Path) -> Iterator[None]:
    """Let a file import what lies beside it, and forget these modules then: beside another file may lie others so named."""
    folder = str(path.resolve().parent)
    before = set(sys.modules)
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        known = {name.partition(".")[0] for name in before}
        for name in set(sys.modules) - before:
            origin = getattr(sys.modules[name], "__file__", None) or ""
            if name.partition(".")[0] not in known and Path(origin).is_relative_to(folder):
                del sys.modules[name]
