"""The radius of one wheelset differs from the believed one, because it is worn or newly turned.

At the same speed, the wheel turns faster or slower than believed, by geometry: while rolling freely, v - r w with the believed
r is proportional to v. (EN 15595 requires a WSP to tolerate differences of wheel diameter; size: assumption.)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.plant.card import Card, Parameter, RollsFreely, Said, Signature, each_axle, percent


class Parameters(NamedTuple):
    """Parameters of the radius, see `CARD`."""

    change: float
    axle: float


def radii(p: Parameters, believed_m: ArrayLike) -> np.ndarray:
    """Radius of the wheels of each axle (A,) [m]."""
    radius = np.array(believed_m, dtype=np.float64)
    if p.change != 0.0:
        radius[int(p.axle) - 1] *= 1.0 + p.change
    return radius


CARD = Card(
    name="wheel_radius",
    summary="one wheelset is worn or just turned",
    parameters=(
        Parameter("change", "-", 0.0, -0.01, -0.2, 0.2, "assumption: relative; wheels wear by some 5 % in their life"),
        Parameter("axle", "-", 1.0, 2.0, 1.0, 64.0, "assumption: which wheelset, from 1", "axle"),
    ),
    record=Parameters,
    acts={"radii": radii},
    signature=Signature(
        balances=frozenset({"kinematics"}),
        trace="kinematics: v against r w while rolling freely, in proportion to v",
        acts_on="sensor",
        next_test="coasting at constant speed for some 20 s, or measuring the wheels",
        said=(
            Said(
                "change",
                "%",
                percent,
                "axle {axle:.0f}'s wheels are {size} larger than believed",
                "axle {axle:.0f}'s wheels are {size} smaller than believed",
            ),
        ),
        over="speed",
        exact=True,
        variants=each_axle,
        rolls_freely=RollsFreely("change", 1.5e-3),  # assumption: three times the tolerance of 0.05 %
    ),
)
