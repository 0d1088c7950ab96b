"""Pneumatic brake of one axle: distributor, dump valve with dead time, cylinder."""

import math

from wsp_env.compiled import inlined
from wsp_env.plant.state import Constants, State


@inlined
def _flow(h: float, pressure: float, command: float, offered: float, demanded: float, p: Constants) -> tuple[float, float]:
    """Return the pressure after h [s] under one command, and its integral [bar s]; first order towards where air flows."""
    if h <= 0.0:
        return pressure, 0.0
    if p.pressure_control:
        target = min(command * demanded, offered)
    elif command > 0.5:
        target = offered
    elif command < -0.5:
        target = 0.0
    else:
        return pressure, pressure * h
    constant = p.fill_time if target > pressure else p.vent_time
    decay = math.exp(-h / constant)
    after = target + (pressure - target) * decay
    return after, target * h + (pressure - target) * constant * (1.0 - decay)


@inlined
def mean_pressure(
    i: int, k: int, elapsed: float, offered: float, demand: float, state: State, p: Constants
) -> tuple[float, float]:
    """Return the cylinder pressure of axle k after the substep that starts `elapsed` [s] into the control interval, and
    its mean over the substep [bar].

    A command acts after the dead time, also in the middle of a substep; `offered` is the distributor's pressure [bar].
    """  # noqa: D205  # the summary names two results
    demanded = demand * p.full_pressure
    early = min(max(p.dead_rest - elapsed, 0.0), p.substep)
    middle, area = _flow(early, state.pressure[i, k], state.commands[i, p.dead_steps + 1, k], offered, demanded, p)
    after, rest = _flow(p.substep - early, middle, state.commands[i, p.dead_steps, k], offered, demanded, p)
    return after, (area + rest) / p.substep
