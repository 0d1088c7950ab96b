"""FASTSIM with falling friction as a traction law (see `wsp_env.contact.fastsim`); no recovery, lateral creepage or spin.

Without those its force depends on one number, the stress gradient epsilon = stiffness e / (mu N) of eq. (6), so that it is
computed on the unit circle. mu(s) is eq. (7) of the seed paper, the same all over the contact.
"""

import math
from typing import Any, NamedTuple

from wsp_env.compiled import inlined, kernel
from wsp_env.contact.fastsim import fastsim
from wsp_env.contact.kalker import Patch
from wsp_env.contact.laws.mixed import bounded, kinetic_friction
from wsp_env.contact.polach import falling_friction
from wsp_env.contact.traction import Adhesion, Surface, TractionLaw

#: Strips and elements: the share of the friction limit is then within 0.2 % of the converged one (tests/test_contact_port.py).
STRIPS, ELEMENTS = 12, 32

#: Step of the finite difference of the share by epsilon, relative and least [-].
_STEP, _LEAST_STEP = 1e-4, 1e-7


class FastsimLaw(NamedTuple):
    """Parameters that do not change along the track."""

    stiffness: float  # pi G a b c11 / 4 [N], eq. (6)
    mu_cr: float  # kinetic friction coefficient of the clean rail [-]
    ratio_d: float  # A, kinetic over static friction [-]
    gamma_d: float  # friction decrease rate [s/m]


@kernel
def _share(epsilon: float) -> float:
    """Share of the friction limit in use [-] at the stress gradient epsilon [-]."""
    force, _ = fastsim(epsilon, 0.0, 0.0, 1.0, 1.0, Patch(1.0, 1.0, 1.0, 4.0 / math.pi, 1.0, 1.0), STRIPS, ELEMENTS)
    return force


@inlined
def evaluate(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: FastsimLaw) -> Adhesion:
    """Evaluate the law; see `wsp_env.contact.traction.TractionLaw`."""
    slip, per_speed, dper_dv, load = bounded(slip_speed, speed, normal_load)
    kinetic = kinetic_friction(on)
    mu = falling_friction(slip, kinetic, law.ratio_d, law.gamma_d)
    dmu_ds = -law.gamma_d * (mu - kinetic)
    per_creepage = law.stiffness / (mu * load)
    epsilon = per_creepage * slip * per_speed
    step = max(_STEP * epsilon, _LEAST_STEP)
    share = _share(epsilon)
    slope = (_share(epsilon + step) - share) / step
    clean = falling_friction(slip, on.mu_cr, law.ratio_d, law.gamma_d)
    recovered = _share(law.stiffness * slip * per_speed / (clean * load))
    df_ds = dmu_ds * (share - slope * epsilon) + mu * slope * per_creepage * per_speed
    return Adhesion(mu * share, mu * share, clean * recovered, df_ds, mu * slope * per_creepage * slip * dper_dv, 1.0)


def _make(contact: Any) -> FastsimLaw:
    return FastsimLaw(
        contact.stiffness_n, contact.kinetic_friction_r, contact.friction_ratio_d, contact.friction_decrease_d_spm
    )


LAW = TractionLaw("fastsim", "FASTSIM with falling friction", FastsimLaw, evaluate, _make)
