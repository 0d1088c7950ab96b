"""Hertz's elliptic contact of two bodies of one elastic material.

Sources: H. Hertz, "Ueber die Beruehrung fester elastischer Koerper", J. reine angew. Math. 92 (1882) 156-171;
K. L. Johnson, Contact Mechanics (1985), section 4.2. Hertz's integrals are written with Carlson's symmetric ones,
R_D and R_F (DLMF 19.16), which need no distinction of the longer axis and hold for the circle too.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import elliprd, elliprf

# d log(A / B) / d log(a / b) lies between -2 (slender ellipse) and -1.5 (circle): with this slope the iteration for the
# ratio of the axes contracts by 1/7 or more a step wherever the ellipse is.
_SLOPE = -1.75
_STEPS = 60
_TOLERANCE = 1e-14  # of log(a / b)


class HertzContact(NamedTuple):
    """The contact ellipse; each field is a numpy scalar, or an array of the common shape of the arguments."""

    semi_axis_a_m: NDArray[np.float64]  # in rolling direction [m]
    semi_axis_b_m: NDArray[np.float64]  # in lateral direction [m]
    approach_m: NDArray[np.float64]  # of distant points of the two bodies [m]
    max_pressure_pa: NDArray[np.float64]  # at the centre [Pa]


def axis_ratio(curvature_a: ArrayLike, curvature_b: ArrayLike) -> NDArray[np.float64]:
    """Return a / b [-] of the ellipse, a function of the ratio of the curvature sums A, B [1/m] alone (see `hertz`)."""
    sum_a, sum_b = np.asarray(curvature_a, dtype=float), np.asarray(curvature_b, dtype=float)
    if not (np.all(sum_a > 0.0) and np.all(sum_b > 0.0) and np.all(np.isfinite(sum_a)) and np.all(np.isfinite(sum_b))):
        raise ValueError(
            f"curvature sums must be finite and above zero, got A = {curvature_a!r} /m, B = {curvature_b!r} /m: with a "
            "plane or negative sum the gap z = A x^2 + B y^2 does not close to an ellipse"
        )
    target = np.log(sum_a / sum_b)
    log_ratio = target / _SLOPE
    for _ in range(_STEPS):
        square = np.exp(2.0 * log_ratio)
        miss = np.log(elliprd(0.0, 1.0, square) / elliprd(0.0, square, 1.0)) - target
        log_ratio = log_ratio - miss / _SLOPE
        if np.all(np.abs(miss) < _TOLERANCE * (1.0 + np.abs(target))):
            break
    result: NDArray[np.float64] = np.exp(log_ratio)
    return result


def hertz(
    curvature_a: ArrayLike,
    curvature_b: ArrayLike,
    normal_load: ArrayLike,
    youngs_modulus: ArrayLike,
    poisson_ratio: ArrayLike,
) -> HertzContact:
    """Solve the normal contact of two bodies that are z = A x^2 + B y^2 apart before they are pressed together.

    Parameters
    ----------
    curvature_a : A [1/m] in rolling direction: half the sum of the bodies' curvatures, 1 / (2 r) for a wheel of radius
        r on a straight rail
    curvature_b : B [1/m] in lateral direction, likewise
    normal_load : N [N]; 0 gives an ellipse of size zero
    youngs_modulus : E [Pa] of both bodies
    poisson_ratio : nu [-] of both bodies, 0 to 0.5

    Scalars or arrays that broadcast.

    Raises
    ------
    ValueError
        A curvature sum that is not above zero, a negative load, an impossible material.

    """
    load, young, poisson = (np.asarray(x, dtype=float) for x in (normal_load, youngs_modulus, poisson_ratio))
    if not np.all((load >= 0.0) & np.isfinite(load)):
        raise ValueError(f"normal load must be finite and not negative, got N = {normal_load!r} N: a contact only pushes")
    if not np.all((young > 0.0) & np.isfinite(young)):
        raise ValueError(f"Young's modulus must be finite and above zero, got E = {youngs_modulus!r} Pa")
    if not np.all((poisson >= 0.0) & (poisson <= 0.5)):
        raise ValueError(f"Poisson's ratio must lie in 0 to 0.5, got nu = {poisson_ratio!r}")
    square = axis_ratio(curvature_a, curvature_b) ** 2
    force = load * (1.0 - poisson**2) / (np.pi * young)  # N / (2 pi E*), 1 / E* = 2 (1 - nu^2) / E
    # A = force R_D(0, b^2, a^2) and B = force R_D(0, a^2, b^2), with R_D homogeneous of degree -3/2: from A + B.
    sums = np.asarray(curvature_a, dtype=float) + np.asarray(curvature_b, dtype=float)
    b = np.cbrt(force * (elliprd(0.0, 1.0, square) + elliprd(0.0, square, 1.0)) / sums)
    a = b * np.sqrt(square)
    loaded = b > 0.0
    length = np.where(loaded, b, 1.0)
    approach = np.where(loaded, 3.0 * force * elliprf(0.0, square, 1.0) / length, 0.0)
    pressure = np.where(loaded, 1.5 * load / (np.pi * np.sqrt(square) * length**2), 0.0)
    return HertzContact(a[()], b[()], approach[()], pressure[()])
