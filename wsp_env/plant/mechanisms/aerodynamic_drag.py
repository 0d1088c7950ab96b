"""Running resistance A + B v + C v^2 in addition to the believed one (W. J. Davis, General Electric Review, 1926)."""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Moment, Parameter, Said, Signature

_DAVIS = "form: Davis (1926); size: assumption, "


class Parameters(NamedTuple):
    """Parameters of the resistance, see `CARD`."""

    a_n: float
    b_ns_per_m: float
    c_ns2_per_m2: float


@inlined
def force(p: Parameters, i: int, speed_mps: float, believed_n: float, moment: Moment) -> float:
    """Force against the motion [N] in addition to the believed running resistance."""
    return p.a_n + speed_mps * (p.b_ns_per_m + speed_mps * p.c_ns2_per_m2)


CARD = Card(
    name="aerodynamic_drag",
    summary="running resistance beyond the believed one",
    parameters=(
        Parameter("a_n", "N", 0.0, 0.0, -5e3, 5e3, _DAVIS + "left to the gradient, which is constant too", fitted=False),
        Parameter("b_ns_per_m", "N s/m", 0.0, 0.0, -500.0, 500.0, _DAVIS + "small for coaches", fitted=False),
        Parameter("c_ns2_per_m2", "N s2/m2", 0.0, 2.5, -20.0, 20.0, _DAVIS + "a vehicle of 10 m2 running alone"),
    ),
    record=Parameters,
    acts={"force": force},
    signature=Signature(
        balances=frozenset({"vehicle"}),
        trace="vehicle: grows with the square of the speed, also while coasting",
        acts_on="vehicle",
        next_test="coasting from the highest speed",
        said=(
            Said(
                "c_ns2_per_m2",
                "kN",
                lambda c: 0.9 * c,
                "the running resistance at 30 m/s is {size} higher than believed",
                "the running resistance at 30 m/s is {size} lower than believed",
            ),
        ),
        over="speed",
        exact=True,
    ),
    study={"c_ns2_per_m2": 4.0},
)
