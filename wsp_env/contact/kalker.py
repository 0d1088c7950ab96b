"""Kalker's coefficients and his linear theory of rolling contact, saturated after Johnson and Vermeulen.

Sources: J. J. Kalker, Three-Dimensional Elastic Bodies in Rolling Contact (1990), Table E.3 (first in his thesis, Delft
1967), checked number by number against the table in the open source of CONTACT; P. J. Vermeulen and K. L. Johnson,
"Contact of nonspherical elastic bodies transmitting tangential forces", J. Appl. Mech. 31 (1964) 338-340, with Kalker's
coefficients and spin in the linear force (Z. Y. Shen, J. K. Hedrick, J. A. Elkins, 1983). It is the "global Kalker
theory" of the seed paper's Table 9.

Conventions: creepages [-] and spin [1/m] are positive in the sense of eq. (2), slip over running speed; a positive one
gives a positive, retarding force, and a positive spin a positive lateral force.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsp_env.compiled import kernel

Array = NDArray[np.float64]


class KalkerCoefficients(NamedTuple):
    """Kalker's coefficients [-] of one ellipse and material; numpy scalars or arrays of one shape."""

    c11: Array  # longitudinal force per longitudinal creepage
    c22: Array  # lateral force per lateral creepage
    c23: Array  # lateral force per spin


class Patch(NamedTuple):
    """What the tangential contact laws need to know of a contact; `kalker_coefficients` gives the last three."""

    semi_axis_a: float  # in rolling direction [m]
    semi_axis_b: float  # in lateral direction [m]
    shear_modulus: float  # G [Pa]
    c11: float  # Kalker's coefficients [-]
    c22: float
    c23: float


_POISSON = (0.0, 0.25, 0.5)
_RATIO = np.concatenate([np.arange(1, 11) / 10.0, 10.0 / np.arange(9, 0, -1)])  # a / b: 0.1 ... 1, then b / a: 0.9 ... 0.1
# One row per ratio; columns c11 at nu = 0, 0.25, 0.5, then c22, then c23.
_TABLE_E3 = """
    2.51 3.31 4.85   2.51 2.52 2.53    .334 .473 .731
    2.59 3.37 4.81   2.59 2.63 2.66    .483 .603 .809
    2.68 3.44 4.80   2.68 2.75 2.81    .607 .715 .889
    2.78 3.53 4.82   2.78 2.88 2.98    .720 .823 .977
    2.88 3.62 4.83   2.88 3.01 3.14    .827 .929 1.07
    2.98 3.72 4.91   2.98 3.14 3.31    .930 1.03 1.18
    3.09 3.81 4.97   3.09 3.28 3.48    1.03 1.14 1.29
    3.19 3.91 5.05   3.19 3.41 3.65    1.13 1.25 1.40
    3.29 4.01 5.12   3.29 3.54 3.82    1.23 1.36 1.51
    3.40 4.12 5.20   3.40 3.67 3.98    1.33 1.47 1.63
    3.51 4.22 5.30   3.51 3.81 4.16    1.44 1.59 1.77
    3.65 4.36 5.42   3.65 3.99 4.39    1.58 1.75 1.94
    3.82 4.54 5.58   3.82 4.21 4.67    1.76 1.95 2.18
    4.06 4.78 5.80   4.06 4.50 5.04    2.01 2.23 2.50
    4.37 5.10 6.11   4.37 4.90 5.56    2.35 2.62 2.96
    4.84 5.57 6.57   4.84 5.48 6.31    2.88 3.24 3.70
    5.57 6.34 7.34   5.57 6.40 7.51    3.79 4.32 5.01
    6.96 7.78 8.82   6.96 8.14 9.79    5.72 6.63 7.89
    10.7 11.7 12.9   10.7 12.8 16.0    12.2 14.6 18.0
"""


@cache
def kalker_table() -> tuple[Array, Array]:
    """Return the table: 19 ratios a / b [-] and the coefficients [-], shape (19, 3 coefficients, 3 values of nu)."""
    values = np.array(_TABLE_E3.split(), dtype=float).reshape(len(_RATIO), 3, 3)
    values.flags.writeable = False
    return _RATIO, values


@cache
def _curves() -> Any:
    from scipy.interpolate import PchipInterpolator  # here, as it takes longer to import than all the rest

    # Powers of a / b describe both ends of the table well: its logarithms are interpolated, monotone between nodes.
    ratio, values = kalker_table()
    return PchipInterpolator(np.log(ratio), np.log(values), axis=0, extrapolate=False)


def kalker_coefficients(axis_ratio: ArrayLike, poisson_ratio: ArrayLike) -> KalkerCoefficients:
    """Interpolate Kalker's table: linearly in Poisson's ratio, smoothly (monotone cubic, log-log) in the ratio of axes.

    Parameters
    ----------
    axis_ratio : a / b [-], rolling over lateral semi-axis, 0.1 to 10
    poisson_ratio : nu [-], 0 to 0.5

    Scalars or arrays that broadcast.

    Raises
    ------
    ValueError
        Outside the table: nothing is extrapolated.

    """
    ratio, poisson = np.broadcast_arrays(np.asarray(axis_ratio, dtype=float), np.asarray(poisson_ratio, dtype=float))
    slack = 1e-12  # 1 / 10 and 10 themselves may be a rounding error outside
    if not np.all((ratio >= 0.1 * (1.0 - slack)) & (ratio <= 10.0 * (1.0 + slack))):
        raise ValueError(f"Kalker's table covers a / b from 0.1 to 10, got {axis_ratio!r}")
    if not np.all((poisson >= 0.0) & (poisson <= 0.5)):
        raise ValueError(f"Kalker's table covers Poisson's ratio from 0 to 0.5, got {poisson_ratio!r}")
    nodes, _ = kalker_table()
    at_ratio = np.exp(_curves()(np.clip(np.log(ratio), math.log(nodes[0]), math.log(nodes[-1]))))
    position = poisson[..., None, None] * 4.0
    weights = np.maximum(0.0, 1.0 - np.abs(position - np.arange(3.0)))  # linear in nu
    result = np.sum(at_ratio * weights, axis=-1)
    return KalkerCoefficients(result[..., 0][()], result[..., 1][()], result[..., 2][()])


@kernel
def linear_force(creepage_x: float, creepage_y: float, spin: float, patch: Patch) -> tuple[float, float]:
    """Return (T_x, T_y) [N] of Kalker's linear theory, without slip: creepages [-], spin [1/m]."""
    scale = patch.shear_modulus * patch.semi_axis_a * patch.semi_axis_b
    radius = math.sqrt(patch.semi_axis_a * patch.semi_axis_b)
    return (
        scale * patch.c11 * creepage_x,
        scale * (patch.c22 * creepage_y + radius * patch.c23 * spin),
    )


@kernel
def saturated_force(
    creepage_x: float, creepage_y: float, spin: float, normal_load: float, friction: float, patch: Patch
) -> tuple[float, float]:
    """Return (T_x, T_y) [N]: the linear force bent down to the friction limit by Johnson and Vermeulen's cubic.

    Creepages [-], spin [1/m], normal load of one wheel [N], constant friction coefficient [-].
    """
    linear_x, linear_y = linear_force(creepage_x, creepage_y, spin, patch)
    linear = math.hypot(linear_x, linear_y)
    limit = friction * normal_load
    if limit <= 0.0:
        return 0.0, 0.0
    share = linear / (3.0 * limit)
    scale = 1.0 - share + share * share / 3.0 if share < 1.0 else limit / linear
    return scale * linear_x, scale * linear_y


@kernel
def _loop(inputs: Array, forces: Array) -> None:
    for i in range(inputs.shape[1]):
        patch = Patch(inputs[5, i], inputs[6, i], inputs[7, i], inputs[8, i], inputs[9, i], inputs[10, i])
        forces[0, i], forces[1, i] = saturated_force(
            inputs[0, i], inputs[1, i], inputs[2, i], inputs[3, i], inputs[4, i], patch
        )


def each_contact(loop: Callable[[Array, Array], None], *arguments: ArrayLike) -> tuple[Array, Array]:
    """Broadcast the arguments, let `loop(inputs (k, n), forces (2, n))` fill in the forces, return (T_x, T_y) [N]."""
    arrays = np.broadcast_arrays(*[np.asarray(x, dtype=float) for x in arguments])
    shape = arrays[0].shape
    inputs = np.stack([x.ravel() for x in arrays])
    forces = np.empty((2, inputs.shape[1]))
    loop(inputs, forces)
    return forces[0].reshape(shape)[()], forces[1].reshape(shape)[()]


def kalker_force(
    creepage_x: ArrayLike,
    creepage_y: ArrayLike,
    spin: ArrayLike,
    normal_load: ArrayLike,
    friction: ArrayLike,
    patch: Patch,
) -> tuple[Array, Array]:
    """Return (T_x, T_y) [N] of `saturated_force` for scalars or arrays that broadcast; so may the fields of `patch`."""
    return each_contact(_loop, creepage_x, creepage_y, spin, normal_load, friction, *patch)
