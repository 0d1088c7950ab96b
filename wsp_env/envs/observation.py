"""What a controller gets (`Measurement`) and what a learned policy sees of it (`Observer`)."""

from typing import NamedTuple

import numpy as np

from wsp_env.parameters.vehicle import Vehicle


class Measurement(NamedTuple):
    """What the sensors of N vehicles with A axles say at one moment; never the true speed or adhesion."""

    time: np.ndarray  # (N,) since the start of the stop [s]
    wheel_speed: np.ndarray  # (N, A) from the tachometers [rad/s]
    demand: np.ndarray  # (N,) brake demand, 0 to 1 of full pressure [-]
    pressure: np.ndarray | None = None  # (N, A) in the cylinders [bar], only where the vehicle has the sensors


class Observer:
    """Builds the observation from the history of measurements and own commands.

    The environments and any deployed policy share this class: a policy that was trained on the one runs on the other.

    Observation, float32 (N, size), in this order; each block but the last two holds one value per axle:

    ========================  ==================================================================================
    wheel speed               peripheral speed / 50 m/s
    wheel acceleration        of the peripheral speed, low-passed, / 10 m/s2
    estimated creepage        1 - peripheral speed / reference speed
    last command              as given: vent -1, hold 0, apply +1, or the pressure -1 to +1
    mean command              the same, low-passed: stands for the pressure where no sensor measures it
    cylinder pressure         / full pressure; only with pressure sensors
    reference speed           estimate of the running speed / 50 m/s (one value)
    demand                    0 to 1 (one value)
    ========================  ==================================================================================

    The reference speed is the fastest wheel, allowed to fall no faster than `DECELERATION_BOUND`.

    Parameters
    ----------
    vehicle : for its number of axles, nominal wheel radius and full pressure
    control_interval_s : time between observations [s]
    pressure_sensors : measurements hold cylinder pressures

    """

    SPEED_SCALE = 50.0  # [m/s]
    ACCELERATION_SCALE = 10.0  # [m/s2]
    ACCELERATION_FILTER_S = 0.08  # time constant [s]
    COMMAND_FILTER_S = 0.4  # time constant [s], between the brake's time constants and a valve cycle
    DECELERATION_BOUND = 1.5  # [m/s2]; assumption: a little above the best the brake can do (1.2 m/s2)
    CREEPAGE_FLOOR = 1.0  # [m/s]; below this reference speed the estimated creepage fades out
    BOUND = 10.0  # observations are clipped to this magnitude

    def __init__(self, vehicle: Vehicle, control_interval_s: float, pressure_sensors: bool = False) -> None:
        self.axles = vehicle.axles
        self.radius = vehicle.wheel_radius_m
        self.full_pressure = vehicle.brake.full_pressure_bar
        self.interval = control_interval_s
        self.pressure_sensors = pressure_sensors
        self.size = (6 if pressure_sensors else 5) * self.axles + 2
        self._acceleration_gain = 1.0 - np.exp(-control_interval_s / self.ACCELERATION_FILTER_S)
        self._command_gain = 1.0 - np.exp(-control_interval_s / self.COMMAND_FILTER_S)

    def reset(self, measurement: Measurement, mask: np.ndarray | None = None) -> np.ndarray:
        """Begin new stops, of all N vehicles or where `mask` (N,) is True; return all observations (N, size)."""
        speed = self.radius * measurement.wheel_speed
        if mask is None:
            self._speed = speed.copy()
            self._acceleration = np.zeros_like(speed)
            self._command = np.ones_like(speed)
            self._mean_command = np.ones_like(speed)
            self._reference = speed.max(axis=1)
        else:
            self._speed[mask] = speed[mask]
            self._acceleration[mask] = 0.0
            self._command[mask] = 1.0
            self._mean_command[mask] = 1.0
            self._reference[mask] = speed[mask].max(axis=1)
        return self._build(measurement)

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observation (N, size)."""
        speed = self.radius * measurement.wheel_speed
        rate = (speed - self._speed) / self.interval
        self._acceleration += self._acceleration_gain * (rate - self._acceleration)
        self._speed = speed
        self._command = np.array(command, dtype=np.float64)
        self._mean_command += self._command_gain * (self._command - self._mean_command)
        self._reference = np.maximum(speed.max(axis=1), self._reference - self.DECELERATION_BOUND * self.interval)
        return self._build(measurement)

    def _build(self, measurement: Measurement) -> np.ndarray:
        reference = self._reference[:, None]
        blocks = [
            self._speed / self.SPEED_SCALE,
            self._acceleration / self.ACCELERATION_SCALE,
            (reference - self._speed) / np.maximum(reference, self.CREEPAGE_FLOOR),
            self._command,
            self._mean_command,
        ]
        if self.pressure_sensors:
            if measurement.pressure is None:
                raise ValueError("this observer needs cylinder pressures, the measurement has none")
            blocks.append(measurement.pressure / self.full_pressure)
        blocks += [reference / self.SPEED_SCALE, measurement.demand[:, None]]
        return np.clip(np.concatenate(blocks, axis=1), -self.BOUND, self.BOUND).astype(np.float32)
