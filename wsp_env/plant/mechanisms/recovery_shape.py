"""The recovery lambda(W_sp) has a threshold, or a curvature other than the exponential's.

lambda = 1 - exp(-u^n) with u = tau max(W_sp - W_0, 0): Weibull's form of eq. (4) of the seed paper. With n above 1 the recovery
starts late and ends sharply; with n below 1 it is the other way round. Work below W_0 removes nothing. The law is then solved
by Newton's method (`wsp_env.contact.recovery`). Form and sizes: assumption.
"""

from typing import Any, NamedTuple

from wsp_env.plant.card import Card, Parameter, Said, Signature, itself


class Parameters(NamedTuple):
    """Parameters of the shape, see `CARD`."""

    exponent: float
    threshold_j_per_m: float


def law(p: Parameters, believed: Any) -> Any:
    """Return the law with this shape of recovery."""
    return believed._replace(recovery_exponent=p.exponent, recovery_threshold=p.threshold_j_per_m)


CARD = Card(
    name="recovery_shape",
    summary="the recovery has a threshold or another curvature",
    parameters=(
        Parameter("exponent", "-", 1.0, 1.5, 0.3, 4.0, "form: Weibull; size: assumption"),
        Parameter("threshold_j_per_m", "J/m", 0.0, 0.0, 0.0, 1e5, "assumption: work that removes nothing"),
    ),
    record=Parameters,
    acts={"law": law},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: curvature of lambda(W_sp)",
        acts_on="contact",
        next_test="stops with the creepage limited to 5 % and to 20 %, so that little and much friction work is done",
        said=(
            Said(
                "exponent",
                "",
                itself,
                "the contaminant layer goes later, and then faster, than believed, with exponent {size} instead of 1",
                "the contaminant layer goes sooner, and then more slowly, than believed, with exponent {size} instead of 1",
            ),
            Said("threshold_j_per_m", "J/m", itself, "friction work below {size} removes nothing of the contaminant layer"),
        ),
        over="work",
    ),
    study={"exponent": 2.0},
)
