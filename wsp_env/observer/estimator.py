"""Estimation of unmeasured states: running speed, cylinder pressures and the adhesion that each wheelset uses.

The pressures follow from the own commands and the brake's nominal times. With them, the wheel's balance gives the rail force T
= (C + J dw/dt) / r. The sum of these forces slows the vehicle: `wsp_env.observer.running_speed`. The running speed is
corrected by rolling wheelsets (braked far less than before, or, before the first slide, by less than any rail carries), by any
wheel that turns faster than the vehicle can run, and, until the first slide and while all valves apply, weakly by the fastest
wheel.
"""

import math

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.observer import bounds, running_speed
from wsp_env.observer.estimate import EstimatorConstants, VehicleEstimate

#: A wheelset rolls if its estimated brake requires less adhesion than this [-] for `ROLLING_S` [s] (assumption: half the
#: adhesion of rail that the standard's tests call extremely low), or less than this share of its recent low-passed use
#: (assumption). Its smoothed used adhesion must be below the limit too: a wheel released from a slide still accelerates to the
#: vehicle's speed, and sensor noise may hide this.
ROLLING_ADHESION = 0.015
ROLLING_SHARE = 0.5
ROLLING_S = 0.04

#: Adhesion [-] that any rail carries: before the first slide, a wheelset braked by less rolls (assumption: that of rail which
#: the standard's tests call extremely low).
POOREST_RAIL = 0.03

#: Standard deviations (assumptions): of a rolling wheel's speed against the vehicle's [m/s], and of the fastest braked wheel's
#: before the first slide (large, because its errors at neighbouring times are correlated).
ROLLING_DEVIATION_MPS = 0.1
BRAKED_DEVIATION_MPS = 1.0

#: A wheel slides if it is slower than the estimated speed by more than this creepage [-], which exceeds that of wheels that
#: roll under full brake. The speed may be doubtful only for this time after the last slide [s]: without slides, no wheelset is
#: to be released for the speed estimate (assumptions).
SLIDING_CREEPAGE_SEEN = 0.008
SLIDE_REMEMBERED_S = 2.0

#: Running speed below which nothing is doubtful [m/s]: slip errors matter less, and the stop is nearly over.
SLOW_MPS = 10.0


@inlined
def begin(i: int, wheel_speed: np.ndarray, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Begin a new stop of vehicle i, rolling with empty cylinders, from the measured wheel speeds (N, A) [rad/s]."""
    fastest = 0.0
    for k in range(wheel_speed.shape[1]):
        e.wheel[i, k] = c.radius * wheel_speed[i, k]
        fastest = max(fastest, e.wheel[i, k])
        e.pressure[i, k] = e.pressure_to_come[i, k] = e.pressure_by_rise[i, k] = 0.0
        e.most_pressure[i, k] = e.vented[i, k] = e.unseen[i, k] = 0.0
        e.adhesion[i, k] = e.usual_adhesion[i, k] = 0.0
        e.rolling_adhesion[i, k] = ROLLING_ADHESION
        e.rolling_time[i, k] = e.ahead[i, k] = 0.0
        e.trusted[i, k] = True
        for age in range(e.commands.shape[1]):
            e.commands[i, age, k] = 1.0
    e.distributor[i] = e.distributor_by_rise[i] = e.most_distributor[i] = e.demand[i] = 0.0
    e.since_slide[i] = math.inf
    running_speed.begin(i, fastest, e)


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
    _distribute(i, demand, e, c)
    slowed, by_rise, fastest = 0.0, 0.0, -1.0
    for k in range(axles):
        before, before_by_rise = e.pressure[i, k], e.pressure_by_rise[i, k]
        _follow_brake(i, k, command[i, k], measured, e, c)
        wheel = c.radius * wheel_speed[i, k]
        impulse = c.full_force * 0.5 * (before + e.pressure[i, k]) * c.interval  # of the brake
        impulse += c.rotating * (wheel - e.wheel[i, k])
        e.wheel[i, k] = wheel
        fastest = max(fastest, wheel) if e.trusted[i, k] else fastest
        used = impulse / (c.axle_weight * c.interval)
        e.adhesion[i, k] += c.smooth * (used - e.adhesion[i, k])
        slowed += impulse
        by_rise += c.full_force * 0.5 * (before_by_rise + e.pressure_by_rise[i, k]) * c.interval
        below = e.rolling_adhesion[i, k]
        if e.since_slide[i] == math.inf:
            below = max(below, POOREST_RAIL)
        rolls = c.full_brake * e.pressure[i, k] < below and e.adhesion[i, k] < below and e.trusted[i, k]
        e.rolling_time[i, k] = e.rolling_time[i, k] + c.interval if rolls else 0.0
        e.usual_adhesion[i, k] += c.usual * (e.adhesion[i, k] - e.usual_adhesion[i, k])
        e.rolling_adhesion[i, k] = max(ROLLING_ADHESION, ROLLING_SHARE * e.usual_adhesion[i, k])
    running_speed.predict(i, slowed / c.mass, by_rise / c.mass, e, c)
    # No braked wheel is faster than a rolling one. A wheel much slower than the fastest does not roll: its brake is
    # underestimated.
    slowest = fastest * (1.0 - SLIDING_CREEPAGE_SEEN) - 3.0 * ROLLING_DEVIATION_MPS
    for k in range(axles):
        if e.rolling_time[i, k] >= ROLLING_S and e.wheel[i, k] > slowest:
            seen = e.wheel[i, k] * (1.0 + c.creep * c.full_brake * e.pressure[i, k])
            empty = c.full_brake * e.pressure[i, k] < ROLLING_SHARE * e.rolling_adhesion[i, k]
            sure = (empty and bounds.is_shallow(e.speed[i] - seen, e.speed[i])) or surely_rolls(i, k, e, c)
            running_speed.correct(i, seen, ROLLING_DEVIATION_MPS, sure, e)
    if e.since_slide[i] == math.inf and fastest >= 0.0 and _braked_as_demanded(i, e, c):
        creep = c.creep * min(c.full_brake * e.distributor[i], POOREST_RAIL)
        running_speed.correct(i, fastest * (1.0 + creep), BRAKED_DEVIATION_MPS, True, e)
    running_speed.raise_to_the_fastest(i, e, c)
    speed = max(e.speed[i], 0.0)
    slides = False
    for k in range(axles):
        slides = slides or -e.ahead[i, k] > SLIDING_CREEPAGE_SEEN * speed
    doubt = math.sqrt(e.speed_variance[i])
    doubtful = doubt > running_speed.DOUBTFUL_MPS or (e.doubtful[i] and doubt > running_speed.CERTAIN_MPS)
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
        before = e.pressure[i, k]
        e.pressure[i, k] = _after(before, e.commands[i, last, k], e.distributor[i], e.demand[i], c)
        _differentiate(i, k, before, e.commands[i, last, k], e, c)
        _bound(i, k, e, c)
    more = bounds.brake(e.most_pressure[i, k], c.full_brake) - c.full_brake * e.pressure[i, k]
    e.unseen[i, k] += c.smooth * (more - e.unseen[i, k])
    coming = e.pressure[i, k]
    for age in range(last - 1, -1, -1):
        coming = _after(coming, e.commands[i, age, k], e.distributor[i], e.demand[i], c)
    e.pressure_to_come[i, k] = coming


@inlined
def _distribute(i: int, demand: float, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Let the distributor follow the demand in the estimated rise time; update the derivative with respect to r."""
    e.most_distributor[i] = bounds.supply(e.most_distributor[i], demand, c.rise)
    step = c.rise * math.exp(-e.rise[i])
    before = e.distributor[i]
    e.distributor[i] = min(max(demand, before - step), before + step)
    if demand > before + step:
        e.distributor_by_rise[i] -= step
    elif demand < before - step:
        e.distributor_by_rise[i] += step
    else:
        e.distributor_by_rise[i] = 0.0


@inlined
def _differentiate(i: int, k: int, before: float, acts: float, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Update the derivative of axle k's pressure with respect to r, by the command that acts on the pressure `before`."""
    if c.by_pressure:
        target = min(0.5 * (acts + 1.0) * e.demand[i], e.distributor[i])
        by_rise = e.distributor_by_rise[i] if target == e.distributor[i] else 0.0
        gain = c.fill if target > before else c.vent
        e.pressure_by_rise[i, k] += gain * (by_rise - e.pressure_by_rise[i, k])
    elif acts > 0.5:
        gain = c.fill if e.distributor[i] > before else c.vent
        e.pressure_by_rise[i, k] += gain * (e.distributor_by_rise[i] - e.pressure_by_rise[i, k])
    elif acts < -0.5:
        e.pressure_by_rise[i, k] -= c.vent * e.pressure_by_rise[i, k]


@inlined
def _bound(i: int, k: int, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Update the highest possible pressure of axle k: any command under way may act already, and venting may be late."""
    most, highest = e.most_pressure[i, k], 0.0
    for age in range(e.commands.shape[1]):
        acts = e.commands[i, age, k]
        given = e.most_distributor[i]
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
def _braked_as_demanded(i: int, e: VehicleEstimate, c: EstimatorConstants) -> bool:
    """Return whether every command under way to the valves of vehicle i asks for all of the demanded brake.

    A controller that asks for less reacts to a slide, which may be smaller than what counts as one here.
    """
    all_of_it, braked = 0.9 if c.by_pressure else 0.5, True  # wanted pressures: 95 % of the demanded one
    for k in range(e.wheel.shape[1]):
        for age in range(e.commands.shape[1]):
            braked = braked and e.commands[i, age, k] > all_of_it
    return braked


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
