"""The wheel profile S1002 and the head of the rail UIC60 in closed form.

Sources: S1002 in EN 13715, annex (pieces A to H there); UIC60 head from its radii 300, 80 and 13 mm and the flank 1:20
(EN 13674-1, 60E1), joined tangent-continuously. Both agree with the files of the Manchester contact benchmark within 2e-5 mm.
"""

import math

from wsp_env.contact.geometry.profile import Profile, arc, assembled, polynomial

_MM = 1e-3

# Polynomials of rising powers, in mm.
_A = (1.364323640, -0.066666667)
_B = (0.0, -3.358537058e-2, 1.565681624e-3, -2.810427944e-5, 5.844240864e-8, -1.562379023e-8, 5.309217349e-15,
      -5.957839843e-12, 2.646656573e-13)  # fmt: skip
_C = (-4.320221063e3, -1.038384026e3, -1.065501873e2, -6.051367875, -2.054332446e-1, -4.169739389e-3, -4.687195829e-5,
      -2.252755540e-7)  # fmt: skip
_E = (-93.576667419, -2.747477419)
_S1002_BREAKS = (-70.0, -62.764706, -49.662510, -39.764474, -38.426669, -35.0, -26.0, 32.15796, 60.0)


def _in_metres(coefficients: tuple[float, ...]) -> list[float]:
    return polynomial([c * _MM ** (1 - power) for power, c in enumerate(coefficients)])


def _arc(y: float, z: float, radius: float, branch: float) -> list[float]:
    return arc(y * _MM, z * _MM, radius * _MM, branch)


def s1002() -> Profile:
    """Return the wheel profile S1002 from the back of the flange, 70 mm inside the taping line, to the chamfer at 60 mm."""
    pieces = [
        _arc(-49.5, 9.519259302, 20.5, 1.0),  # H, back of the flange
        _arc(-55.0, 16.0, 12.0, 1.0),  # G, crest
        _arc(-58.558326413, 8.834924130, 20.0, 1.0),  # F
        _in_metres(_E),  # E, the steep flank
        _arc(-26.210665, 16.446, 13.0, -1.0),  # D, throat
        _in_metres(_C),
        _in_metres(_B),
        _in_metres(_A),
    ]
    return assembled([y * _MM for y in _S1002_BREAKS], pieces)


def uic60() -> Profile:
    """Return the head of the rail UIC60, symmetric, down to 30 mm below its top."""
    joints, centres = [10.5, 25.988], [(0.0, -300.0, 300.0)]
    for joint, radius in zip(joints, (80.0, 13.0), strict=True):  # the centre lies on the normal at the joint
        y, z, before = centres[-1]
        share = (before - radius) / before
        centres.append((y + share * (joint - y), z + share * math.sqrt(before**2 - (joint - y) ** 2), radius))
    y, z, radius = centres[-1]
    flank = y + radius * 20.0 / math.hypot(20.0, 1.0)  # where the arc has the slope 20
    top = z + radius / math.hypot(20.0, 1.0)
    end = flank + (30.0 + top) / 20.0
    half = [*joints, flank, end]
    right = [_arc(*centre, 1.0) for centre in centres]
    left = [_arc(-y, z, radius, 1.0) for y, z, radius in reversed(centres[1:])]
    pieces = [
        polynomial([top * _MM, 20.0], -flank * _MM),
        *left,
        *right,
        polynomial([top * _MM, -20.0], flank * _MM),
    ]
    return assembled([y * _MM for y in (*(-y for y in reversed(half)), *half)], pieces)
