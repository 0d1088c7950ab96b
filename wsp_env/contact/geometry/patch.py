"""Hertz's ellipse and Kalker's coefficients for the curvatures at hand, tabulated for compiled code.

Both depend on A / B alone but for powers of load and size (Johnson (1985), section 4.2). `wsp_env.contact.hertz` and
`wsp_env.contact.kalker` fill the table once for a material; a contact then costs two interpolations.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import elliprd

from wsp_env.compiled import loop
from wsp_env.contact.hertz import hertz
from wsp_env.contact.kalker import Patch, kalker_coefficients

Array = NDArray[np.float64]

#: Nodes of the table, and the least b / a and a / b in it: a flange whose radii nearly fit the rail's reaches 20. Linear
#: interpolation of the logarithms is then within 2e-5 of the functions themselves.
_NODES, _SLENDEREST = 1024, 0.01


class PatchTable(NamedTuple):
    """Logarithms over log(A / B), evenly spaced, for a / b from 0.01 to 100.

    Kalker's table ends at 0.1 and 10; beyond, its last coefficients are kept.
    """

    first: float  # log(A / B) [-]
    step: float
    rows: Array  # (nodes, 6): semi-axes a, b and load per approach^1.5 for A + B = 1 /m and N = 1 N, then c11, c22, c23
    shear_modulus: float  # [Pa]


def make_patch_table(youngs_modulus: float, poisson_ratio: float) -> PatchTable:
    """Return the table of one elastic material, E [Pa] and nu [-], the same for wheel and rail; `ValueError` as `hertz`."""

    def log_sums(ratio: float) -> float:
        return math.log(elliprd(0.0, 1.0, ratio**2) / elliprd(0.0, ratio**2, 1.0))

    nodes = np.linspace(
        log_sums(1.0 / _SLENDEREST), log_sums(_SLENDEREST), _NODES
    )  # the longer an ellipse in rolling direction, the smaller A
    share = 1.0 / (1.0 + np.exp(-nodes))  # A / (A + B)
    ellipse = hertz(share, 1.0 - share, 1.0, youngs_modulus, poisson_ratio)
    ratio = np.clip(ellipse.semi_axis_a_m / ellipse.semi_axis_b_m, 0.1, 10.0)
    per_approach = ellipse.approach_m**-1.5
    coefficients = kalker_coefficients(ratio, poisson_ratio)
    rows = np.log([ellipse.semi_axis_a_m, ellipse.semi_axis_b_m, per_approach, *coefficients])
    shear = 0.5 * youngs_modulus / (1.0 + poisson_ratio)
    return PatchTable(float(nodes[0]), float(nodes[1] - nodes[0]), np.ascontiguousarray(rows.T), shear)


@loop
def _position(curvature_a: float, curvature_b: float, table: PatchTable) -> tuple[int, float]:
    """Return node and share of the next one; a contact slenderer than the table is taken as its end."""
    nodes = table.rows.shape[0]
    least = 1e-12 * (curvature_a + curvature_b)
    at = (math.log(max(curvature_a, least) / max(curvature_b, least)) - table.first) / table.step
    at = min(max(at, 0.0), nodes - 1.0)
    node = min(int(at), nodes - 2)
    return node, at - node


@loop
def _value(node: int, share: float, column: int, table: PatchTable) -> float:
    return math.exp(table.rows[node, column] * (1.0 - share) + table.rows[node + 1, column] * share)


@loop
def stiffness_at(curvature_a: float, curvature_b: float, table: PatchTable) -> float:
    """Return k [N/m^1.5] of Hertz's N = k penetration^1.5 for the curvature sums A, B [1/m]."""
    node, share = _position(curvature_a, curvature_b, table)
    return _value(node, share, 2, table) / math.sqrt(curvature_a + curvature_b)


@loop
def patch_at(curvature_a: float, curvature_b: float, normal_load: float, table: PatchTable) -> Patch:
    """Return the ellipse under a load [N] and Kalker's coefficients for it."""
    node, share = _position(curvature_a, curvature_b, table)
    size = (max(normal_load, 0.0) / (curvature_a + curvature_b)) ** (1.0 / 3.0)
    return Patch(
        size * _value(node, share, 0, table), size * _value(node, share, 1, table), table.shear_modulus,
        _value(node, share, 3, table), _value(node, share, 4, table), _value(node, share, 5, table),
    )  # fmt: skip


@loop
def normal_force(penetration: float, rate: float, stiffness: float, damping: float) -> float:
    """Return N [N] at a penetration [m] that grows at `rate` [m/s]: k p^1.5 (1 + damping rate), never below 0.

    The damping [s/m] is Hunt and Crossley's (J. Appl. Mech. 42 (1975) 440-445): its force vanishes where the contact opens.
    """
    if not penetration > 0.0:
        return 0.0
    return max(stiffness * penetration * math.sqrt(penetration) * (1.0 + damping * rate), 0.0)


def damping_of(ratio: float, normal_load: float, mass: float, stiffness: float) -> float:
    """Return the damping [s/m] that gives a mass [kg] on one contact this share of critical damping at a static load [N].

    Linearised: k' = 1.5 N / p and c = N damping, with p = (N / k)^(2/3).
    """
    penetration = (normal_load / stiffness) ** (2.0 / 3.0)
    return 2.0 * ratio * math.sqrt(1.5 * normal_load / penetration * mass) / normal_load
