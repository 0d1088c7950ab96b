"""The seed paper's law whose recovery grows no further beyond the creepages at which it was fitted.

The recovery lambda = 1 - exp(-tau f N |e|) was fitted to stops with a WSP, whose wheels slide and do not lock. Carried on to a
locked wheel (e = 1) it cleans any rail so well that nothing ever locks. Here |e| counts up to `FITTED_CREEPAGE` in the work;
below it the law is the paper's, and so are the two friction curves everywhere.
"""

from typing import Any, NamedTuple

from wsp_env.compiled import inlined
from wsp_env.contact import degraded
from wsp_env.contact.degraded import DegradedLaw
from wsp_env.contact.traction import LOAD_FLOOR, SPEED_FLOOR, Adhesion, Surface, TractionLaw

#: Largest creepage [-] at which the recovery counts as fitted (assumption: the slide limit, where a WSP keeps its wheels).
FITTED_CREEPAGE = 0.3


class CappedLaw(NamedTuple):
    """Parameters that do not change along the track, as of `DegradedLaw`, and the cap."""

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
    creepage: float  # beyond which the work counts no more [-]


@inlined
def evaluate(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: CappedLaw) -> Adhesion:
    """Evaluate the law; see `wsp_env.contact.traction.TractionLaw`."""
    paper = DegradedLaw(
        law.stiffness, law.k_ad, law.k_sd, law.k_ar, law.k_sr, law.mu_cr, law.ratio_d, law.ratio_r, law.gamma_d, law.gamma_r,
        1.0, 0.0,
    )  # fmt: skip
    per_speed = 1.0 / max(abs(speed), SPEED_FLOOR)
    creepage = abs(slip_speed) * per_speed
    if creepage <= law.creepage:
        return degraded.adhesion(slip_speed, speed, normal_load, on, tau, paper)
    # The work is that at the cap: the same rate at the smaller creepage, and no change of it with slip or speed.
    fewer = tau * law.creepage / creepage
    state = degraded.adhesion(slip_speed, speed, normal_load, on, fewer, paper)
    load = max(normal_load, LOAD_FLOOR)
    gap = on.layer * (state.f_r - state.f_d)
    growth = gap * state.kept * state.f * fewer * load / max(1.0 - fewer * load * creepage * gap * state.kept, 1e-12)
    df_ds = state.df_ds - growth * per_speed
    rolls = abs(speed) > SPEED_FLOOR
    df_dv = state.df_dv + growth * creepage * per_speed if rolls else state.df_dv
    return Adhesion(state.f, state.f_d, state.f_r, df_ds, df_dv, state.kept)


def _make(contact: Any) -> CappedLaw:
    paper = degraded.LAW.make(contact)
    values: tuple[float, ...] = (*paper[: DegradedLaw._fields.index("recovery_exponent")], FITTED_CREEPAGE)
    return CappedLaw(*values)


LAW = TractionLaw("capped", "the seed paper's law, no further recovery beyond 30 % of creepage", CappedLaw, evaluate, _make)
