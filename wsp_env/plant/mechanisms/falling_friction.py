"""Friction falls with the slip speed more, or less, than assumed (eq. 7 of the seed paper; Polach, Wear 258 (2005)).

`decrease` multiplies both decrease rates gamma; `excess` multiplies the excess 1 / A - 1 of static over kinetic friction. The
kinetic friction, at large slip, stays.
"""

from typing import NamedTuple

from wsp_env.contact.degraded import AdhesionLaw
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter


class Parameters(NamedTuple):
    """Parameters of the fall, see `MECHANISM`."""

    decrease: float
    excess: float


MECHANISM = Mechanism(
    name="falling_friction",
    summary="friction falls with slip speed more, or less, than assumed",
    parameters=(
        Parameter("decrease", "-", 1.0, 2.0, 0.0, 20.0, "form: eq. (7) of the seed paper; size: assumption"),
        Parameter("excess", "-", 1.0, 1.0, 0.0, 5.0, "form: eq. (7) of the seed paper; size: assumption"),
    ),
    record=Parameters,
    trace="adhesion: residual against slip speed",
)


def law(p: Parameters, believed: AdhesionLaw) -> AdhesionLaw:
    """Return the law with this fall."""
    return believed._replace(
        gamma_d=believed.gamma_d * p.decrease,
        gamma_r=believed.gamma_r * p.decrease,
        ratio_d=_ratio(p, believed.ratio_d),
        ratio_r=_ratio(p, believed.ratio_r),
    )


def _ratio(p: Parameters, believed: float) -> float:
    """Return A = kinetic over static friction [-]; exactly the believed one at the null."""
    return believed if p.excess == 1.0 else 1.0 / (1.0 + p.excess * (1.0 / believed - 1.0))
