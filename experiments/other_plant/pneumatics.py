"""Brake of this plant: distributor, orifice flow of the dump valve, hysteresis and pads.

Pressures are gauge pressures [bar] where not called absolute. The cylinder is isothermal; its volume and the valve's size are
in one conductance [1/s], so that dp/dt = conductance * opening * flow (absolute pressures).
"""

import math

import numpy as np

from experiments.other_plant.records import compiled

ATMOSPHERE_BAR = 1.01325  # absolute; a normal litre is a litre of air at this pressure
_CRITICAL = 0.3  # critical pressure ratio of the valve [-] (assumption; ISO 6358 gives 0.2 to 0.5 for valves)
_LAMINAR = 0.995  # pressure ratio [-] above which the flow is linear in the difference (assumption, as in ISO 6358 models)
_INSHOT_S = 0.3  # time in which the inshot comes [s] (assumption)
_PAD_MPS = 20.0  # rim speed at which the pads have their nominal friction [m/s] (assumption)


@compiled
def _subsonic(ratio: float) -> float:
    """Return the flow [-] over the choked one at a pressure ratio above the critical: ISO 6358's ellipse."""
    share = (ratio - _CRITICAL) / (1.0 - _CRITICAL)
    return math.sqrt(1.0 - share * share)


@compiled
def flow(above: float, below: float) -> float:
    """Return the flow through an orifice between two absolute pressures.

    Parameters
    ----------
    above, below
        absolute pressures [bar]; no flow where `below` is the higher one

    Returns
    -------
    float
        `above` times the flow over the choked flow [bar]

    """
    ratio = below / above
    if ratio >= 1.0:
        return 0.0
    if ratio <= _CRITICAL:
        return above
    if ratio <= _LAMINAR:
        return above * _subsonic(ratio)
    return above * _subsonic(_LAMINAR) * (1.0 - ratio) / (1.0 - _LAMINAR)


@compiled
def _effective(full_bar: float, vents: bool, steps: int) -> float:
    """Return the time [s] at a conductance of 1/s: filling from empty to 1 - 1/e of full, or venting from full to 1/e of it."""
    part = 1.0 - math.exp(-1.0)
    total = 0.0
    for k in range(steps):
        way = (k + 0.5) / steps * part * full_bar
        if vents:
            total += 1.0 / flow(full_bar - way + ATMOSPHERE_BAR, ATMOSPHERE_BAR)
        else:
            total += 1.0 / flow(full_bar + ATMOSPHERE_BAR, way + ATMOSPHERE_BAR)
    return total * part * full_bar / steps


def conductance(full_bar: float, vents: bool, effective_s: float) -> float:
    """Return the conductance [1/s] with which 63 % of the change of pressure takes `effective_s` [s], the valve being open."""
    return _effective(full_bar, vents, 20_000) / effective_s


def rise_to_full(rise95_s: float, inshot: float, curvature: float) -> float:
    """Return the time [s] to full pressure of a distributor that reaches 95 % after `rise95_s` [s], the measure of UIC 540."""
    share = (0.95 - inshot) / (1.0 - inshot)
    return float(-rise95_s * curvature / np.log(1.0 - share * (1.0 - np.exp(-curvature))))


@compiled
def distributor(time: float, rise: float, inshot: float, curvature: float) -> float:
    """Return the share [-] of full pressure: an inshot, and with it a rise that gets flatter.

    Parameters
    ----------
    time, rise
        since the demand, and to full pressure [s]
    inshot, curvature
        share that comes at once [-], and how much the rise gets flatter [-], above 0

    """
    bent = (1.0 - math.exp(-curvature * min(time / rise, 1.0))) / (1.0 - math.exp(-curvature))
    return inshot * min(time / _INSHOT_S, 1.0) + (1.0 - inshot) * bent


@compiled
def pressure_rate(pressure: float, supply: float, spool: float, fill: float, vent: float) -> float:
    """Return the rate [bar/s] in a cylinder.

    Parameters
    ----------
    pressure, supply
        in the cylinder and behind the distributor, gauge [bar]
    spool
        -1 fully open to the air, 0 shut, 1 fully open to the distributor
    fill, vent
        conductances of the open valve [1/s]

    """
    if spool > 0.0:
        return fill * spool * flow(supply + ATMOSPHERE_BAR, pressure + ATMOSPHERE_BAR)
    return vent * spool * flow(pressure + ATMOSPHERE_BAR, ATMOSPHERE_BAR)


@compiled
def pressing(before: float, pressure: float, hysteresis: float) -> float:
    """Return the pressure [bar] that the pads feel: it follows the cylinder's with play in proportion to it."""
    return min(max(before, pressure * (1.0 - hysteresis)), pressure * (1.0 + hysteresis))


@compiled
def pad_friction(rim: float, slope: float) -> float:
    """Return the friction of the pads over the nominal one [-] at a rim speed [m/s]; linear (assumption)."""
    return 1.0 + slope * (1.0 - rim / _PAD_MPS)
