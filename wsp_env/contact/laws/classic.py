"""The classic law: the degraded one without recovery (lambda = 0), whatever tau a stop has."""

from typing import Any, NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact import degraded
from wsp_env.contact.degraded import DegradedLaw
from wsp_env.contact.traction import Adhesion, Surface, TractionLaw


class ClassicLaw(NamedTuple):
    """The parameters of `DegradedLaw` that act without recovery, same names and units."""

    stiffness: float
    k_ad: float
    k_sd: float
    k_ar: float
    k_sr: float
    mu_cr: float
    ratio_d: float
    ratio_r: float
    gamma_d: float
    gamma_r: float


@inlined
def evaluate(
    slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: ClassicLaw
) -> Adhesion:  # fmt: skip
    """Evaluate the law; see `wsp_env.contact.traction.TractionLaw`."""
    paper = DegradedLaw(
        law.stiffness, law.k_ad, law.k_sd, law.k_ar, law.k_sr, law.mu_cr, law.ratio_d, law.ratio_r, law.gamma_d, law.gamma_r,
        1.0, 0.0,
    )  # fmt: skip
    return degraded.adhesion(slip_speed, speed, normal_load, on, 0.0, paper)


def _make(contact: Any) -> ClassicLaw:
    return ClassicLaw(*degraded.LAW.make(contact)[: len(ClassicLaw._fields)])


LAW = TractionLaw("classic", "the degraded law without recovery", ClassicLaw, evaluate, _make)
