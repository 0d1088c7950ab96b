"""Adhesion of one wheel after docs/contact.md, with its derivatives; solved by a Newton iteration.

Source of the law: Meli, Ridolfi et al. (degraded adhesion, seed paper of the project); Polach 2005 for the curves.
"""

import math

from experiments.other_plant.records import Curve, compiled

_SLOWEST_MPS = 1e-3  # below, the creepage is taken over this speed (docs/contact.md)
_TOLERANCE = 1e-13  # of the adhesion coefficient [-]
_MOST_ITERATIONS = 60


@compiled
def polach(slip: float, creepage: float, load: float, stiffness: float, curve: Curve) -> tuple[float, float, float]:
    """Return the adhesion coefficient of one curve.

    Parameters
    ----------
    slip, creepage
        amounts of v - r omega [m/s] and of the same over v [-]
    load, stiffness
        of one wheel [N], [N]
    curve
        friction and reduction factors

    Returns
    -------
    tuple
        f [-], df/dslip at constant creepage [s/m], df/dcreepage at constant slip [-]

    """
    rise = curve.friction * (1.0 / curve.ratio - 1.0) * math.exp(-curve.decrease * slip)
    mu = curve.friction + rise
    gradient = stiffness * creepage / (mu * load)
    a, s = curve.k_a * gradient, curve.k_s * gradient
    shape = a / (1.0 + a * a) + math.atan(s)
    slope = curve.k_a * (1.0 - a * a) / (1.0 + a * a) ** 2 + curve.k_s / (1.0 + s * s)
    by_mu = 2.0 / math.pi * (shape - gradient * slope)
    return 2.0 / math.pi * mu * shape, -curve.decrease * rise * by_mu, 2.0 / math.pi * stiffness / load * slope


@compiled
def adhesion(
    slip: float, speed: float, load: float, stiffness: float, film: Curve, clean: Curve, tau: float
) -> tuple[float, float, float]:
    """Return the adhesion coefficient between film and clean rail.

    f solves g(f) = f - f_r + (f_r - f_d) exp(-a f) = 0 with a = tau N |e|. g is convex, negative at f_d and positive at f_r, so
    that Newton's iteration from f_r falls monotonically onto the only root between them.

    Parameters
    ----------
    slip, speed
        v - r omega and v [m/s]
    load, stiffness
        of one wheel [N], [N]
    film, clean
        the curves of the contaminated and of the clean rail
    tau
        recovery rate of one wheel [m/J]; 0 is the classic law

    Returns
    -------
    tuple
        f [-] with the sign of the slip, df/dslip at constant speed [s/m], df/dspeed at constant slip [s/m]

    """
    sign = 1.0 if slip >= 0.0 else -1.0
    amount, base = abs(slip), max(speed, _SLOWEST_MPS)
    creepage = amount / base
    f, by_slip, by_creepage = polach(amount, creepage, load, stiffness, film)
    if tau > 0.0:
        f_r, r_slip, r_creepage = polach(amount, creepage, load, stiffness, clean)
        gap, a = f_r - f, tau * load * creepage
        f = f_r
        left = 1.0
        for _ in range(_MOST_ITERATIONS):
            left = math.exp(-a * f)
            change = (f - f_r + gap * left) / (1.0 - a * gap * left)
            f -= change
            if abs(change) < _TOLERANCE:
                break
        whole = 1.0 - a * gap * left
        by_slip = ((1.0 - left) * r_slip + left * by_slip) / whole
        by_creepage = ((1.0 - left) * r_creepage + left * by_creepage + gap * left * f * tau * load) / whole
    return sign * f, by_slip + by_creepage / base, -sign * by_creepage * creepage / base
