"""Commands for an axle that is not monitored, for a wheel about to lock, and for an axle that was not braked for long."""

import math
from typing import Any

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.observer import bounds
from wsp_env.observer.doubts import Doubts, GuardConstants, doubts_of, guard_of
from wsp_env.observer.estimate import EstimatorConstants, VehicleEstimate
from wsp_env.observer.estimator import ROLLING_ADHESION, SLIDE_REMEMBERED_S, SLOW_MPS, surely_empty
from wsp_env.observer.observation import constants_of, memory_of
from wsp_env.observer.running_speed import MASS_RANGE
from wsp_env.plant.command import APPLIES, HOLDS, VENTS

#: An unmonitored axle is braked fully if, for `CALM_S` [s], each monitored axle has been applied or has had `FULL_SHARE` of the
#: distributor's pressure, and the vehicle slows at least as the weakest brakes within tolerances do: a weak monitored brake
#: does not represent a stronger one. Otherwise it is vented for `RELEASE_S` [s], so that a sliding wheel turns again, and then
#: braked by `BLIND_SHARE` of the least adhesion that a monitored axle uses. This is the possible difference between brakes of
#: one vehicle: at 0.9, wheels lock in simulations with drawn brakes (assumptions).
FULL_SHARE, CALM_S, RELEASE_S, BLIND_SHARE = 0.95, 3.0, 0.7, 0.75

#: Vent time [s] if a monitored wheel has slowed faster than any vehicle can: it slid, and the unmonitored one may have slid
#: further (a nominal brake empties in 0.5 s; in the rest, adhesion of 0.045 of its load accelerates a wheel by 8 m/s).
LONG_RELEASE_S = 2.0

#: An axle released to show the running speed is held below this share of the adhesion limit for rolling (assumption).
RELEASED_SHARE = 0.5

#: Safety timer [s]: an axle whose brake was nearly empty for `TIMER_S` is applied for `TIMER_REST_S`, or for `BLIND_REST_S` if
#: unmonitored. An unmonitored axle with some brake that was not applied for `TIMER_S` is applied for one command (assumptions:
#: EN 15595, venting at most 10 s; too short to lock).
TIMER_S, TIMER_REST_S, BLIND_REST_S = 10.0, 1.0, 0.3

#: Creepage [-] from which a wheel is vented at the end of a stop, and running speed [m/s] below which the brake is not
#: controlled (assumptions: the environments' slide limit; EN 15595, no WSP below 3 to 5 km/h, the lower end).
END_CREEPAGE, END_MPS = 0.3, 0.83

#: Below `SLOW_MPS` the estimator has no doubt. Near a slide, the running speed is doubtful there while this number of its
#: standard deviations exceeds that creepage, because all wheels may be about to lock together; down to this speed [m/s]
#: (assumptions: this number of deviations contradicts an estimate; EN 15595, no WSP below 3 to 5 km/h, the upper end).
END_DEVIATIONS, UNDOUBTED_MPS = 3.0, 1.39


@loop
def overrule(command: np.ndarray, state: Any, given: Any, memory: Any, constants: Any) -> None:
    """Kernel of `Guard.overrule`: change the valve commands (N, A) in place."""
    d, c = doubts_of(state), guard_of(given)
    seen = memory_of(memory)
    e, acceleration = seen.estimate, seen.filtered.acceleration
    brake = constants_of(constants).estimator
    for i in range(command.shape[0]):
        doubtful = e.doubtful[i] or _doubtful_end(i, e)
        hardest = MASS_RANGE[1] * brake.full_force * command.shape[1] / brake.mass  # [m/s2] no vehicle slows faster
        fastest, used, full, sound, last, shows = 0.0, 1e9, True, 0, -1, doubtful
        d.slid[i] = d.slid[i] and d.full[i] <= CALM_S
        for k in range(command.shape[1]):
            if not d.failed[i, k]:
                sound, last = sound + 1, k
                d.slid[i] = d.slid[i] or d.slowing[i, k] > hardest
                fastest = max(fastest, e.wheel[i, k])
                full = full and (command[i, k] > 0.5 or e.pressure_to_come[i, k] >= FULL_SHARE * e.distributor[i])
                used = min(used, min(e.adhesion[i, k], e.usual_adhesion[i, k]))
                shows = shows or e.rolling_time[i, k] > 0.0
            d.slowing[i, k] -= c.slow * (acceleration[i, k] + d.slowing[i, k])
        borne = _borne(i, d, c, e, brake)
        if not shows:  # an axle released to show the speed does not show the adhesion of the rail
            d.used[i] = used
            if full and borne:
                d.full[i] += c.interval
            else:  # full braking was in vain: do not repeat it for as long a time more
                refuted = d.full[i] > CALM_S and not borne and sound < command.shape[1]
                d.full[i] = -d.full[i] if refuted else min(d.full[i], 0.0)
        running = max(e.speed[i], fastest)
        ends = running + e.uncertainty[i] < END_MPS
        for k in range(command.shape[1]):
            if d.failed[i, k]:
                calm = d.full[i] > CALM_S or sound == 0
                d.blind[i, k] = 0.0 if calm else d.blind[i, k] + c.interval
                command[i, k] = APPLIES if calm else _blind(i, k, d, e, brake)
            elif e.wheel[i, k] - _lost(i, k, acceleration[i, k], e, brake) < (1.0 - END_CREEPAGE) * running:
                command[i, k] = VENTS
                if acceleration[i, k] < -hardest:
                    d.rest[i, k] = 0.0  # it is braked, and slides
            if doubtful and k == last:  # the last monitored axle shows the speed
                released = RELEASED_SHARE * e.rolling_adhesion[i, k]
                braked = brake.full_brake * e.pressure_to_come[i, k] > released or not surely_empty(i, k, e, brake)
                command[i, k] = VENTS if braked else HOLDS
            if ends or _expired(i, k, command[i, k], d, c, e, brake):
                command[i, k] = APPLIES


@inlined
def _borne(i: int, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants) -> bool:
    """Return whether the vehicle slows at least as the weakest brakes within tolerances do if they hold.

    The monitored wheel that slows least represents the vehicle. An unmonitored wheel in a deep slide, or standing, contributes
    less.
    """
    d.supply[i] = bounds.slowly(d.supply[i], e.distributor[i], brake.rise)
    d.filled[i] += brake.fill / bounds.FILLS_FASTER * (d.supply[i] - d.filled[i])
    axles, least, held = d.slowing.shape[1], math.inf, 0.0
    for k in range(axles):
        held += min(e.pressure[i, k], d.filled[i]) / axles
        if not d.failed[i, k]:
            least = min(least, d.slowing[i, k])
    d.asked[i] += c.slow * (bounds.weakest(held, brake.full_brake) - d.asked[i])
    rolling = (brake.mass + axles * brake.rotating) / (axles * brake.axle_weight)  # adhesion per deceleration
    return d.asked[i] < ROLLING_ADHESION or rolling * least > d.asked[i]


@inlined
def _doubtful_end(i: int, e: VehicleEstimate) -> bool:
    """Return whether, near the end of a stop, the running speed may differ much from the estimated one."""
    wrong = END_DEVIATIONS * e.uncertainty[i]
    if e.speed[i] > SLOW_MPS or e.since_slide[i] > SLIDE_REMEMBERED_S:
        return False
    return wrong > END_CREEPAGE * e.speed[i] and e.speed[i] + wrong > UNDOUBTED_MPS


@inlined
def _lost(i: int, k: int, acceleration: float, e: VehicleEstimate, brake: EstimatorConstants) -> float:
    """Return the speed [m/s] that the wheel of axle k, vented now, loses before its brake falls to the rail's adhesion.

    The valve acts after its dead time, the cylinder vents with its time constant, and the rail keeps its present adhesion.
    """
    per_adhesion = brake.axle_weight / brake.rotating  # of the wheel's acceleration [m/s2] per adhesion
    dead, emptying = brake.interval * e.commands.shape[1], brake.interval / brake.vent
    now, asked = brake.full_brake * e.pressure[i, k], brake.full_brake * e.pressure_to_come[i, k]
    carried = max(now + acceleration / per_adhesion, ROLLING_ADHESION)
    lost = max(0.5 * (now + asked) - carried, 0.0) * dead
    if asked > carried:
        lost += emptying * (asked - carried - carried * math.log(asked / carried))
    return lost * per_adhesion


@inlined
def _expired(
    i: int, k: int, command: float, d: Doubts, c: GuardConstants, e: VehicleEstimate, brake: EstimatorConstants
) -> bool:  # fmt: skip
    """Return whether the safety timer applies axle k.

    For an unmonitored wheel, only an application counts as braking: the pressure of its brake is estimated and not verified.
    """
    holds = brake.full_brake * e.pressure_to_come[i, k] > ROLLING_ADHESION
    braked = command > 0.5 or (holds and not d.failed[i, k])
    d.unbraked[i, k] = 0.0 if braked else d.unbraked[i, k] + c.interval
    d.rest[i, k] = max(d.rest[i, k] - c.interval, 0.0)
    if d.unbraked[i, k] > c.timer:
        d.unbraked[i, k] = 0.0
        d.rest[i, k] = (c.interval if holds else BLIND_REST_S) if d.failed[i, k] else c.timer_rest
    return d.rest[i, k] > 0.0


@inlined
def _blind(i: int, k: int, d: Doubts, e: VehicleEstimate, brake: EstimatorConstants) -> float:
    """Return the command of an unmonitored axle, if not all monitored axles hold the demanded brake."""
    if d.blind[i, k] <= (LONG_RELEASE_S if d.slid[i] else RELEASE_S):
        return VENTS
    wanted, held = BLIND_SHARE * max(d.used[i], 0.0), brake.full_brake * e.pressure_to_come[i, k]
    offered = brake.full_brake * e.distributor[i]
    if wanted > held + 0.5 * brake.fill * max(offered - held, 0.0):
        return APPLIES
    return VENTS if wanted < held - 0.5 * brake.vent * held else HOLDS
