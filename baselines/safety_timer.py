"""The safety timer: no axle stays without braking for ever, whatever its controller believes."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.parameters.quantity import Checked, quantity


@dataclasses.dataclass(frozen=True)
class SafetyParameters(Checked):
    """Times of the safety timer."""

    safety_timer_s: float = quantity(10.0, "s", "assumption: EN 15595, venting at most 10 s", 0.1, 60.0)
    safety_rest_s: float = quantity(1.0, "s", "assumption: then the brake stays applied for so long", 0.0, 60.0)


class SafetyTimer:
    """The timers of N vehicles with A axles.

    Parameters
    ----------
    shape : (N, A)

    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._unbraked = np.zeros(shape)  # since the last application [s]
        self._rest = np.zeros(shape)  # the axle stays applied for so long [s]

    def expired(self, braking: np.ndarray, step: np.ndarray, limit_s: float, rest_s: ArrayLike) -> np.ndarray:
        """Return which axles (N, A) must be applied now.

        Parameters
        ----------
        braking : (N, A) bool, which axles are being applied, if in pulses
        step : (N, 1) time since the last call [s]
        limit_s : longest time without application [s]
        rest_s : the axle is then applied for so long [s], broadcast to (N, A)

        """
        self._unbraked = np.where(braking, 0.0, self._unbraked + step)
        over = self._unbraked > limit_s
        self._rest = np.where(over, rest_s, np.maximum(self._rest - step, 0.0))
        self._unbraked[over] = 0.0
        applied: np.ndarray = self._rest > 0.0
        return applied
