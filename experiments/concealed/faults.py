"""Faulty channels: what goes wrong between a sensor and a file, put into the tables of a finished campaign."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

#: A function of (torques (T, A) [N m], wheel speeds (T, A) [rad/s], axle, other axle, turn) that changes them in place.
Fault = Callable[[np.ndarray, np.ndarray, int, int, int], None]

#: Sizes by turn of the plan: units in which a torque may be stored [per N m], offsets [N m], delays [s].
UNITS = (1e-3, 0.7376, 0.1020)  # kN m, lbf ft, kgf m
OFFSETS_NM = (2000.0, 500.0, 5000.0)
DELAYS_S = (0.3, 0.1, 1.0)
SPEED_UNITS = (60.0 / (2.0 * np.pi), 1.0 / (2.0 * np.pi), 0.445 * 3.6)  # per rad/s: rev/min, rev/s, km/h of a wheel of 0.89 m
_SAMPLE_S = 0.01


def _unit(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    torque[:, axle] *= UNITS[turn % len(UNITS)]


def _speed_unit(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    wheel[:, axle] *= SPEED_UNITS[turn % len(SPEED_UNITS)]


def _copied(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    wheel[:, axle] = wheel[:, other]


def _halved(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    torque[:, axle] *= 0.5


def _offset(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    torque[:, axle] += OFFSETS_NM[turn % len(OFFSETS_NM)]


def _delayed(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    late = round(DELAYS_S[turn % len(DELAYS_S)] / _SAMPLE_S)
    wheel[late:, axle], wheel[:late, axle] = wheel[:-late, axle].copy(), wheel[0, axle]


def _swapped(torque: np.ndarray, wheel: np.ndarray, axle: int, other: int, turn: int) -> None:
    wheel[:, [axle, other]] = wheel[:, [other, axle]]


FAULTS: dict[str, Fault] = {
    "torque in another unit": _unit,
    "wheel speed in another unit": _speed_unit,
    "wheel speed copied": _copied,
    "torque halved": _halved,
    "torque offset": _offset,
    "wheel speed delayed": _delayed,
    "wheel speeds swapped": _swapped,
}


def inject(folder: Path, fault: str, turn: int, seed: int) -> list[int]:
    """Put a fault into every run of a campaign; return the axles of the faulty channels, from 1."""
    tables = sorted([*folder.glob("*.csv"), *folder.glob("*.parquet")])
    axles = sum(name.endswith("_brake_torque_nm") for name in _read(tables[0]).columns)
    axle, other = (int(one) for one in np.random.default_rng(seed).permutation(axles)[:2])
    for file in tables:
        frame = _read(file)
        names = [[f"axle{k + 1}_{what}" for k in range(axles)] for what in ("brake_torque_nm", "wheel_speed_radps")]
        torque, wheel = (np.column_stack([frame[name].to_numpy() for name in of]) for of in names)
        FAULTS[fault](torque, wheel, axle, other, turn)
        changed = {name: values[:, k] for of, values in zip(names, (torque, wheel), strict=True) for k, name in enumerate(of)}
        frame = frame.with_columns(**{name: pl.Series(values) for name, values in changed.items()})
        if file.suffix == ".csv":
            frame.write_csv(file)
        else:
            frame.write_parquet(file)
    return [axle + 1] if fault != "wheel speeds swapped" else sorted((axle + 1, other + 1))


def _read(file: Path) -> pl.DataFrame:
    return pl.read_csv(file) if file.suffix == ".csv" else pl.read_parquet(file)
