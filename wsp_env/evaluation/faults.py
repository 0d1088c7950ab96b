"""What fails in the devices while a stop lasts, other than by the controller's doing."""

import dataclasses
from typing import Any

import numpy as np

from wsp_env.plant.command import APPLIES, VENTS


@dataclasses.dataclass(frozen=True)
class Faults:
    """Times from which something fails in N stops with A axles [s]; inf where it stays sound."""

    sensor_s: np.ndarray  # (N, A) the wheel's sensor reads 0
    vents_s: np.ndarray  # (N, A) the dump valve is stuck open to the air: the axle has no more brake
    applies_s: np.ndarray  # (N, A) the dump valve vents no more: the axle has no more protection
    power_s: np.ndarray  # (N,) no valve gets current: all apply, as they do without

    @classmethod
    def none(cls, n: int, axles: int) -> "Faults":
        """Return that nothing fails."""
        each = np.full((n, axles), np.inf)
        return cls(each, each, each, np.full(n, np.inf))

    @property
    def protected(self) -> np.ndarray:
        """Axles whose valve does what it is told throughout (N, A) bool."""
        sound: np.ndarray = np.isinf(self.vents_s) & np.isinf(self.applies_s) & np.isinf(self.power_s)[:, None]
        return sound

    def acting(self, command: np.ndarray, time: np.ndarray, by_pressure: bool) -> np.ndarray:
        """Return what the valves do (N, A) under commands (N, A) at times (N,) [s]; commands may be pressures, 0 to 1."""
        now = time[:, None]
        vented, full = (0.0, 1.0) if by_pressure else (VENTS, APPLIES)
        acting = np.where(now >= self.applies_s, np.maximum(command, 0.0) if not by_pressure else full, command)
        acting = np.where(now >= self.power_s[:, None], full, acting)
        return np.where(now >= self.vents_s, vented, acting)


def standing_reported(controller: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return which wheels a controller reports to stand (N, A) bool, by its `wheels.standing`; none if it has none."""
    reported = getattr(getattr(controller, "wheels", None), "standing", None)
    if reported is None or np.shape(reported) != shape:
        return np.zeros(shape, dtype=bool)
    return np.array(reported, dtype=bool)
