"""Friction falls with the running speed.

Curtius and Kniffler (1944) measured 7.5 / (V + 44) + 0.161 with V in km/h. Only the relative fall is used, because both
friction coefficients have their own size here: mu(v) = mu (1 + share (g(v) / g(v_0) - 1)). share = 1 gives their curve, a
larger share a stronger fall. At the reference speed v_0, the friction is the believed one.
"""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, OnCreepCurve, Parameter, Said, Signature, percent

#: Reference speed [m/s], at which the friction is the believed one (assumption: middle of a stop from 40 m/s, where share and
#: mu_cd are least correlated).
REFERENCE_MPS = 20.0


class Parameters(NamedTuple):
    """Parameters of the fall with speed, see `CARD`."""

    share: float


@inlined
def _curtius_kniffler(speed_mps: float) -> float:
    return 7.5 / (3.6 * speed_mps + 44.0) + 0.161


@inlined
def friction_factor(p: Parameters, speed_mps: float) -> float:
    """Factor on both friction coefficients [-] at a running speed [m/s]."""
    if p.share == 0.0:
        return 1.0
    return 1.0 + p.share * (_curtius_kniffler(abs(speed_mps)) / _curtius_kniffler(REFERENCE_MPS) - 1.0)


CARD = Card(
    name="speed_dependent_friction",
    summary="friction falls with the running speed",
    parameters=(Parameter("share", "-", 0.0, 1.0, -1.0, 3.0, "1: Curtius and Kniffler, Glasers Annalen (1944)"),),
    record=Parameters,
    acts={"friction": friction_factor},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: runs of other initial speed; grows away from the reference speed at equal slip",
        acts_on="contact",
        next_test="stops from a low and from the highest initial speed at equal demand",
        said=(
            Said(
                "share",
                "%",
                percent,
                "friction falls with the running speed by {size} of the fall of Curtius and Kniffler",
                "friction rises with the running speed by {size} of the fall of Curtius and Kniffler",
            ),
        ),
        over="speed",
        creep_curve=OnCreepCurve(least_speeds=2),
    ),
    study={"share": 0.5},
)
