"""Slip control: per axle a PI controller holds the creepage at a set-point by steering the cylinder pressure.

The controller measures no pressure: it estimates the one in each cylinder from its own commands and the brake's nominal time
constants, and opens the dump valve towards the pressure it wants.
"""

import dataclasses

import numpy as np

from baselines.reference_speed import ReferenceParameters, ReferenceSpeed
from baselines.safety_timer import SafetyParameters, SafetyTimer
from wsp_env.parameters.quantity import quantity
from wsp_env.parameters.vehicle import Vehicle, check_vehicle
from wsp_env.plant.command import APPLIES, HOLDS, VENTS
from wsp_env.plant.port import Measurement

_TUNED = "assumption: chosen on the test programme (wsp evaluate)"


@dataclasses.dataclass(frozen=True)
class SlipParameters(ReferenceParameters, SafetyParameters):
    """Set-point and gains."""

    creepage: float = quantity(0.15, "-", _TUNED + "; set-point", 0.0, 1.0)
    least_slip_mps: float = quantity(0.4, "m/s", _TUNED + "; set-point of the slip speed at low speed", 0.0, 10.0)
    proportional: float = quantity(0.25, "s/m", _TUNED + "; share of full pressure per slip speed", 0.0, 10.0)
    integral: float = quantity(0.25, "1/m", _TUNED + "; the same per slip distance", 0.0, 10.0)
    damping: float = quantity(0.05, "s2/m", _TUNED + "; the same per wheel deceleration beyond the vehicle's", 0.0, 1.0)
    dead_band: float = quantity(0.04, "-", _TUNED + "; share of full pressure within which the valve holds", 0.0, 1.0)
    active_slip: float = quantity(0.5, "-", _TUNED + "; share of the set-point from which the controller acts", 0.0, 1.0)
    release_share: float = quantity(0.3, "-", _TUNED + "; share of the set-point below which it lets go", 0.0, 1.0)
    calm_s: float = quantity(3.0, "s", _TUNED + "; all axles applied for so long: the slide is over", 0.0, 60.0)
    cut_out_mps: float = quantity(1.4, "m/s", "assumption: EN 15595, no WSP below 3 to 5 km/h", 0.0, 10.0)


class SlipController:
    """PI control of the creepage; `wheels.standing` and `wheels.failed` as in the rule-based WSP.

    Parameters
    ----------
    parameters : set-point and gains

    """

    def __init__(self, parameters: SlipParameters | None = None) -> None:
        self.parameters = parameters or SlipParameters()

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        check_vehicle(vehicle)
        shape = (n, vehicle.axles)
        self._brake = vehicle.brake
        self.wheels = ReferenceSpeed(self.parameters, n, vehicle)
        self._pressure = np.zeros(shape)  # estimated, share of full pressure
        self._distributor = np.zeros(n)  # estimated pressure of the distributor, share of full pressure
        self._integral = np.ones(shape)  # share of full pressure
        self._engaged = np.zeros(shape, dtype=bool)
        self._calm = np.full(n, np.inf)
        self._timer = SafetyTimer(shape)
        self._command = np.ones(shape)
        self._set_point = np.full(shape, self.parameters.creepage)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""
        p = self.parameters
        step = self.wheels.update(measurement, self._command, self._calm <= p.calm_s)[:, None]
        self._estimate_pressure(step, measurement.demand)
        self._adapt(step)
        reference = self.wheels.reference[:, None]
        target = np.maximum(self._set_point * reference, p.least_slip_mps)
        slip = reference - self.wheels.speed
        self._engaged |= slip > p.active_slip * target
        error = target - slip
        self._integral = np.clip(self._integral + p.integral * error * step, 0.0, 1.0)
        fresh = self._engaged & (self._command > 0.5) & (self._integral >= 1.0)
        self._integral = np.where(fresh, np.minimum(self._pressure, 1.0), self._integral)  # begin from what the cylinder has
        excess = np.minimum(self.wheels.acceleration + p.reference_bound_mps2, 0.0)
        wanted = self._integral + p.proportional * error + p.damping * excess
        over = self._engaged & (wanted >= 1.0) & (slip < p.release_share * target)
        self._engaged &= ~over
        command = np.where(
            wanted > self._pressure + p.dead_band, APPLIES, np.where(wanted < self._pressure - p.dead_band, VENTS, HOLDS)
        )
        command = np.where(self._engaged, command, APPLIES)
        command[self.wheels.released] = VENTS
        command[self.wheels.failed] = APPLIES
        command[self._timer.expired(command > 0.5, step, p.safety_timer_s, p.safety_rest_s)] = APPLIES
        command[(reference < p.cut_out_mps)[:, 0]] = APPLIES
        self._calm = np.where((command > 0.5).all(axis=1), self._calm + step[:, 0], 0.0)
        self._command = command
        return command

    def _estimate_pressure(self, step: np.ndarray, demand: np.ndarray) -> None:
        """Follow the cylinder pressures by the brake's nominal time constants and the last commands."""
        brake = self._brake
        self._distributor = np.minimum(self._distributor + step[:, 0] / brake.demand_rise_s, demand)
        target = np.where(self._command > 0.5, self._distributor[:, None], np.where(self._command < -0.5, 0.0, self._pressure))
        constant = np.where(target > self._pressure, brake.fill_time_constant_s, brake.vent_time_constant_s)
        self._pressure += (1.0 - np.exp(-step / constant)) * (target - self._pressure)

    def _adapt(self, step: np.ndarray) -> None:
        """Keep the set-point; the extremum seeker moves it."""
