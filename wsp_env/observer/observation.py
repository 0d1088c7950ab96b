"""The observation of a learned policy, built from measurements and commands."""

import math
from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined, loop, plain, rebuilder
from wsp_env.observer import estimate, estimator, rail
from wsp_env.observer.estimate import EstimatorConstants, VehicleEstimate
from wsp_env.observer.rail import RailEstimate, RailEstimateConstants
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


class Filtered(NamedTuple):
    """Low-passed quantities of the observer in addition to its estimates; (N, A) unless stated otherwise, changed in place."""

    acceleration: np.ndarray  # rate of the circumferential speed [m/s2]
    slip: np.ndarray  # smoothed like the used adhesion [m/s]
    recent_slip: np.ndarray  # low-passed over half a second [m/s]
    recent_adhesion: np.ndarray  # used adhesion, low-passed over half a second [-]
    slow_slip: np.ndarray  # low-passed over four seconds [m/s]
    slow_adhesion: np.ndarray  # used adhesion, low-passed over four seconds [-]
    contradiction: np.ndarray  # (N, K) log10 of the deviations of the rail estimates, as observed


class Memory(NamedTuple):
    """The state of an observer."""

    estimate: VehicleEstimate
    rail: RailEstimate
    filtered: Filtered


class ObserverConstants(NamedTuple):
    """The constants of an observer, see `Observer`."""

    estimator: EstimatorConstants
    rail: RailEstimateConstants
    acceleration: float  # gains of the low-passes in an interval [-]
    recent: float
    slow: float


class Observer:
    """Builds the observation from the history of measurements and own commands.

    The environments and all deployed policies share this class, so that a policy sees the same input in both. Observation,
    float32 (N, size), in this order; the first ten hold one value per axle:

    ========================  ==================================================================================
    slip                      estimated running speed less circumferential wheel speed, / 5 m/s
    creepage                  the same over the running speed
    wheel acceleration        of the circumferential speed, low-passed, / 10 m/s2
    brake                     adhesion that the cylinder pressure requires, / 0.1; measured if there are sensors,
                              otherwise estimated
    brake to come             the same once the commands under way have acted
    used adhesion             estimated, / 0.1
    recent slip               low-passed over half a second, / 5 m/s
    recent adhesion           used adhesion, low-passed over half a second, / 0.1
    slow slip                 low-passed over four seconds, / 5 m/s
    slow adhesion             used adhesion, low-passed over four seconds, / 0.1
    friction of the rail      mu_cd that fits the data, for each of four recovery rates, / 0.05 (four values)
    contradiction             log10 of (standard deviation of log mu_cd / 0.05), for each of these rates (four values)
    seen                      time for which wheels have slid, fading, / 8 s (one value)
    uncertainty               standard deviation of the running speed, / 0.2 m/s (one value)
    in doubt                  1 while a wheelset should roll to make the running speed certain (one value)
    distributor               adhesion that the distributor's pressure requires, / 0.1 (one value)
    running speed             estimated, / 50 m/s (one value)
    demanded brake            adhesion that it requires, / 0.1 (one value)
    ========================  ==================================================================================

    `wsp_env.observer.estimate` and `wsp_env.observer.rail` list the estimates; the attributes `estimate` and `rail` hold
    them. Pressures are expressed as the adhesion that they require of a wheelset under its nominal load, so that a policy
    trained with one brake also applies to a stronger one.

    Parameters
    ----------
    vehicle : for its number of axles and nominal values
    control_interval_s : time between observations [s]
    pressure_sensors : whether measurements contain cylinder pressures
    by_pressure : whether commands are pressures

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
    CREEPAGE_FLOOR = 1.0  # [m/s]; divisor of the creepage at lower running speeds
    BOUND = 10.0  # observations are clipped to this magnitude

    def __init__(
        self, vehicle: Vehicle, control_interval_s: float, pressure_sensors: bool = False, by_pressure: bool = False
    ) -> None:
        self.vehicle = vehicle
        self.interval = control_interval_s
        self.pressure_sensors = pressure_sensors
        self.size = self.size_for(vehicle.axles)
        self.given = plain(_constants_of(vehicle, control_interval_s, by_pressure))

    @staticmethod
    def size_for(axles: int) -> int:
        """Return the length of an observation."""
        return 10 * axles + 2 * len(rail.RECOVERY_M_PER_J) + 6

    @property
    def estimate(self) -> VehicleEstimate:
        """Estimates for the vehicles; read them, do not keep references."""
        return self._memory.estimate

    @property
    def rail(self) -> RailEstimate:
        """Estimates for their rails; read them, do not keep references."""
        return self._memory.rail

    @property
    def filtered(self) -> Filtered:
        """Low-passed quantities; read them, do not keep references."""
        return self._memory.filtered

    def reset(self, measurement: Measurement, mask: np.ndarray | None = None) -> np.ndarray:
        """Begin new stops, of all N vehicles or where `mask` (N,) is True; return all observations (N, size)."""
        wheel_speed = np.array(measurement.wheel_speed, np.float64, order="C")
        n = len(wheel_speed)
        if mask is None:
            mask = np.ones(n, dtype=bool)
            self._memory = _allocate(n, self.vehicle, self.interval)
            self.state = plain(self._memory)
            self._observation = np.zeros((n, self.size), dtype=np.float32)
        demand = np.array(measurement.demand, np.float64, order="C")
        self._check(wheel_speed, demand)
        _begin(np.array(mask, dtype=bool), wheel_speed, demand, self.state, self.given, self._observation)
        return self._observation.copy()

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observations (N, size)."""
        wheel_speed = np.array(measurement.wheel_speed, np.float64, order="C")
        demand = np.array(measurement.demand, np.float64, order="C")
        command = np.array(command, np.float64, order="C")
        pressure = _NO_SENSORS
        if self.pressure_sensors:
            if measurement.pressure is None:
                raise ValueError("this observer needs cylinder pressures, the measurement has none")
            pressure = np.array(measurement.pressure, np.float64, order="C")
            self._check(pressure, demand)
        self._check(wheel_speed, demand)
        self._check(command, demand)
        _observe(wheel_speed, command, demand, pressure, self.state, self.given, self._observation)
        return self._observation.copy()

    def _check(self, per_axle: np.ndarray, per_vehicle: np.ndarray) -> None:
        """Refuse arrays with shapes other than (N, A) and (N,); the kernels would read beyond their ends."""
        n, axles = self.estimate.wheel.shape
        if per_axle.shape != (n, axles) or per_vehicle.shape != (n,):
            given = f"{per_axle.shape} and {per_vehicle.shape}"
            raise ValueError(f"the observer was reset for {n} vehicles of {axles} axles, not for arrays of {given}")


#: Empty pressures of a vehicle without pressure sensors.
_NO_SENSORS = np.empty((0, 0))

# Factors on the observed values.
_PER_SLIP, _PER_SPEED, _PER_ACCELERATION = 1 / Observer.SLIP_SCALE, 1 / Observer.SPEED_SCALE, 1 / Observer.ACCELERATION_SCALE
_PER_ADHESION, _PER_FRICTION, _PER_MEMORY = 1 / Observer.ADHESION_SCALE, 1 / Observer.FRICTION_SCALE, 1 / rail.MEMORY_S
_PER_CONTRADICTION, _PER_UNCERTAINTY = 1 / Observer.CONTRADICTION_SCALE, 1 / Observer.UNCERTAINTY_SCALE
_CREEPAGE_FLOOR, _BOUND = Observer.CREEPAGE_FLOOR, Observer.BOUND


def _constants_of(vehicle: Vehicle, interval: float, by_pressure: bool) -> ObserverConstants:
    return ObserverConstants(
        estimator=estimate.constants(vehicle, interval, by_pressure),
        rail=rail.constants(vehicle, interval),
        acceleration=estimate.approach(interval, Observer.ACCELERATION_FILTER_S),
        recent=estimate.approach(interval, Observer.RECENT_S),
        slow=estimate.approach(interval, Observer.SLOW_S),
    )


def _allocate(n: int, vehicle: Vehicle, interval: float) -> Memory:
    widths = {"contradiction": len(rail.RECOVERY_M_PER_J)}
    filtered = Filtered(*(np.zeros((n, widths.get(name, vehicle.axles))) for name in Filtered._fields))
    return Memory(estimate.allocate(n, vehicle, interval), rail.allocate(n), filtered)


#: Kernels that rebuild `Memory` and `ObserverConstants` from `Observer.state` and `Observer.given`, for other compiled code.
memory_of = rebuilder(_allocate(1, COACH, 0.02))
constants_of = rebuilder(_constants_of(COACH, 0.02, False))


@loop
def _begin(
    mask: np.ndarray, wheel_speed: np.ndarray, demand: np.ndarray, state: Any, given: Any, observation: np.ndarray
) -> None:
    """Begin new stops where `mask` (N,) is True; write their first observations into `observation` (N, size)."""
    memory, c = memory_of(state), constants_of(given)
    f = memory.filtered
    for i in range(len(mask)):
        if mask[i]:
            estimator.begin(i, wheel_speed, memory.estimate, c.estimator)
            rail.begin(i, memory.rail)
            for k in range(wheel_speed.shape[1]):
                f.acceleration[i, k] = f.slip[i, k] = 0.0
                f.recent_slip[i, k] = f.recent_adhesion[i, k] = f.slow_slip[i, k] = f.slow_adhesion[i, k] = 0.0
            _contradict(i, memory)
            _write(i, demand[i], memory, c, observation)


@loop
def _observe(
    wheel_speed: np.ndarray, command: np.ndarray, demand: np.ndarray, pressure: np.ndarray,
    state: Any, given: Any, observation: np.ndarray,
) -> None:  # fmt: skip
    """Update every vehicle by one interval, see `Observer.observe`; pressures (N, A), or (0, 0) without sensors [bar]."""
    memory, c = memory_of(state), constants_of(given)
    e, f = memory.estimate, memory.filtered
    n, axles = wheel_speed.shape
    for i in range(n):
        for k in range(axles):
            rate = (c.estimator.radius * wheel_speed[i, k] - e.wheel[i, k]) / c.estimator.interval
            f.acceleration[i, k] += c.acceleration * (rate - f.acceleration[i, k])
        estimator.update(i, wheel_speed, command, demand[i], pressure, e, c.estimator)
        for k in range(axles):
            slip = e.speed[i] - e.wheel[i, k]
            f.slip[i, k] += c.estimator.smooth * (slip - f.slip[i, k])
            f.recent_slip[i, k] += c.recent * (slip - f.recent_slip[i, k])
            f.slow_slip[i, k] += c.slow * (slip - f.slow_slip[i, k])
            f.recent_adhesion[i, k] += c.recent * (e.adhesion[i, k] - f.recent_adhesion[i, k])
            f.slow_adhesion[i, k] += c.slow * (e.adhesion[i, k] - f.slow_adhesion[i, k])
        if rail.update(i, f.slip, e.adhesion, e.speed[i], memory.rail, c.rail):
            _contradict(i, memory)
        _write(i, demand[i], memory, c, observation)


@inlined
def _contradict(i: int, memory: Memory) -> None:
    for j in range(memory.rail.deviation.shape[1]):
        deviation = max(memory.rail.deviation[i, j], 1e-3)
        memory.filtered.contradiction[i, j] = math.log10(deviation * _PER_CONTRADICTION)


@inlined
def _write(i: int, demand: float, memory: Memory, c: ObserverConstants, observation: np.ndarray) -> None:
    """Write the observation of vehicle i with the demand as a share of full pressure; see `Observer`."""
    e, r, f = memory.estimate, memory.rail, memory.filtered
    axles, rates = e.wheel.shape[1], r.friction.shape[1]
    brake = c.estimator.full_brake * _PER_ADHESION
    running = e.speed[i]
    per_running = 1.0 / max(running, _CREEPAGE_FLOOR)
    for k in range(axles):
        slip = running - e.wheel[i, k]
        observation[i, k] = _clipped(slip * _PER_SLIP)
        observation[i, axles + k] = _clipped(slip * per_running)
        observation[i, 2 * axles + k] = _clipped(f.acceleration[i, k] * _PER_ACCELERATION)
        observation[i, 3 * axles + k] = _clipped(brake * e.pressure[i, k])
        observation[i, 4 * axles + k] = _clipped(brake * e.pressure_to_come[i, k])
        observation[i, 5 * axles + k] = _clipped(e.adhesion[i, k] * _PER_ADHESION)
        observation[i, 6 * axles + k] = _clipped(f.recent_slip[i, k] * _PER_SLIP)
        observation[i, 7 * axles + k] = _clipped(f.recent_adhesion[i, k] * _PER_ADHESION)
        observation[i, 8 * axles + k] = _clipped(f.slow_slip[i, k] * _PER_SLIP)
        observation[i, 9 * axles + k] = _clipped(f.slow_adhesion[i, k] * _PER_ADHESION)
    at = 10 * axles
    for j in range(rates):
        observation[i, at + j] = _clipped(r.friction[i, j] * _PER_FRICTION)
        observation[i, at + rates + j] = _clipped(f.contradiction[i, j])
    at += 2 * rates
    observation[i, at] = _clipped(r.seen[i] * _PER_MEMORY)
    observation[i, at + 1] = _clipped(e.uncertainty[i] * _PER_UNCERTAINTY)
    observation[i, at + 2] = 1.0 if e.doubtful[i] else 0.0
    observation[i, at + 3] = _clipped(brake * e.distributor[i])
    observation[i, at + 4] = _clipped(running * _PER_SPEED)
    observation[i, at + 5] = _clipped(brake * demand)


@inlined
def _clipped(value: float) -> float:
    return min(max(value, -_BOUND), _BOUND)
