"""The creep curve rises less steeply than in Kalker's theory, because third body and roughness soften the contact.

The factor multiplies the contact stiffness of eq. (6), and thus both of Polach's reduction factors k (O. Polach, Wear 258
(2005) 992-1000, finds k_A of 0.5 to 1 in dry contacts, and less in wet or dirty ones).
"""

from typing import Any, NamedTuple

from wsp_env.plant.card import Card, OnCreepCurve, Parameter, Said, Signature, percent


class Parameters(NamedTuple):
    """Parameters of the slope, see `CARD`."""

    factor: float


def law(p: Parameters, believed: Any) -> Any:
    """Return the law with this initial slope."""
    return believed._replace(stiffness=believed.stiffness * p.factor)


CARD = Card(
    name="initial_slope",
    summary="the creep curve rises less steeply than Kalker's, or more",
    parameters=(
        Parameter("factor", "-", 1.0, 0.5, 0.005, 3.0, "Polach (2005): reduction by a third body; bounds: assumption"),
    ),
    record=Parameters,
    acts={"law": law},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: residual below 1 % creepage",
        acts_on="contact",
        next_test="gentle stops at several demands below sliding, for the slope of the creep curve",
        said=(
            Said(
                "factor",
                "%",
                lambda factor: percent(factor - 1.0),
                "the creep curve begins {size} steeper than Kalker's",
                "the creep curve begins {size} flatter than Kalker's",
            ),
        ),
        normal={"factor": 0.06},  # assumption: twice the 3 % by which sound contacts vary
        creep_curve=OnCreepCurve(
            test_if_named="points below {lowest:.2%} creepage, down to rolling freely: only they show the slope itself",
            moved_by_radius="factor",
        ),
    ),
)
