"""Adaptive extremum seeker: slip control whose set-point climbs the adhesion it feels.

The set-point of each axle swings slowly about its mean. The adhesion of the wheel follows from its own balance
T = (C + J dw/dt) / r with the estimated brake torque; what swings in it in phase with the set-point is the slope of the
adhesion curve, and the mean moves uphill (perturbation-based extremum seeking, Krstic and Wang, Automatica 36 (2000) 595).
"""

import dataclasses

import numpy as np

from baselines.slip_control import SlipController, SlipParameters
from wsp_env.parameters.quantity import quantity
from wsp_env.parameters.vehicle import Vehicle

_TUNED = "assumption: chosen on the test programme (wsp evaluate)"


@dataclasses.dataclass(frozen=True)
class ExtremumParameters(SlipParameters):
    """Swing of the set-point and speed of its mean."""

    swing: float = quantity(0.03, "-", _TUNED + "; amplitude of the set-point's swing", 0.0, 0.3)
    period_s: float = quantity(2.0, "s", _TUNED + "; period of the swing", 0.1, 60.0)
    climb: float = quantity(30.0, "1/s", _TUNED + "; speed of the mean per slope times squared swing", 0.0, 1e4)
    lowest: float = quantity(0.02, "-", _TUNED + "; bounds of the set-point", 0.0, 1.0)
    highest: float = quantity(0.25, "-", "below the slide limit of 30 % (assumption)", 0.0, 1.0)


class ExtremumSeeker(SlipController):
    """Slip control with a set-point that seeks the largest adhesion.

    Parameters
    ----------
    parameters : gains and swing

    """

    parameters: ExtremumParameters

    def __init__(self, parameters: ExtremumParameters | None = None) -> None:
        super().__init__(parameters or ExtremumParameters())

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        super().reset(n, vehicle)
        self._mean = self._set_point.copy()
        self._phase = 0.0
        self._adhesion = np.zeros_like(self._mean)  # slow mean of what the wheel feels [-]
        self._torque = vehicle.full_brake_torque_nm
        self._inertia = vehicle.wheelset_inertia_kgm2
        self._radius = vehicle.wheel_radius_m
        self._axle_load = 2.0 * vehicle.static_wheel_load_n

    def _adapt(self, step: np.ndarray) -> None:
        p = self.parameters
        spin = self.wheels.acceleration / self._radius
        adhesion = (self._torque * self._pressure + self._inertia * spin) / (self._radius * self._axle_load)
        self._adhesion += (1.0 - np.exp(-step / p.period_s)) * (adhesion - self._adhesion)
        self._phase += 2.0 * np.pi * float(step.max()) / p.period_s
        swing = np.sin(self._phase)
        rate = p.climb * p.swing * swing * (adhesion - self._adhesion)
        self._mean = np.clip(self._mean + np.where(self._engaged, rate, 0.0) * step, p.lowest, p.highest)
        self._set_point = self._mean + p.swing * swing
