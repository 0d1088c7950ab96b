"""Hertz' contact and Kalker's coefficients as a table over the ratio of the curvatures, for compiled code.

Everything follows from A / B (Hertz), with powers of the load and of A + B: N = k p^1.5, semi-axes a, b ~ N^(1/3). The table is
computed with `wsp_env.contact.hertz` and `wsp_env.contact.kalker` and read linearly over log(A / B), with errors below 1e-3.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined
from wsp_env.contact.hertz import hertz
from wsp_env.contact.kalker import kalker_coefficients
from wsp_env.parameters.contact import ContactParameters

#: Range of log(A / B) and its step; beyond, the ellipse is that of the range's end: a / b from 0.02 to 50.
_LOW, _STEP, _NODES = -7.0, 0.07, 201
#: Kalker's table ends there; what is more slender takes the coefficients of its end.
_LEAST_RATIO, _LARGEST_RATIO = 0.1, 10.0


class Elastic(NamedTuple):
    """What two steel bodies with A + B = 1 /m and a load of 1 N make, over log(A / B)."""

    table: NDArray[np.float64]  # (nodes, 6): k [N/m^1.5], a, b [m], c11, c22, c23 [-]
    low: float  # log(A / B) of the first node
    step: float  # between nodes
    shear_modulus: float  # [Pa]


class Ellipse(NamedTuple):
    """One contact's ellipse but for its load: k, a, b at 1 N."""

    stiffness: float  # N = stiffness p^1.5 [N/m^1.5]
    semi_axis_a: float  # times N^(1/3) [m]
    semi_axis_b: float  # times N^(1/3) [m]
    c11: float  # Kalker's coefficients [-]
    c22: float
    c23: float


def elastic(contact: ContactParameters) -> Elastic:
    """Return the table for the material of a contact."""
    nu, shear = contact.poisson_ratio, contact.shear_modulus_pa
    ratio = np.exp(_LOW + _STEP * np.arange(_NODES))
    ellipse = hertz(ratio / (1.0 + ratio), 1.0 / (1.0 + ratio), 1.0, 2.0 * shear * (1.0 + nu), nu)
    kalker = kalker_coefficients(np.clip(ellipse.semi_axis_a_m / ellipse.semi_axis_b_m, _LEAST_RATIO, _LARGEST_RATIO), nu)
    table = np.stack([ellipse.approach_m**-1.5, ellipse.semi_axis_a_m, ellipse.semi_axis_b_m, *kalker], axis=1)
    return Elastic(np.ascontiguousarray(table), _LOW, _STEP, shear)


@inlined
def ellipse(curvature_a: float, curvature_b: float, e: Elastic) -> Ellipse:
    """Return the ellipse of curvature sums A, B [1/m]; one of them below 1e-3 /m (a plane, or beyond) counts as 1e-3 /m."""
    sum_a, sum_b = max(curvature_a, 1e-3), max(curvature_b, 1e-3)
    at = (math.log(sum_a / sum_b) - e.low) / e.step
    at = min(max(at, 0.0), e.table.shape[0] - 1.001)
    i = int(at)
    w = at - i
    t = e.table
    total = sum_a + sum_b
    size = total ** (-1.0 / 3.0)
    return Ellipse(
        ((1.0 - w) * t[i, 0] + w * t[i + 1, 0]) / math.sqrt(total),
        ((1.0 - w) * t[i, 1] + w * t[i + 1, 1]) * size, ((1.0 - w) * t[i, 2] + w * t[i + 1, 2]) * size,
        (1.0 - w) * t[i, 3] + w * t[i + 1, 3], (1.0 - w) * t[i, 4] + w * t[i + 1, 4], (1.0 - w) * t[i, 5] + w * t[i + 1, 5],
    )  # fmt: skip
