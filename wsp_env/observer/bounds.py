"""Bounds of the cylinder pressure and of the used adhesion for a brake within its tolerances.

Pressures are estimated with nominal times (`wsp_env.observer.estimator`). While a valve moves often, a brake that fills faster
and vents more slowly than the nominal one may hold two or three times the estimated pressure, and no sensor shows it. Two facts
are certain: the pressure does not exceed that of the distributor, and it falls while the cylinder is vented for long. A second
bound follows: the rail force on a braked wheel is at most this largest brake force plus the force that accelerates the wheel.
If even this is less than any rail carries under a sliding wheel, the wheel rolls. These constants are no part of a policy's
contract, which holds those of `estimator`, `rail` and `observation` (`wsp_env.evaluation.policy`).
"""

from wsp_env.compiled import inlined

#: Tolerances of a brake: factors by which it may fill faster and vent more slowly than the nominal one, additional dead time of
#: venting [s] (half of the nominal one, and the lag of one axle's valve), factor on the brake force, and factor on the rise
#: time of the distributor (assumptions; `agents.drawn` draws up to 1.4, 1.5, 0.05 s, mostly below 1.3, and 1.33).
FILLS_FASTER, EMPTIES_SLOWER, LATE_S, BRAKES_MORE, RISES_FASTER = 1.5, 1.5, 0.05, 4.0 / 3.0, 4.0 / 3.0

#: Creepage [-] up to which a slide is shallow: up to 160 km/h, poor rail still carries three quarters of its maximum. A wheel
#: whose brake is estimated to be nearly empty would accelerate even if it held three times that pressure (assumption).
SHALLOW_CREEPAGE = 0.1


def fill_and_vent(fill_s: float, vent_s: float) -> tuple[float, float]:
    """Return the shortest time constant of filling and the longest of venting [s], from the nominal ones."""
    return fill_s / FILLS_FASTER, EMPTIES_SLOWER * vent_s


@inlined
def supply(most: float, demand: float, rise: float) -> float:
    """Return the highest possible distributor pressure, from its last value, the demand and the nominal rise per interval."""
    return max(min(demand, most + RISES_FASTER * rise), most - rise / RISES_FASTER)


@inlined
def is_late(vented: float, interval: float) -> bool:
    """Return whether a valve commanded to vent, whose nominal dead time ended `vented` [s] ago, certainly vents."""
    return vented > LATE_S + 0.5 * interval


@inlined
def brake(most: float, full_brake: float) -> float:
    """Return the largest adhesion [-] that a cylinder pressure, share of full pressure, requires."""
    return BRAKES_MORE * full_brake * most


@inlined
def slowly(least: float, distributor: float, rise: float) -> float:
    """Return the lowest possible distributor pressure, from its last value, the estimate and the nominal rise per interval."""
    return min(distributor, least + rise / RISES_FASTER)


@inlined
def weakest(pressure: float, full_brake: float) -> float:
    """Return the least adhesion [-] that a cylinder pressure, share of full pressure, requires."""
    return full_brake * pressure / BRAKES_MORE


@inlined
def is_shallow(slip: float, speed: float) -> bool:
    """Return whether a slip at a running speed, both [m/s], is that of a shallow slide."""
    return slip < SHALLOW_CREEPAGE * speed
