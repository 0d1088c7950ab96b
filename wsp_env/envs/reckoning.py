"""Dead reckoning of what no sensor measures: running speed, cylinder pressures and the adhesion that each wheelset uses.

The pressures follow from the own commands and the brake's nominal times. With them the wheel's balance gives the force of the
rail, T = (C + J dw/dt) / r, and the sum of these forces slows the vehicle, dv/dt = -sum T / M. The mass is not known: a Kalman
filter of two states, the running speed v and q = nominal over true mass, is corrected whenever a wheelset rolls, which one does
that is braked far less than before, by any wheel that turns faster than the vehicle could run, and gently by the fastest wheel
as long as none has slid.
"""

import numpy as np

from wsp_env.parameters.vehicle import Vehicle

#: A wheelset that the reckoned brake asks for less adhesion than this [-] for `ROLLING_S` [s] rolls (assumption: half the
#: adhesion of rail that the standard's tests call extremely low); so does one that is asked for less than this share of what it
#: has used of late, low-passed with a time constant [s] (assumption).
ROLLING_ADHESION = 0.015
ROLLING_SHARE = 0.5
ROLLING_S = 0.04
USED_FILTER_S = 2.0

#: It then slips by so much [m/s] (assumption: half the creep at which the poorest rail carries that adhesion).
ROLLING_CREEP_MPS = 0.02

#: Standard deviations (assumptions): of a rolling wheel's speed against the vehicle's [m/s], of the fastest braked one's before
#: the first slide (large, as its errors at neighbouring times are alike), of the running speed at the start [m/s], of q at the
#: start [-], and what both drift in a second [m/s / sqrt(s)], [1 / sqrt(s)].
ROLLING_DEVIATION_MPS = 0.1
BRAKED_DEVIATION_MPS = 1.0
START_DEVIATION_MPS = 0.05
MASS_DEVIATION = 0.04
SPEED_DRIFT = 0.02
MASS_DRIFT = 0.002

#: A wheel so much faster than the reckoned running speed [m/s], as a mean over the time constant [s], corrects it although it
#: may slide; not smoothed, the noise of the sensors alone would drive the running speed up (assumptions).
FASTER_MPS = 0.15
FASTER_FILTER_S = 0.1

#: Standard deviation of the running speed [m/s] from which it is in doubt, and below which no longer: a good moment to let a
#: wheelset roll.
DOUBTFUL_MPS, CERTAIN_MPS = 0.3, 0.12

#: A wheel slides that runs slower than the reckoned speed by more than this creepage [-]: more than wheels that roll under full
#: brake. For so long after the last slide [s] the speed may be in doubt, not longer: where nothing slides no wheelset is to be
#: released for its sake (assumptions).
SLIDING_CREEPAGE_SEEN = 0.008
SLIDE_REMEMBERED_S = 2.0

#: Below this speed nothing is in doubt [m/s]: errors of the slip matter less, and a stop is nearly over.
SLOW_MPS = 10.0

#: Bounds of q [-].
MASS_RANGE = (0.8, 1.25)

#: Time constant by which the used adhesion is smoothed [s]; half the brake's own times.
ADHESION_FILTER_S = 0.1


def full_brake(vehicle: Vehicle) -> float:
    """Return the adhesion [-] that full pressure asks of a wheelset with half the payload on board."""
    weight = (vehicle.mass_kg + 0.5 * vehicle.payload_kg) * vehicle.gravity_mps2 / vehicle.axles
    return vehicle.full_brake_torque_nm / vehicle.wheel_radius_m / weight


class Reckoning:
    """The estimates for N vehicles with A axles; attributes to read, never to keep.

    `speed` (N,) [m/s], `uncertainty` (N,) its standard deviation [m/s], `doubtful` (N,) bool, `pressure` (N, A) share of full
    pressure, `adhesion` (N, A) used, T / N [-]; and `full_brake`, the adhesion that full pressure asks for [-].

    Parameters
    ----------
    vehicle : nominal values; half the payload on board
    interval : time between measurements [s]
    by_pressure : commands are pressures

    """

    def __init__(self, vehicle: Vehicle, interval: float, by_pressure: bool = False) -> None:
        brake = vehicle.brake
        self.interval = interval
        self._by_pressure = by_pressure
        self._mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
        self._axle_weight = self._mass * vehicle.gravity_mps2 / vehicle.axles
        self._full_force = vehicle.full_brake_torque_nm / vehicle.wheel_radius_m
        self.full_brake = full_brake(vehicle)
        self._rotating = vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
        self._rise = interval / brake.demand_rise_s
        self._dead_steps = round(brake.dead_time_s / interval)
        self._fill = 1.0 - np.exp(-interval / brake.fill_time_constant_s)
        self._vent = 1.0 - np.exp(-interval / brake.vent_time_constant_s)
        self._usual = 1.0 - np.exp(-interval / USED_FILTER_S)
        self._smooth = 1.0 - np.exp(-interval / ADHESION_FILTER_S)
        self._lift = 1.0 - np.exp(-interval / FASTER_FILTER_S)

    def reset(self, wheel: np.ndarray, rows: np.ndarray | slice = slice(None)) -> None:
        """Begin new stops, of all vehicles or of `rows`, from the peripheral wheel speeds (N, A) [m/s]."""
        if isinstance(rows, slice):
            n, axles = wheel.shape
            self.speed, self.pressure = np.zeros(n), np.zeros((n, axles))
            self.adhesion, self._wheel, self._unbraked = np.zeros((n, axles)), np.zeros((n, axles)), np.zeros((n, axles))
            self._used = np.zeros((n, axles))  # adhesion of late [-]
            self._ahead = np.zeros((n, axles))  # of the running speed, smoothed [m/s]
            self._supply, self._demand, self._q = np.zeros(n), np.zeros(n), np.ones(n)
            self._way = np.ones((self._dead_steps + 1, n, axles))  # commands on their way to the valves
            self.doubtful = np.zeros(n, dtype=bool)
            self._slid = np.zeros(n)  # time since a wheel slid [s]; inf: none has
            self._p_vv, self._p_vq, self._p_qq = np.zeros(n), np.zeros(n), np.zeros(n)
        self.speed[rows] = wheel[rows].max(axis=1)
        self._wheel[rows] = wheel[rows]
        self.doubtful[rows] = False
        for array in (self.pressure, self.adhesion, self._used, self._unbraked, self._ahead, self._supply, self._p_vq):
            array[rows] = 0.0
        self._q[rows] = 1.0
        self._way[:, rows] = 1.0
        self._slid[rows] = np.inf
        self._p_vv[rows] = START_DEVIATION_MPS**2
        self._p_qq[rows] = MASS_DEVIATION**2

    @property
    def uncertainty(self) -> np.ndarray:
        """Standard deviation of the running speed (N,) [m/s]."""
        return np.sqrt(self._p_vv)

    def update(self, wheel: np.ndarray, command: np.ndarray, demand: np.ndarray, measured: np.ndarray | None = None) -> None:
        """Go on by one interval, at the end of which the wheels have the peripheral speeds `wheel` (N, A) [m/s].

        Parameters
        ----------
        command : (N, A) given at the start of the interval: vent -1, hold 0, apply 1; or the pressure -1 to 1
        demand : (N,) share of full pressure
        measured : (N, A) pressures of sensors, share of full pressure; None: they are reckoned

        """
        before = self.pressure
        self._demand = demand
        self._follow_brake(command, measured)
        impulse = self._full_force * 0.5 * (before + self.pressure) * self.interval  # of the brake
        impulse = impulse + self._rotating * (wheel - self._wheel)
        self._wheel = wheel
        used = impulse / (self._axle_weight * self.interval)
        self.adhesion = self.adhesion + self._smooth * (used - self.adhesion)
        self._predict(impulse.sum(axis=1) / self._mass)
        below = self.rolling_adhesion
        rolls = (self.full_brake * self.pressure < below) & (used < below)
        self._unbraked = np.where(rolls, self._unbraked + self.interval, 0.0)
        self._used = self._used + self._usual * (self.adhesion - self._used)
        for k in range(wheel.shape[1]):
            self._correct(wheel[:, k] + ROLLING_CREEP_MPS, self._unbraked[:, k] >= ROLLING_S, ROLLING_DEVIATION_MPS)
        self._correct(wheel.max(axis=1) + ROLLING_CREEP_MPS, np.isinf(self._slid), BRAKED_DEVIATION_MPS)
        self._raise(wheel)
        np.maximum(self.speed, 0.0, out=self.speed)
        slides = (-self._ahead > SLIDING_CREEPAGE_SEEN * self.speed[:, None]).any(axis=1)
        self._slid = np.where(slides, 0.0, self._slid + self.interval)
        doubt = self.uncertainty
        doubtful = (doubt > DOUBTFUL_MPS) | (self.doubtful & (doubt > CERTAIN_MPS))
        self.doubtful = doubtful & (self.speed > SLOW_MPS) & (self._slid < SLIDE_REMEMBERED_S)

    @property
    def rolling_adhesion(self) -> np.ndarray:
        """Adhesion (N, A) [-] that a wheelset which rolls is asked for at most."""
        return np.maximum(ROLLING_ADHESION, ROLLING_SHARE * self._used)

    @property
    def offered(self) -> np.ndarray:
        """Pressure that the distributor offers (N,), share of full pressure."""
        return self._supply

    def pressure_to_come(self) -> np.ndarray:
        """Return the pressures (N, A) once the commands on their way have acted, share of full pressure."""
        coming = self.pressure
        for acts in self._way[-2::-1]:
            coming = self._after(coming, acts, self._supply[:, None])
        return coming

    def _after(self, pressure: np.ndarray, acts: np.ndarray, offered: np.ndarray) -> np.ndarray:
        target = np.where(acts > 0.5, offered, np.where(acts < -0.5, 0.0, pressure))
        if self._by_pressure:
            target = np.minimum(0.5 * (acts + 1.0) * self._demand[:, None], offered)
        after: np.ndarray = pressure + np.where(target > pressure, self._fill, self._vent) * (target - pressure)
        return after

    def _follow_brake(self, command: np.ndarray, measured: np.ndarray | None) -> None:
        self._way = np.concatenate([command[None], self._way[:-1]])
        self._supply = np.clip(self._demand, self._supply - self._rise, self._supply + self._rise)
        self.pressure = self._after(self.pressure, self._way[-1], self._supply[:, None]) if measured is None else measured

    def _predict(self, slowed: np.ndarray) -> None:
        """Slow the vehicles by q times what the nominal mass would lose (N,) [m/s]."""
        self.speed = self.speed - self._q * slowed
        self._p_vv = self._p_vv - 2.0 * slowed * self._p_vq + slowed**2 * self._p_qq + SPEED_DRIFT**2 * self.interval
        self._p_vq = self._p_vq - slowed * self._p_qq
        self._p_qq = self._p_qq + MASS_DRIFT**2 * self.interval

    def _raise(self, wheel: np.ndarray) -> None:
        """Follow the fastest of the wheels (N, A) [m/s] where it runs ahead; it may slide: nothing becomes more certain."""
        self._ahead += self._lift * (wheel - self.speed[:, None] - self._ahead)
        fastest = self._ahead.max(axis=1)
        missing = np.where(fastest > FASTER_MPS, fastest, 0.0)
        self.speed = self.speed + missing
        self._ahead -= missing[:, None]
        self._q = np.clip(self._q + self._p_vq / np.maximum(self._p_vv, 1e-9) * missing, *MASS_RANGE)

    def _correct(self, seen: np.ndarray, where: np.ndarray, deviation: float) -> None:
        """Take `seen` (N,) with its standard deviation, both [m/s], for the running speed, where it can be."""
        share = np.where(where, 1.0 / (self._p_vv + deviation**2), 0.0)
        gain_v, gain_q = self._p_vv * share, self._p_vq * share
        missing = seen - self.speed
        self.speed = self.speed + gain_v * missing
        self._q = np.clip(self._q + gain_q * missing, *MASS_RANGE)
        self._p_qq = self._p_qq - gain_q * self._p_vq
        self._p_vq = self._p_vq - gain_v * self._p_vq
        self._p_vv = self._p_vv - gain_v * self._p_vv
