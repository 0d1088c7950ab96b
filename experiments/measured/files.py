"""Measured data as they stand in their files, and the one error that a user can repair."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

#: Names of the two files of the drive.
DRIVE_FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
#: Folders of the robot's runs.
ONE_SURFACE = ("table", "gray", "green")
TWO_SURFACES = {"table_gray": ("table", "gray"), "green_table": ("table", "green")}  # where the runs begin, where they end
#: Lines of a header in a robot's file: names, units, short names.
_HEADER = 3
_ROBOT_COLUMNS = 25


class MeasuredError(Exception):
    """What the user can repair, in one line."""


class Drive(NamedTuple):
    """One recording of the drive, all (n,)."""

    name: str
    time: np.ndarray  # [s]
    position: np.ndarray  # measured [m]
    reference: np.ndarray  # set position [m]
    force: np.ndarray  # of the motor: control voltage times the drive's gain [N]
    pulses: np.ndarray  # channel pulses_N [N], zero where there is none


class Run(NamedTuple):
    """One run of the robot; n samples, three wheels."""

    name: str
    time: np.ndarray  # (n,) [s]
    set_speed: np.ndarray  # (2,) of the robot, in its own axes [m/s]
    set_wheels: np.ndarray  # (3,) of the motors [rad/s]
    wheels: np.ndarray  # (n, 3) speeds of the motors [rad/s]
    currents: np.ndarray  # (n, 3) of the motors, without their sign [A]
    place: np.ndarray  # (n, 2) of the robot in the camera's picture [pixel]
    angle: np.ndarray  # (n,) of the robot there [rad], continuous
    steps: np.ndarray  # (n, 2) the file's own steps of the robot along its axes [mm]


def drives(folder: Path) -> tuple[Drive, Drive]:
    """Read both recordings of the drive.

    Raises
    ------
    MeasuredError : if the folder does not hold them

    """
    first, second = (_drive(folder / name) for name in DRIVE_FILES)
    return first, second


def _drive(file: Path) -> Drive:
    if not file.is_file():
        raise MeasuredError(f"no file {file}: PATH must be the folder that holds {' and '.join(DRIVE_FILES)}")
    try:
        raw: dict[str, Any] = loadmat(file)
        channel = {name: np.ravel(raw[name]).astype(float) for name in ("t", "qm", "qg", "vir", "gtau")}
    # All that scipy raises for a file that is damaged or of another kind, and a channel that is missing.
    except (MatReadError, ValueError, KeyError, OSError, NotImplementedError, TypeError) as error:
        raise MeasuredError(f"{file} is not a recording of the drive: {error}") from error
    pulses = np.ravel(raw.get("pulses_N", np.zeros(len(channel["t"])))).astype(float)
    force = channel["gtau"][0] * channel["vir"]
    return Drive(file.name, channel["t"], channel["qm"], channel["qg"], force, pulses)


def one_surface(folder: Path, surface: str) -> list[Run]:
    """Read the robot's runs on one surface; errors as `drives`."""
    return _runs(folder / "one_surface" / f"{surface}_surface")


def two_surfaces(folder: Path, pair: str) -> list[Run]:
    """Read the robot's runs across a border; errors as `drives`."""
    return _runs(folder / "two_surfaces" / pair)


def _runs(folder: Path) -> list[Run]:
    files = sorted(folder.glob("exp*.csv"))
    if not files:
        raise MeasuredError(f"no files exp*.csv in {folder}: PATH must be the folder that holds one_surface and two_surfaces")
    return [_run(file) for file in files]


def _run(file: Path) -> Run:
    try:
        table = np.genfromtxt(file, delimiter=";", skip_header=_HEADER, usecols=range(_ROBOT_COLUMNS))
    except ValueError as error:
        raise MeasuredError(f"{file} is not a run of the robot: {str(error).splitlines()[0]}") from error
    if table.ndim != 2 or len(table) < _ROBOT_COLUMNS or not np.isfinite(table).all():
        raise MeasuredError(f"{file} is not a run of the robot: too short, or not numbers")
    at = len(table) // 2
    return Run(
        file.stem,
        table[:, 0] / 1e3,
        table[at, 1:3],
        table[at, 4:7],
        table[:, 10:13],
        table[:, 13:16],
        table[:, 19:21],
        np.unwrap(np.radians(table[:, 21])),
        table[:, 22:24],
    )
