"""The most that a cylinder may still hold, and that a wheelset may use of the rail, on a brake within its tolerances.

Pressures are estimated from nominal times (`wsp_env.observer.estimator`). While a valve moves often, a brake that fills faster
and empties more slowly than the nominal one comes to hold two or three times what is estimated, and no sensor tells. What is
certain is that it holds no more than the distributor gives, and that it empties while it is vented for long. Of such a bound
follows another: whatever brakes a wheel, the rail turns it by no more than that and its acceleration. Where even this is less
than any rail carries under a sliding wheel, the wheel rolls.

The names here are none of the estimator's: what a policy sees does not depend on them.
"""

from wsp_env.compiled import inlined

#: Tolerances of a brake: it may fill in so much less time than the nominal one and empty in so much more, be vented by so much
#: more than the nominal dead time too late [s] (half of it, and the lag of one axle's valve), and brake by so much more or
#: less; and the distributor may rise in so much less or more time (assumptions; `agents.drawn` draws up to 1.4, 1.5, 0.05 s,
#: mostly less than 1.3, and 1.33).
FILLS_FASTER, EMPTIES_SLOWER, LATE_S, BRAKES_MORE, RISES_FASTER = 1.5, 1.5, 0.05, 4.0 / 3.0, 4.0 / 3.0

#: Creepage [-] up to which a slide is shallow: up to 160 km/h poor rail still carries three quarters of its best, and a wheel
#: whose brake is estimated to be nearly empty would be turned faster even if it held three times that (assumption).
SHALLOW_CREEPAGE = 0.1


def fill_and_vent(fill_s: float, vent_s: float) -> tuple[float, float]:
    """Return the shortest time constant of filling and the longest of venting [s], from the nominal ones."""
    return fill_s / FILLS_FASTER, EMPTIES_SLOWER * vent_s


@inlined
def supply(distributor: float, demand: float) -> float:
    """Return the most that the distributor may give, from what it is estimated to and the demand; shares of full pressure."""
    return max(distributor, min(demand, RISES_FASTER * distributor))


@inlined
def is_late(vented: float, interval: float) -> bool:
    """Return whether a valve that has been told to vent, and should do so since `vented` [s], surely does."""
    return vented > LATE_S + 0.5 * interval


@inlined
def brake(most: float, full_brake: float) -> float:
    """Return the adhesion [-] that a cylinder pressure, share of full pressure, asks for at most."""
    return BRAKES_MORE * full_brake * most


@inlined
def slowly(least: float, distributor: float, rise: float) -> float:
    """Return the least that the distributor gives, from that before, what it is estimated to and its rise in an interval."""
    return min(distributor, least + rise / RISES_FASTER)


@inlined
def weakest(pressure: float, full_brake: float) -> float:
    """Return the adhesion [-] that a cylinder pressure, share of full pressure, asks for at least."""
    return full_brake * pressure / BRAKES_MORE


@inlined
def is_shallow(slip: float, speed: float) -> bool:
    """Return whether a slip at a running speed, both [m/s], is that of a shallow slide."""
    return slip < SHALLOW_CREEPAGE * speed
