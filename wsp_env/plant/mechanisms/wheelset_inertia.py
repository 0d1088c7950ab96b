"""The inertia of the wheelsets differs from the believed one: worn or turned wheels, other discs, a drive.

A wheel turned from 920 to 840 mm loses a ring of the rim's width of 135 mm (rim width as in EN 13715) with pi/2 rho b (R^4 -
r^4) = 23 kg m2. The two wheels of a wheelset lose about 45 of its 160 kg m2 (seed paper, Table 5).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.plant.card import Card, Parameter, Said, Signature, percent


class Parameters(NamedTuple):
    """Parameters of the inertia, see `CARD`."""

    share: float


def inertia(p: Parameters, believed_kgm2: ArrayLike) -> np.ndarray:
    """Inertia of the wheelsets (A,) [kg m2]."""
    result: np.ndarray = np.asarray(believed_kgm2, dtype=np.float64) * (1.0 + p.share)
    return result


CARD = Card(
    name="wheelset_inertia",
    summary="the wheelsets' inertia is larger or smaller than believed",
    parameters=(
        Parameter("share", "-", 0.0, -0.25, -0.6, 1.5, "wheels turned from 920 to 840 mm, see the file; bounds: assumption"),
    ),
    record=Parameters,
    acts={"inertia": inertia},
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion"}),
        trace="adhesion, and vehicle with it: in proportion to dw/dt, on every axle as its speed changes",
        acts_on="vehicle",
        next_test="fast releases and applications of one axle's brake, whose slip then changes at a known torque",
        said=(
            Said(
                "share",
                "%",
                percent,
                "the wheelsets' inertia is {size} larger than believed",
                "the wheelsets' inertia is {size} smaller than believed",
            ),
        ),
        over="deceleration",
        exact=True,
        normal={"share": 0.03},  # assumption: wheels turned by about 8 mm of diameter, by the formula of this file
    ),
)
