"""Adhesion of one wheel on a contaminated rail: the degraded-adhesion law, solved by Newton's method.

Source: the seed paper (Meli, Ridolfi and others), eqs. (1) to (7), with the contact of its Table 2; Polach's curve: O. Polach,
Wear 258 (2005) 992-1000. With e the creepage, N the wheel's load and W = f N |e| the friction work per metre,

    f = f_d + (1 - exp(-tau W)) (f_r - f_d).
"""

import math

from experiments.other_truth.compiled import kernel

SEMI_AXIS_A_M, SEMI_AXIS_B_M, KALKER_C11, SHEAR_MODULUS_PA = 0.00488, 0.00691, 4.12, 8.0e10
K_AD, K_SD, K_AR, K_SR = 0.3, 0.1, 1.0, 0.4  # Polach's reduction factors, contaminated (d) and clean (r)
MU_CR, RATIO = 0.28, 0.4  # kinetic friction of the clean contact; kinetic over static friction of both
DECREASE_D_SPM, DECREASE_R_SPM = 0.2, 0.6  # [s/m] of the friction with the slip


@kernel
def polach(mu: float, k_a: float, k_s: float, stiffness: float, creep: float) -> float:
    """Return the adhesion coefficient, eq. (5); stiffness: pi G a b c11 / (4 N) [-]."""
    x = stiffness * creep / mu
    return 2.0 * mu / math.pi * (k_a * x / (1.0 + (k_a * x) ** 2) + math.atan(k_s * x))


@kernel
def limits(slip: float, v: float, load: float, mu_cd: float, hyperbolic: float) -> tuple[float, float]:
    """Return f_d, without recovery, and f_r, after full recovery, at a slip [m/s] >= 0 and a load [N].

    The friction of the contaminated contact falls with the slip s by exp(-g s); 1 / (1 + g s) takes the share `hyperbolic`
    of it.
    """
    creep = slip / v
    stiffness = SHEAR_MODULUS_PA * math.pi * SEMI_AXIS_A_M * SEMI_AXIS_B_M * KALKER_C11 / (4.0 * load)
    fall = math.exp(-DECREASE_D_SPM * slip)
    fall += hyperbolic * (1.0 / (1.0 + DECREASE_D_SPM * slip) - fall)
    f_d = polach(mu_cd * (1.0 + (1.0 / RATIO - 1.0) * fall), K_AD, K_SD, stiffness, creep)
    clean = MU_CR * (1.0 + (1.0 / RATIO - 1.0) * math.exp(-DECREASE_R_SPM * slip))
    return f_d, polach(clean, K_AR, K_SR, stiffness, creep)


@kernel
def adhesion(
    slip: float, v: float, load: float, mu_cd: float, tau: float, threshold: float, hyperbolic: float, remembered: float
) -> tuple[float, float]:
    """Return the adhesion coefficient and the friction work [J/m] of one wheel.

    Parameters
    ----------
    slip, v : slip and running speed [m/s], the slip of either sign
    load : of the wheel [N]
    mu_cd : kinetic friction of the contaminated contact
    tau : recovery rate [m/J]
    threshold : work [J/m] below which hardly anything recovers, 0: none
    hyperbolic : see `limits`
    remembered : work [J/m] that recovers instead of the present one; negative: nothing is remembered

    """
    slip = abs(slip)
    creep = slip / v
    f_d, f_r = limits(slip, v, load, mu_cd, hyperbolic)
    gap = f_r - f_d
    f = f_d
    if remembered >= 0.0:
        f = f_d + (1.0 - math.exp(-tau * remembered)) * gap
    elif threshold > 0.0:  # the lowest solution: successive substitution from below
        soft = 0.3 * threshold
        base = math.sqrt(threshold * threshold + soft * soft) - threshold
        for _ in range(40):
            over = f * load * creep - threshold
            f = f_d + (1.0 - math.exp(-0.5 * tau * (over + math.sqrt(over * over + soft * soft) - base))) * gap
    elif gap > 0.0:
        a = tau * load * creep  # f - f_r + gap exp(-a f) is convex in f: Newton from f_r falls on the root without overshoot
        f = f_r
        for _ in range(25):
            rest = gap * math.exp(-a * f)
            step = (f - f_r + rest) / (1.0 - a * rest)
            f -= step
            if step < 1e-10:
                break
    return f, f * load * creep
