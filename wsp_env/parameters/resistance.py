"""Running resistance: what holds a vehicle back beside its brakes on level track (W. J. Davis, GE Review 1926)."""

from typing import NamedTuple, TypeVar

import numpy as np

from wsp_env.compiled import inlined

Speed = TypeVar("Speed", float, np.ndarray)


class Resistance(NamedTuple):
    """R(v) = a + b v + c v^2."""

    a: float  # [N]
    b: float  # [N s/m]
    c: float  # [N s2/m2]


@inlined
def running_resistance(speed: Speed, r: Resistance) -> Speed:
    """Return R [N] at a running speed [m/s], a number or an array."""
    return r.a + speed * (r.b + speed * r.c)
