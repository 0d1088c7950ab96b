"""Siemens Eurosprinter locomotive: the contact of Polach's example and the creep curve measured on it.

Sources: O. Polach, "Creep forces in simulations of traction vehicles running on adhesion limit", Wear 258 (2005) 992-1000,
as computed by CONTACT's example; the points: Engel, Beck, Alders, Elektrische Bahnen 96 (1998), see `wsp_env/data/README.md`.
"""

from importlib.resources import files

import numpy as np

from wsp_env.contact.hertz import hertz
from wsp_env.contact.kalker import Patch, kalker_coefficients

NORMAL_LOAD_N = 106_700.0  # of one wheel [N]
SHEAR_MODULUS_PA = 82.0e9  # [Pa]
POISSON_RATIO = 0.28  # [-]
CURVATURE_A_PER_M = 0.8  # curvature sum in rolling direction [1/m]
CURVATURE_B_PER_M = 0.2814  # in lateral direction [1/m]
SPEED_MPS = 10.0  # of the measured points [m/s]


def patch() -> Patch:
    """Return the contact patch by Hertz and Kalker's table."""
    youngs = 2.0 * SHEAR_MODULUS_PA * (1.0 + POISSON_RATIO)
    ellipse = hertz(CURVATURE_A_PER_M, CURVATURE_B_PER_M, NORMAL_LOAD_N, youngs, POISSON_RATIO)
    a, b = float(ellipse.semi_axis_a_m), float(ellipse.semi_axis_b_m)
    return Patch(a, b, SHEAR_MODULUS_PA, *map(float, kalker_coefficients(a / b, POISSON_RATIO)))


def measured() -> tuple[np.ndarray, np.ndarray]:
    """Return creepage [-] and adhesion coefficient [-] of the measured points, both (180,)."""
    file = files("wsp_env") / "data" / "eurosprinter" / "measured.csv"
    with file.open("r") as lines:
        points = np.loadtxt(lines, delimiter=",", skiprows=1)
    return points[:, 0], points[:, 1]
