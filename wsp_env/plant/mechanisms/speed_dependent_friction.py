"""Friction falls with the running speed.

Curtius and Kniffler (1944) measured 7.5 / (V + 44) + 0.161 with V in km/h. Only the relative fall is used, because both
friction coefficients have their own size here: mu(v) = mu (1 + share fall (v_0 - v) (1 + bend v_0) / (1 + bend v)), with the
slope `fall` of their curve at v_0. share = 1 and bend = 3.6 / 44 s/m give their curve, bend = 0 a straight line. At the
reference speed v_0, the friction is the believed one. A lubricated contaminant layer and a cleaned rail need not fall alike:
mu_cr falls by `recovered` times the share of mu_cd. Friction that rises with the speed would be other physics.
"""

from typing import NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, OnCreepCurve, Parameter, Recorded, Said, Signature, percent, which_friction

#: Reference speed [m/s], at which the friction is the believed one (assumption: middle of a stop from 40 m/s, where share and
#: mu_cd are least correlated).
REFERENCE_MPS = 20.0
#: Bend of the curve of Curtius and Kniffler [s/m], and its relative slope at the reference speed [s/m].
BEND = 3.6 / 44.0
FALL = 7.5 / 44.0 * BEND / (1.0 + BEND * REFERENCE_MPS) ** 2 / (7.5 / (3.6 * REFERENCE_MPS + 44.0) + 0.161)
#: Smallest and largest factor on a friction coefficient [-] (assumption; a straight line would end below zero).
_LEAST, _MOST = 0.1, 3.0


class Parameters(NamedTuple):
    """Parameters of the fall with speed, see `CARD`."""

    share: float
    bend: float
    recovered: float


@inlined
def _factor(share: float, bend: float, speed_mps: float) -> float:
    fall = FALL * (REFERENCE_MPS - speed_mps) * (1.0 + bend * REFERENCE_MPS) / (1.0 + bend * speed_mps)
    return min(max(1.0 + share * fall, _LEAST), _MOST)


@inlined
def friction_factor(p: Parameters, speed_mps: float) -> float:
    """Factor on mu_cd [-] at a running speed [m/s]."""
    if p.share == 0.0:
        return 1.0
    return _factor(p.share, p.bend, abs(speed_mps))


@inlined
def recovered_friction_factor(p: Parameters, speed_mps: float) -> float:
    """Factor on mu_cr [-] at a running speed [m/s]."""
    if p.share == 0.0 or p.recovered == 0.0:
        return 1.0
    return _factor(p.share * p.recovered, p.bend, abs(speed_mps))


def curves(recorded: Recorded) -> list[dict[str, float]]:
    """Return the curves that are tried: straight and bent, of both coefficients and of mu_cd alone."""
    return [{"bend": bend, "recovered": recovered} for bend in (BEND, 0.0) for recovered in (1.0, 0.0)]


CARD = Card(
    name="speed_dependent_friction",
    summary="friction falls with the running speed",
    parameters=(
        Parameter("share", "-", 0.0, 1.0, 0.0, 3.0, "slope at 20 m/s; 1: Curtius and Kniffler, Glasers Annalen (1944)"),
        Parameter(
            "bend", "s/m", BEND, BEND, 0.0, 0.2, "Curtius and Kniffler (1944); 0: a straight line", "shape", refit_step=0.02
        ),
        Parameter(
            "recovered", "-", 1.0, 1.0, 0.0, 2.0, "assumption: fall of mu_cr over that of mu_cd", "shape", refit_step=0.2
        ),
    ),
    record=Parameters,
    acts={"friction": friction_factor, "recovered_friction": recovered_friction_factor},
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
                "{which} falls with the running speed; its slope at 20 m/s is {size} of Curtius and Kniffler's",
            ),
        ),
        over="speed",
        variants=curves,
        words=which_friction,
        creep_curve=OnCreepCurve(least_speeds=2),
    ),
    study={"share": 0.5},
)
