"""Polach's law with falling friction (Wear 258 (2005) 992-1000) on a rail whose friction the contaminant layer lowers.

Eqs. (5) to (7) of the seed paper with one set of reduction factors and of falling friction, that of the contaminated rail.
No recovery.
"""

from typing import Any, NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact.degraded import limit
from wsp_env.contact.laws.mixed import bounded, kinetic_friction
from wsp_env.contact.traction import Adhesion, Surface, TractionLaw


class PolachLaw(NamedTuple):
    """Parameters that do not change along the track."""

    stiffness: float  # pi G a b c11 / 4 [N], eq. (6)
    k_a: float  # Polach's reduction factor of the adhesion area [-]
    k_s: float  # the same of the slip area [-]
    mu_cr: float  # kinetic friction coefficient of the clean rail [-]
    ratio_d: float  # A, kinetic over static friction [-]
    gamma_d: float  # friction decrease rate [s/m]


@inlined
def evaluate(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: PolachLaw) -> Adhesion:
    """Evaluate the law; see `wsp_env.contact.traction.TractionLaw`."""
    slip, per_speed, dper_dv, load = bounded(slip_speed, speed, normal_load)
    mu_c = kinetic_friction(on)
    f, df_ds, df_dp = limit(slip, per_speed, load, law.stiffness, mu_c, law.ratio_d, law.gamma_d, law.k_a, law.k_s)
    clean, _, _ = limit(slip, per_speed, load, law.stiffness, on.mu_cr, law.ratio_d, law.gamma_d, law.k_a, law.k_s)
    return Adhesion(f, f, clean, df_ds, df_dp * dper_dv, 1.0)


def _make(contact: Any) -> PolachLaw:
    return PolachLaw(
        contact.stiffness_n,
        contact.polach_k_ad,
        contact.polach_k_sd,
        contact.kinetic_friction_r,
        contact.friction_ratio_d,
        contact.friction_decrease_d_spm,
    )


LAW = TractionLaw("polach", "Polach's law with falling friction, no recovery", PolachLaw, evaluate, _make)
