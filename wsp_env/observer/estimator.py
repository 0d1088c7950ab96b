"""Estimation of unmeasured states: running speed, cylinder pressures and the adhesion that each wheelset uses.

The pressures follow from the own commands and the brake's nominal times. With them, the wheel's balance gives the rail force T
= (C + J dw/dt) / r. The sum of these forces slows the vehicle: dv/dt = -sum T / M. The mass is unknown. A Kalman filter has the
states running speed v and q = nominal over true mass. It is corrected by rolling wheelsets (braked far less than before), by
any wheel that turns faster than the vehicle can run, and, until the first slide, weakly by the fastest wheel.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.observer import bounds
from wsp_env.parameters.vehicle import Vehicle

#: A wheelset rolls if its estimated brake requires less adhesion than this [-] for `ROLLING_S` [s] (assumption: half the
#: adhesion of rail that the standard's tests call extremely low), or less than this share of its recent low-passed use
#: (assumption). Its smoothed used adhesion must be below the limit too: a wheel released from a slide still accelerates to the
#: vehicle's speed, and sensor noise may hide this.
ROLLING_ADHESION = 0.015
ROLLING_SHARE = 0.5
ROLLING_S = 0.04
USED_FILTER_S = 2.0

#: Slip of a rolling wheelset [m/s] (assumption: half the creep at which the poorest rail carries that adhesion).
ROLLING_CREEP_MPS = 0.02

#: Standard deviations (assumptions): of a rolling wheel's speed against the vehicle's [m/s], of the fastest braked wheel's
#: before the first slide (large, because its errors at neighbouring times are correlated), of the initial running speed [m/s]
#: and q [-], and of the drift of both [m/s / sqrt(s)], [1 / sqrt(s)].
ROLLING_DEVIATION_MPS = 0.1
BRAKED_DEVIATION_MPS = 1.0
START_DEVIATION_MPS = 0.05
MASS_DEVIATION = 0.04
SPEED_DRIFT = 0.02
MASS_DRIFT = 0.002

#: A wheel faster than the estimated running speed by this much [m/s], as a mean over the time constant [s], corrects it
#: although the wheel may slide. Without smoothing, sensor noise alone would raise the running speed (assumptions).
FASTER_MPS = 0.15
FASTER_FILTER_S = 0.1

#: Standard deviations of the running speed [m/s] at which it becomes doubtful and certain again; if doubtful, a wheelset should
#: be released to roll.
DOUBTFUL_MPS, CERTAIN_MPS = 0.3, 0.12

#: A wheel slides if it is slower than the estimated speed by more than this creepage [-], which exceeds that of wheels that
#: roll under full brake. The speed may be doubtful only for this time after the last slide [s]: without slides, no wheelset is
#: to be released for the speed estimate (assumptions).
SLIDING_CREEPAGE_SEEN = 0.008
SLIDE_REMEMBERED_S = 2.0

#: Running speed below which nothing is doubtful [m/s]: slip errors matter less, and the stop is nearly over.
SLOW_MPS = 10.0

#: Bounds of q [-].
MASS_RANGE = (0.8, 1.25)

#: Time constant for smoothing the used adhesion [s]; half the brake's own times.
ADHESION_FILTER_S = 0.1


class VehicleEstimate(NamedTuple):
    """Estimates for N vehicles with A axles, changed in place: read them, do not keep references."""

    speed: np.ndarray  # (N,) running speed [m/s]
    uncertainty: np.ndarray  # (N,) its standard deviation [m/s]
    doubtful: np.ndarray  # (N,) bool, a wheelset should roll to make the running speed certain
    distributor: np.ndarray  # (N,) pressure of the distributor, share of full pressure [-]
    demand: np.ndarray  # (N,) last demand, share of full pressure [-]
    mass_ratio: np.ndarray  # (N,) q, nominal over true mass [-]
    speed_variance: np.ndarray  # (N,) variance of the running speed [m2/s2]
    covariance: np.ndarray  # (N,) covariance of running speed and q [m/s]
    mass_variance: np.ndarray  # (N,) variance of q [-]
    since_slide: np.ndarray  # (N,) time since a wheel slid [s]; inf: no wheel has
    wheel: np.ndarray  # (N, A) circumferential wheel speed [m/s]
    pressure: np.ndarray  # (N, A) cylinder pressure, share of full pressure [-]
    pressure_to_come: np.ndarray  # (N, A) cylinder pressure after all commands under way have acted [-]
    most_pressure: np.ndarray  # (N, A) highest possible cylinder pressure, see `wsp_env.observer.bounds` [-]
    vented: np.ndarray  # (N, A) time for which all commands under way have been to vent [s]
    unseen: np.ndarray  # (N, A) possible excess of the brake over the estimate, as an adhesion, smoothed [-]
    adhesion: np.ndarray  # (N, A) used adhesion T / N, smoothed [-]
    usual_adhesion: np.ndarray  # (N, A) used adhesion, low-passed with `USED_FILTER_S` [-]
    rolling_adhesion: np.ndarray  # (N, A) brake adhesion below which a wheelset rolls [-]
    rolling_time: np.ndarray  # (N, A) time below that limit [s]
    ahead: np.ndarray  # (N, A) wheel speed minus running speed, smoothed [m/s]
    trusted: np.ndarray  # (N, A) bool, the wheel's speed may correct the running speed, see `wsp_env.observer.guard`
    commands: np.ndarray  # (N, K, A) commands under way to the valves, newest first


class EstimatorConstants(NamedTuple):
    """Nominal values of the vehicle with half its payload, and gains of the filters in an interval."""

    radius: float  # of a wheel [m]
    full_pressure: float  # [bar]
    interval: float  # between measurements [s]
    by_pressure: bool  # whether commands are pressures
    mass: float  # [kg]
    axle_weight: float  # [N]
    full_force: float  # brake force of a wheelset at full pressure, at the tread [N]
    full_brake: float  # see `full_brake` [-]
    rotating: float  # a wheelset's inertia as an equivalent mass [kg]
    rise: float  # change of the distributor's pressure in an interval, share of full pressure [-]
    fill: float  # gain of the approach in an interval [-]: filling of a cylinder
    vent: float  # venting of a cylinder [-]
    fill_most: float  # fastest filling [-]
    vent_least: float  # slowest venting [-]
    usual: float  # gain of `USED_FILTER_S` [-]
    smooth: float  # gain of `ADHESION_FILTER_S` [-]
    lift: float  # gain of `FASTER_FILTER_S` [-]


def full_brake(vehicle: Vehicle) -> float:
    """Return the adhesion [-] that full pressure requires of a wheelset with half the payload."""
    weight = (vehicle.mass_kg + 0.5 * vehicle.payload_kg) * vehicle.gravity_mps2 / vehicle.axles
    return vehicle.full_brake_torque_nm / vehicle.wheel_radius_m / weight


def approach(interval: float, time_constant: float) -> float:
    """Return the gain [-] of a first-order low-pass in an interval; interval and time constant in [s]."""
    return float(1.0 - np.exp(-interval / time_constant))


def constants(vehicle: Vehicle, interval: float, by_pressure: bool) -> EstimatorConstants:
    """Return the constants for a measurement interval [s] and commands that are pressures or valve positions."""
    brake = vehicle.brake
    mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
    fastest, slowest = bounds.fill_and_vent(brake.fill_time_constant_s, brake.vent_time_constant_s)
    return EstimatorConstants(
        radius=vehicle.wheel_radius_m,
        full_pressure=brake.full_pressure_bar,
        interval=interval,
        by_pressure=by_pressure,
        mass=mass,
        axle_weight=mass * vehicle.gravity_mps2 / vehicle.axles,
        full_force=vehicle.full_brake_torque_nm / vehicle.wheel_radius_m,
        full_brake=full_brake(vehicle),
        rotating=vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2,
        rise=interval / brake.demand_rise_s,
        fill=approach(interval, brake.fill_time_constant_s),
        vent=approach(interval, brake.vent_time_constant_s),
        fill_most=approach(interval, fastest),
        vent_least=approach(interval, slowest),
        usual=approach(interval, USED_FILTER_S),
        smooth=approach(interval, ADHESION_FILTER_S),
        lift=approach(interval, FASTER_FILTER_S),
    )


def allocate(n: int, vehicle: Vehicle, interval: float) -> VehicleEstimate:
    """Allocate the estimates of n vehicles; `begin` sets their values."""
    axles = vehicle.axles
    per_vehicle = {"speed", "uncertainty", "distributor", "demand", "mass_ratio", "since_slide"}
    per_vehicle |= {"speed_variance", "covariance", "mass_variance"}
    arrays = {name: np.zeros(n if name in per_vehicle else (n, axles)) for name in VehicleEstimate._fields}
    arrays["doubtful"] = np.zeros(n, dtype=bool)
    arrays["trusted"] = np.ones((n, axles), dtype=bool)
    arrays["commands"] = np.zeros((n, round(vehicle.brake.dead_time_s / interval) + 1, axles))
    return VehicleEstimate(**arrays)


@inlined
def begin(i: int, wheel_speed: np.ndarray, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Begin a new stop of vehicle i, rolling with empty cylinders, from the measured wheel speeds (N, A) [rad/s]."""
    fastest = 0.0
    for k in range(wheel_speed.shape[1]):
        e.wheel[i, k] = c.radius * wheel_speed[i, k]
        fastest = max(fastest, e.wheel[i, k])
        e.pressure[i, k] = e.pressure_to_come[i, k] = 0.0
        e.most_pressure[i, k] = e.vented[i, k] = e.unseen[i, k] = 0.0
        e.adhesion[i, k] = e.usual_adhesion[i, k] = 0.0
        e.rolling_adhesion[i, k] = ROLLING_ADHESION
        e.rolling_time[i, k] = e.ahead[i, k] = 0.0
        e.trusted[i, k] = True
        for age in range(e.commands.shape[1]):
            e.commands[i, age, k] = 1.0
    e.speed[i], e.uncertainty[i], e.doubtful[i] = fastest, START_DEVIATION_MPS, False
    e.distributor[i] = e.demand[i] = 0.0
    e.mass_ratio[i], e.since_slide[i] = 1.0, math.inf
    e.speed_variance[i], e.covariance[i], e.mass_variance[i] = START_DEVIATION_MPS**2, 0.0, MASS_DEVIATION**2


@inlined
def update(
    i: int, wheel_speed: np.ndarray, command: np.ndarray, demand: float, measured: np.ndarray,
    e: VehicleEstimate, c: EstimatorConstants,
) -> None:  # fmt: skip
    """Update the estimates of vehicle i by one interval.

    Parameters
    ----------
    wheel_speed : (N, A) measured at the end of the interval [rad/s]
    command : (N, A) given at its start: vent -1, hold 0, apply 1; or the pressure -1 to 1
    demand : share of full pressure
    measured : (N, A) measured cylinder pressures [bar]; an empty array (0, 0): they are estimated

    """
    axles = wheel_speed.shape[1]
    e.demand[i] = demand
    e.distributor[i] = min(max(demand, e.distributor[i] - c.rise), e.distributor[i] + c.rise)
    slowed, fastest = 0.0, -1.0
    for k in range(axles):
        before = e.pressure[i, k]
        _follow_brake(i, k, command[i, k], measured, e, c)
        wheel = c.radius * wheel_speed[i, k]
        impulse = c.full_force * 0.5 * (before + e.pressure[i, k]) * c.interval  # of the brake
        impulse += c.rotating * (wheel - e.wheel[i, k])
        e.wheel[i, k] = wheel
        fastest = max(fastest, wheel) if e.trusted[i, k] else fastest
        used = impulse / (c.axle_weight * c.interval)
        e.adhesion[i, k] += c.smooth * (used - e.adhesion[i, k])
        slowed += impulse
        below = e.rolling_adhesion[i, k]
        rolls = c.full_brake * e.pressure[i, k] < below and e.adhesion[i, k] < below and e.trusted[i, k]
        e.rolling_time[i, k] = e.rolling_time[i, k] + c.interval if rolls else 0.0
        e.usual_adhesion[i, k] += c.usual * (e.adhesion[i, k] - e.usual_adhesion[i, k])
        e.rolling_adhesion[i, k] = max(ROLLING_ADHESION, ROLLING_SHARE * e.usual_adhesion[i, k])
    _predict(i, slowed / c.mass, e, c)
    # No braked wheel is faster than a rolling one. A wheel much slower than the fastest does not roll: its brake is
    # underestimated.
    slowest = fastest * (1.0 - SLIDING_CREEPAGE_SEEN) - 3.0 * ROLLING_DEVIATION_MPS
    for k in range(axles):
        if e.rolling_time[i, k] >= ROLLING_S and e.wheel[i, k] > slowest:
            seen = e.wheel[i, k] + ROLLING_CREEP_MPS
            empty = c.full_brake * e.pressure[i, k] < ROLLING_SHARE * e.rolling_adhesion[i, k]
            sure = (empty and bounds.is_shallow(e.speed[i] - seen, e.speed[i])) or surely_rolls(i, k, e, c)
            _correct(i, seen, ROLLING_DEVIATION_MPS, sure, e)
    if e.since_slide[i] == math.inf and fastest >= 0.0:
        _correct(i, fastest + ROLLING_CREEP_MPS, BRAKED_DEVIATION_MPS, True, e)
    _raise(i, e, c)
    speed = max(e.speed[i], 0.0)
    slides = False
    for k in range(axles):
        slides = slides or -e.ahead[i, k] > SLIDING_CREEPAGE_SEEN * speed
    doubt = math.sqrt(e.speed_variance[i])
    doubtful = doubt > DOUBTFUL_MPS or (e.doubtful[i] and doubt > CERTAIN_MPS)
    e.speed[i], e.uncertainty[i] = speed, doubt
    e.since_slide[i] = 0.0 if slides else e.since_slide[i] + c.interval
    e.doubtful[i] = doubtful and speed > SLOW_MPS and e.since_slide[i] < SLIDE_REMEMBERED_S


@inlined
def _follow_brake(i: int, k: int, command: float, measured: np.ndarray, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Take the next command of axle k; update its pressure, and the pressure after all commands under way."""
    last = e.commands.shape[1] - 1
    for age in range(last, 0, -1):
        e.commands[i, age, k] = e.commands[i, age - 1, k]
    e.commands[i, 0, k] = command
    if measured.size > 0:
        e.pressure[i, k] = e.most_pressure[i, k] = measured[i, k] / c.full_pressure
    else:
        e.pressure[i, k] = _after(e.pressure[i, k], e.commands[i, last, k], e.distributor[i], e.demand[i], c)
        _bound(i, k, e, c)
    more = bounds.brake(e.most_pressure[i, k], c.full_brake) - c.full_brake * e.pressure[i, k]
    e.unseen[i, k] += c.smooth * (more - e.unseen[i, k])
    coming = e.pressure[i, k]
    for age in range(last - 1, -1, -1):
        coming = _after(coming, e.commands[i, age, k], e.distributor[i], e.demand[i], c)
    e.pressure_to_come[i, k] = coming


@inlined
def _bound(i: int, k: int, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Update the highest possible pressure of axle k: any command under way may act already, and venting may be late."""
    most, highest = e.most_pressure[i, k], 0.0
    for age in range(e.commands.shape[1]):
        acts = e.commands[i, age, k]
        given = bounds.supply(e.distributor[i], e.demand[i])
        target = given if acts > 0.5 else (0.0 if acts < -0.5 else most)
        if c.by_pressure:
            target = min(0.5 * (acts + 1.0) * e.demand[i], given)
        highest = max(highest, target)
    e.vented[i, k] = e.vented[i, k] + c.interval if highest < most else 0.0
    if highest > most:
        e.most_pressure[i, k] += c.fill_most * (highest - most)
    elif bounds.is_late(e.vented[i, k], c.interval):
        e.most_pressure[i, k] += c.vent_least * (highest - most)


@inlined
def surely_rolls(i: int, k: int, e: VehicleEstimate, c: EstimatorConstants) -> bool:
    """Return whether the wheelset of axle k rolls, on any rail and with any brake within its tolerances."""
    return surely_empty(i, k, e, c) and e.adhesion[i, k] + e.unseen[i, k] < ROLLING_ADHESION


@inlined
def surely_empty(i: int, k: int, e: VehicleEstimate, c: EstimatorConstants) -> bool:
    """Return whether any brake of axle k within its tolerances requires less adhesion than any rail carries."""
    return bounds.brake(e.most_pressure[i, k], c.full_brake) < ROLLING_ADHESION


@inlined
def _after(pressure: float, acts: float, distributor: float, demand: float, c: EstimatorConstants) -> float:
    """Pressure after an interval under an active command; all shares of full pressure."""
    held = 0.0 if acts < -0.5 else pressure
    target = distributor if acts > 0.5 else held
    if c.by_pressure:
        target = min(0.5 * (acts + 1.0) * demand, distributor)
    return pressure + (c.fill if target > pressure else c.vent) * (target - pressure)


@inlined
def _predict(i: int, slowed: float, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Slow the vehicle by q times the loss of speed with nominal mass, `slowed` [m/s]; update the covariances."""
    e.speed[i] -= e.mass_ratio[i] * slowed
    e.speed_variance[i] = (
        e.speed_variance[i]
        - 2.0 * slowed * e.covariance[i]
        + slowed * slowed * e.mass_variance[i]
        + SPEED_DRIFT * SPEED_DRIFT * c.interval
    )
    e.covariance[i] -= slowed * e.mass_variance[i]
    e.mass_variance[i] += MASS_DRIFT * MASS_DRIFT * c.interval


@inlined
def _correct(i: int, seen: float, deviation: float, sure: bool, e: VehicleEstimate) -> None:
    """Correct the running speed by an observed one, `seen`, with its standard deviation, both [m/s].

    A deviation of more than three standard deviations shows that the forces are less certain than assumed, as with other brake
    times. The covariance is then increased to match, q only within its bounds. If the correction would lower the speed by more
    than `DOUBTFUL_MPS`, the brake may also be fuller than estimated and the wheel slide steadily. Unless it rolls for `sure`
    (see `surely_rolls`), only the uncertainty is increased to the deviation, so that a wheelset is released further.
    """
    missing = seen - e.speed[i]
    if missing < -DOUBTFUL_MPS and not sure:
        _doubt_forces(i, missing * missing / e.speed_variance[i], e)
        return
    more = missing * missing / (9.0 * (e.speed_variance[i] + deviation * deviation))
    if more > 1.0:
        more = min(more, max((MASS_RANGE[1] - 1.0) * (MASS_RANGE[1] - 1.0) / e.mass_variance[i], 1.0))
        e.speed_variance[i] *= more
        e.covariance[i] *= more
        e.mass_variance[i] *= more
    share = 1.0 / (e.speed_variance[i] + deviation * deviation)
    gain_v, gain_q = e.speed_variance[i] * share, e.covariance[i] * share
    e.speed[i] += gain_v * missing
    e.mass_ratio[i] = min(max(e.mass_ratio[i] + gain_q * missing, MASS_RANGE[0]), MASS_RANGE[1])
    e.mass_variance[i] -= gain_q * e.covariance[i]
    e.covariance[i] -= gain_v * e.covariance[i]
    e.speed_variance[i] -= gain_v * e.speed_variance[i]


@inlined
def _doubt_forces(i: int, more: float, e: VehicleEstimate) -> None:
    """Increase the variance of the running speed by a factor, and that of q within its bounds: the forces are uncertain."""
    if more > 1.0:
        wider = min(more, max((MASS_RANGE[1] - 1.0) * (MASS_RANGE[1] - 1.0) / e.mass_variance[i], 1.0))
        e.speed_variance[i] *= more
        e.covariance[i] *= math.sqrt(more * wider)
        e.mass_variance[i] *= wider


@inlined
def _raise(i: int, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Raise the running speed to the fastest wheel if this is ahead; the uncertainty stays, because the wheel may slide."""
    fastest = -math.inf
    for k in range(e.wheel.shape[1]):
        e.ahead[i, k] += c.lift * (e.wheel[i, k] - e.speed[i] - e.ahead[i, k])
        fastest = max(fastest, e.ahead[i, k])
    if fastest > FASTER_MPS:
        e.speed[i] += fastest
        for k in range(e.wheel.shape[1]):
            e.ahead[i, k] -= fastest
        gain_q = e.covariance[i] / max(e.speed_variance[i], 1e-9)
        e.mass_ratio[i] = min(max(e.mass_ratio[i] + gain_q * fastest, MASS_RANGE[0]), MASS_RANGE[1])
