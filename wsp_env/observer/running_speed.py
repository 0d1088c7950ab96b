"""Kalman filter of the running speed: with it, what slows the vehicle, and the time in which its brake builds up.

States: running speed v; q, nominal over true mass; r, logarithm of the distributor's rise time over the nominal one; a,
deceleration by other forces than those of the rail (gradient, drag, another brake). The sum of the rail forces slows the
vehicle with them: dv/dt = -q sum T / M - a. q and a differ where the brake changes: a is there without brake, too. While the
distributor's pressure rises, a slower rise and a larger mass slow the vehicle alike. The rise is less certain (practice: 3 to
5 s), so that it takes most of what is found then. The estimated pressures are corrected with r by their derivatives. r no
longer counts once the distributor has reached the demand and no cylinder holds a pressure from before.
"""

import math

from wsp_env.compiled import inlined
from wsp_env.observer import bounds
from wsp_env.observer.estimate import EstimatorConstants, VehicleEstimate

#: Standard deviations: of the initial running speed [m/s] (assumption); of q [-], which stands for all that scales the
#: deceleration (payload 0.04, gain of all brakes 0.05, of one of two 0.05; assumptions, as `agents.drawn` draws); of r [-],
#: that of rise times spread evenly over 3 to 5 s (distributor practice, UIC 540).
START_DEVIATION_MPS = 0.05
MASS_DEVIATION = 0.08
RISE_DEVIATION = 0.15

#: Standard deviation of a [m/s2]: 10 per mille of gradient; 1 kN of drag of a bogie's half coach is half of it (assumption).
OTHER_DEVIATION_MPS2 = 0.1

#: Standard deviations of the drift of running speed [m/s / sqrt(s)], q [1 / sqrt(s)] and a [m/s2 / sqrt(s)] (assumptions).
SPEED_DRIFT = 0.02
MASS_DRIFT = 0.002
OTHER_DRIFT = 0.002

#: A wheel faster than the estimated running speed by this much [m/s], as a mean over `FASTER_FILTER_S`, corrects it although
#: the wheel may slide. Without smoothing, sensor noise alone would raise the running speed (assumption).
FASTER_MPS = 0.15

#: Standard deviations of the running speed [m/s] at which it becomes doubtful and certain again; if doubtful, a wheelset should
#: be released to roll.
DOUBTFUL_MPS, CERTAIN_MPS = 0.3, 0.12

#: Bounds of q [-].
MASS_RANGE = (0.8, 1.25)


@inlined
def begin(i: int, speed: float, e: VehicleEstimate) -> None:
    """Begin a new stop of vehicle i at a running speed [m/s]."""
    e.speed[i], e.uncertainty[i], e.doubtful[i] = speed, START_DEVIATION_MPS, False
    e.mass_ratio[i], e.rise[i], e.other[i] = 1.0, 0.0, 0.0
    e.speed_variance[i], e.mass_variance[i] = START_DEVIATION_MPS**2, MASS_DEVIATION**2
    e.rise_variance[i] = RISE_DEVIATION**2
    e.other_variance[i] = OTHER_DEVIATION_MPS2**2
    e.covariance[i] = e.rise_speed[i] = e.rise_mass[i] = 0.0
    e.other_speed[i] = e.other_mass[i] = e.other_rise[i] = 0.0


@inlined
def predict(i: int, slowed: float, by_rise: float, e: VehicleEstimate, c: EstimatorConstants) -> None:
    """Slow the vehicle by q times the loss of speed with nominal mass, `slowed` [m/s], and by a; update the covariances.

    `by_rise` is the derivative of that loss with respect to r [m/s].
    """
    dt = c.interval
    e.speed[i] -= e.mass_ratio[i] * slowed + e.other[i] * dt
    by_rise *= e.mass_ratio[i]
    with_mass = e.covariance[i] - slowed * e.mass_variance[i] - by_rise * e.rise_mass[i] - dt * e.other_mass[i]
    with_rise = e.rise_speed[i] - slowed * e.rise_mass[i] - by_rise * e.rise_variance[i] - dt * e.other_rise[i]
    with_other = e.other_speed[i] - slowed * e.other_mass[i] - by_rise * e.other_rise[i] - dt * e.other_variance[i]
    e.speed_variance[i] += SPEED_DRIFT * SPEED_DRIFT * dt
    e.speed_variance[i] -= slowed * (e.covariance[i] + with_mass) + by_rise * (e.rise_speed[i] + with_rise)
    e.speed_variance[i] -= dt * (e.other_speed[i] + with_other)
    e.covariance[i], e.rise_speed[i], e.other_speed[i] = with_mass, with_rise, with_other
    e.mass_variance[i] += MASS_DRIFT * MASS_DRIFT * dt
    e.other_variance[i] += OTHER_DRIFT * OTHER_DRIFT * dt


@inlined
def correct(i: int, seen: float, deviation: float, sure: bool, e: VehicleEstimate) -> None:
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
        e.rise_speed[i] *= math.sqrt(more)
        e.rise_mass[i] *= math.sqrt(more)
        e.other_speed[i] *= math.sqrt(more)
        e.other_mass[i] *= math.sqrt(more)
    share = 1.0 / (e.speed_variance[i] + deviation * deviation)
    gain_v, gain_q = e.speed_variance[i] * share, e.covariance[i] * share
    e.speed[i] += gain_v * missing
    e.mass_ratio[i] = min(max(e.mass_ratio[i] + gain_q * missing, MASS_RANGE[0]), MASS_RANGE[1])
    gain_r, gain_a = e.rise_speed[i] * share, e.other_speed[i] * share
    e.other[i] += gain_a * missing
    _learn_rise(i, gain_r * missing, e)
    e.rise_variance[i] -= gain_r * e.rise_speed[i]
    e.rise_mass[i] -= gain_q * e.rise_speed[i]
    e.other_variance[i] -= gain_a * e.other_speed[i]
    e.other_mass[i] -= gain_q * e.other_speed[i]
    e.other_rise[i] -= gain_r * e.other_speed[i]
    e.rise_speed[i] -= gain_v * e.rise_speed[i]
    e.other_speed[i] -= gain_v * e.other_speed[i]
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
        e.rise_speed[i] *= math.sqrt(more)
        e.rise_mass[i] *= math.sqrt(wider)
        e.other_speed[i] *= math.sqrt(more)
        e.other_mass[i] *= math.sqrt(wider)


@inlined
def raise_to_the_fastest(i: int, e: VehicleEstimate, c: EstimatorConstants) -> None:
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
        _learn_rise(i, e.rise_speed[i] / max(e.speed_variance[i], 1e-9) * fastest, e)
        e.other[i] += e.other_speed[i] / max(e.speed_variance[i], 1e-9) * fastest
        e.mass_ratio[i] = min(max(e.mass_ratio[i] + gain_q * fastest, MASS_RANGE[0]), MASS_RANGE[1])


@inlined
def _learn_rise(i: int, by: float, e: VehicleEstimate) -> None:
    """Change r, and with it the pressures that are estimated."""
    before = e.rise[i]
    e.rise[i] = min(max(before + by, -math.log(bounds.RISES_FASTER)), math.log(bounds.RISES_FASTER))
    by = e.rise[i] - before
    if by == 0.0:
        return
    e.distributor[i] = min(max(e.distributor[i] + by * e.distributor_by_rise[i], 0.0), 1.0)
    for k in range(e.wheel.shape[1]):
        e.pressure[i, k] = min(max(e.pressure[i, k] + by * e.pressure_by_rise[i, k], 0.0), 1.0)


@inlined
def distrust(i: int, deviation: float, e: VehicleEstimate) -> None:
    """Raise the standard deviation of the running speed [m/s]; forget what was learned of the mass and of other forces."""
    e.speed_variance[i] = max(e.speed_variance[i], deviation * deviation)
    e.mass_ratio[i], e.mass_variance[i] = 1.0, MASS_DEVIATION * MASS_DEVIATION
    e.other[i], e.other_variance[i] = 0.0, OTHER_DEVIATION_MPS2 * OTHER_DEVIATION_MPS2
    e.covariance[i] = e.rise_speed[i] = e.rise_mass[i] = 0.0
    e.other_speed[i] = e.other_mass[i] = e.other_rise[i] = 0.0
