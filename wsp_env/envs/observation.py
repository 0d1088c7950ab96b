"""What a learned policy sees of the measurements."""

import numpy as np

from wsp_env.envs.rail import MEMORY_S, RECOVERY_M_PER_J, Rail
from wsp_env.envs.reckoning import ADHESION_FILTER_S, Reckoning
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


class Observer:
    """Builds the observation from the history of measurements and own commands.

    The environments and any deployed policy share this class: a policy that was trained on the one runs on the other.

    Observation, float32 (N, size), in this order; the first ten hold one value per axle:

    ========================  ==================================================================================
    slip                      reckoned running speed less peripheral wheel speed, / 5 m/s
    creepage                  the same over the running speed
    wheel acceleration        of the peripheral speed, low-passed, / 10 m/s2
    brake                     adhesion that the cylinder pressure asks for, / 0.1; from the sensors where there are any,
                              otherwise reckoned
    brake to come             the same once the commands on their way have acted
    used adhesion             reckoned, / 0.1
    recent slip               low-passed over half a second, / 5 m/s
    recent adhesion           the same of the used adhesion, / 0.1
    slow slip                 low-passed over four seconds, / 5 m/s
    slow adhesion             the same of the used adhesion, / 0.1
    friction of the rail      mu_cd that fits what was seen, for each of four rates of recovery, / 0.05 (four values)
    contradiction             deviation of its logarithm, for each of these rates: log10 of it over 0.05 (four values)
    seen                      how long wheels have slid, fading, / 8 s (one value)
    uncertainty               standard deviation of the running speed, / 0.2 m/s (one value)
    in doubt                  1 while a wheelset should roll for the running speed to become certain (one value)
    offered brake             of the distributor's pressure, / 0.1 (one value)
    running speed             reckoned, / 50 m/s (one value)
    demanded brake            / 0.1 (one value)
    ========================  ==================================================================================

    What is reckoned is explained in `wsp_env.envs.reckoning` and `wsp_env.envs.rail`. Pressures are seen as the adhesion that
    they ask of a wheelset under its nominal load: what a policy learns on one brake holds for a stronger one.

    Parameters
    ----------
    vehicle : for its number of axles and nominal values
    control_interval_s : time between observations [s]
    pressure_sensors : measurements hold cylinder pressures
    by_pressure : commands are pressures

    """

    SLIP_SCALE = 5.0  # [m/s]
    SPEED_SCALE = 50.0  # [m/s]
    ACCELERATION_SCALE = 10.0  # [m/s2]
    ADHESION_SCALE = 0.1
    FRICTION_SCALE = 0.05
    CONTRADICTION_SCALE = 0.05
    UNCERTAINTY_SCALE = 0.2  # [m/s]
    ACCELERATION_FILTER_S = 0.08  # time constant [s]
    RECENT_S = 0.5  # time constants of recent and slow slip and adhesion [s]
    SLOW_S = 4.0
    CREEPAGE_FLOOR = 1.0  # [m/s]; below this running speed the creepage fades out
    BOUND = 10.0  # observations are clipped to this magnitude

    def __init__(
        self, vehicle: Vehicle, control_interval_s: float, pressure_sensors: bool = False, by_pressure: bool = False
    ) -> None:
        self.axles = vehicle.axles
        self.radius = vehicle.wheel_radius_m
        self.full_pressure = vehicle.brake.full_pressure_bar
        self.interval = control_interval_s
        self.pressure_sensors = pressure_sensors
        self.size = self.size_for(self.axles)
        self.reckoning = Reckoning(vehicle, control_interval_s, by_pressure)
        self.rail = Rail(vehicle, control_interval_s)
        self._smooth = 1.0 - np.exp(-control_interval_s / ADHESION_FILTER_S)
        self._acceleration_gain = 1.0 - np.exp(-control_interval_s / self.ACCELERATION_FILTER_S)
        self._gains = 1.0 - np.exp(-control_interval_s / np.array([self.RECENT_S, self.SLOW_S]))[:, None, None]

    @staticmethod
    def size_for(axles: int) -> int:
        """Return the length of an observation."""
        return 10 * axles + 2 * len(RECOVERY_M_PER_J) + 6

    def reset(self, measurement: Measurement, mask: np.ndarray | None = None) -> np.ndarray:
        """Begin new stops, of all N vehicles or where `mask` (N,) is True; return all observations (N, size)."""
        speed = self.radius * measurement.wheel_speed
        if mask is None:
            self._speed = speed.copy()
            self._acceleration = np.zeros_like(speed)
            self._slips, self._adhesions = np.zeros((2, *speed.shape)), np.zeros((2, *speed.shape))  # recent and slow
            self._slip = np.zeros_like(speed)  # smoothed as the used adhesion is
            self.reckoning.reset(speed)
            self.rail.reset(len(speed))
        else:
            self._speed[mask] = speed[mask]
            self._acceleration[mask] = 0.0
            self._slips[:, mask] = self._adhesions[:, mask] = 0.0
            self._slip[mask] = 0.0
            self.reckoning.reset(speed, mask)
            self.rail.reset(len(speed), mask)
        return self._build(measurement)

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observation (N, size)."""
        speed = self.radius * measurement.wheel_speed
        rate = (speed - self._speed) / self.interval
        self._acceleration += self._acceleration_gain * (rate - self._acceleration)
        self._speed = speed
        measured = None
        if self.pressure_sensors:
            if measurement.pressure is None:
                raise ValueError("this observer needs cylinder pressures, the measurement has none")
            measured = measurement.pressure / self.full_pressure
        self.reckoning.update(speed, np.array(command, dtype=np.float64), measurement.demand, measured)
        slip = self.reckoning.speed[:, None] - speed
        self._slip += self._smooth * (slip - self._slip)
        self.rail.update(self._slip, self.reckoning.adhesion, self.reckoning.speed)
        self._slips += self._gains * (slip - self._slips)
        self._adhesions += self._gains * (self.reckoning.adhesion - self._adhesions)
        return self._build(measurement)

    def _build(self, measurement: Measurement) -> np.ndarray:
        reckoned = self.reckoning
        running = reckoned.speed[:, None]
        slip = running - self._speed
        brake = reckoned.full_brake / self.ADHESION_SCALE
        blocks = [
            slip / self.SLIP_SCALE,
            slip / np.maximum(running, self.CREEPAGE_FLOOR),
            self._acceleration / self.ACCELERATION_SCALE,
            brake * reckoned.pressure,
            brake * reckoned.pressure_to_come(),
            reckoned.adhesion / self.ADHESION_SCALE,
            self._slips[0] / self.SLIP_SCALE,
            self._adhesions[0] / self.ADHESION_SCALE,
            self._slips[1] / self.SLIP_SCALE,
            self._adhesions[1] / self.ADHESION_SCALE,
            self.rail.friction / self.FRICTION_SCALE,
            np.log10(np.maximum(self.rail.deviation, 1e-3) / self.CONTRADICTION_SCALE),
            self.rail.seen[:, None] / MEMORY_S,
            reckoned.uncertainty[:, None] / self.UNCERTAINTY_SCALE,
            reckoned.doubtful[:, None],
            brake * reckoned.offered[:, None],
            running / self.SPEED_SCALE,
            brake * measurement.demand[:, None],
        ]
        return np.clip(np.concatenate(blocks, axis=1), -self.BOUND, self.BOUND).astype(np.float32)
