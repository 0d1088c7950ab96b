"""The recovery lambda(W_sp) has a threshold or another curvature than the exponential.

lambda = 1 - exp(-u^n) with u = tau max(W_sp - W_0, 0): Weibull's form of eq. (4) of the seed paper. n above 1 starts late and
ends sharply, n below 1 the other way round; work below W_0 removes nothing. The law is then solved by Newton's method
(`wsp_env.contact.recovery`). Form and sizes: assumption.
"""

from typing import NamedTuple

from wsp_env.contact.degraded import AdhesionLaw
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter


class Parameters(NamedTuple):
    """Parameters of the shape, see `MECHANISM`."""

    exponent: float
    threshold_j_per_m: float


MECHANISM = Mechanism(
    name="recovery_shape",
    summary="the recovery has a threshold or another curvature",
    parameters=(
        Parameter("exponent", "-", 1.0, 1.5, 0.3, 4.0, "form: Weibull; size: assumption"),
        Parameter("threshold_j_per_m", "J/m", 0.0, 0.0, 0.0, 1e5, "assumption: work that removes nothing"),
    ),
    record=Parameters,
    trace="adhesion: curvature of lambda(W_sp)",
)


def law(p: Parameters, believed: AdhesionLaw) -> AdhesionLaw:
    """Return the law with this shape of recovery."""
    return believed._replace(recovery_exponent=p.exponent, recovery_threshold=p.threshold_j_per_m)
