"""Kalker's linear theory, saturated after Johnson and Vermeulen, with falling friction (see `wsp_env.contact.kalker`).

T = mu N (x - x^2 / 3 + x^3 / 27) with x = G a b c11 e / (mu N) up to x = 3, mu N beyond; mu(s) is eq. (7) of the seed paper. No
recovery, no lateral creepage, no spin.
"""

import math
from typing import Any, NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact.laws.mixed import bounded, kinetic_friction
from wsp_env.contact.polach import falling_friction
from wsp_env.contact.traction import Adhesion, Surface, TractionLaw


class KalkerLaw(NamedTuple):
    """Parameters that do not change along the track."""

    stiffness: float  # pi G a b c11 / 4 [N], eq. (6)
    mu_cr: float  # kinetic friction coefficient of the clean rail [-]
    ratio_d: float  # A, kinetic over static friction [-]
    gamma_d: float  # friction decrease rate [s/m]


@inlined
def _share(x: float) -> tuple[float, float]:
    """Share of the friction limit in use [-] at the linear force over that limit, x [-], and its derivative by x."""
    if x >= 3.0:
        return 1.0, 0.0
    return x * (1.0 - x / 3.0 + x * x / 27.0), (1.0 - x / 3.0) ** 2


@inlined
def evaluate(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: KalkerLaw) -> Adhesion:
    """Evaluate the law; see `wsp_env.contact.traction.TractionLaw`."""
    slip, per_speed, dper_dv, load = bounded(slip_speed, speed, normal_load)
    linear = 4.0 / math.pi * law.stiffness / load  # G a b c11 / N
    kinetic = kinetic_friction(on)
    mu = falling_friction(slip, kinetic, law.ratio_d, law.gamma_d)
    x = linear * slip * per_speed / mu
    share, slope = _share(x)
    dmu_ds = -law.gamma_d * (mu - kinetic)
    clean = falling_friction(slip, on.mu_cr, law.ratio_d, law.gamma_d)
    recovered, _ = _share(linear * slip * per_speed / clean)
    df_ds = dmu_ds * (share - slope * x) + slope * linear * per_speed
    return Adhesion(mu * share, mu * share, clean * recovered, df_ds, slope * linear * slip * dper_dv, 1.0)


def _make(contact: Any) -> KalkerLaw:
    return KalkerLaw(contact.stiffness_n, contact.kinetic_friction_r, contact.friction_ratio_d, contact.friction_decrease_d_spm)


LAW = TractionLaw("kalker", "Kalker's linear theory, saturated, with falling friction", KalkerLaw, evaluate, _make)
