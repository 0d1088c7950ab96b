"""Friction falls with slip speed more or less than assumed (eq. 7 of the seed paper; Polach, Wear 258 (2005)).

`decrease` multiplies the decrease rates gamma. `excess` multiplies the excess 1 / A - 1 of static over kinetic friction. The
kinetic friction, at large slip, is unchanged. A contaminant layer and a cleaned rail need not differ
alike from what is assumed: of the recovered friction, both change by `recovered` times as much.
"""

from typing import Any, NamedTuple

from wsp_env.plant.card import Card, OnCreepCurve, Parameter, Recorded, Said, Signature, itself, which_friction


class Parameters(NamedTuple):
    """Parameters of the fall, see `CARD`."""

    decrease: float
    excess: float
    recovered: float


def law(p: Parameters, believed: Any) -> Any:
    """Return the law with changed falling friction; a law with a single friction curve has no gamma_r and ratio_r."""
    changed = {"gamma_d": believed.gamma_d * p.decrease, "ratio_d": _ratio(p.excess, believed.ratio_d)}
    if "gamma_r" in believed._fields:
        decrease, excess = (max(1.0 + p.recovered * (factor - 1.0), 0.0) for factor in (p.decrease, p.excess))
        changed |= {"gamma_r": believed.gamma_r * decrease, "ratio_r": _ratio(excess, believed.ratio_r)}
    return believed._replace(**changed)


def _ratio(excess: float, believed: float) -> float:
    """Return A = kinetic over static friction [-]; exactly the believed value at the null."""
    return believed if excess == 1.0 else 1.0 / (1.0 + excess * (1.0 / believed - 1.0))


def either(recorded: Recorded) -> list[dict[str, float]]:
    """Return what is tried: both frictions change alike, or that of the contaminated rail alone."""
    return [{"recovered": 1.0}, {"recovered": 0.0}]


CARD = Card(
    name="falling_friction",
    summary="friction falls with slip speed more, or less, than assumed",
    parameters=(
        Parameter("decrease", "-", 1.0, 2.0, 0.0, 20.0, "form: eq. (7) of the seed paper; size: assumption"),
        Parameter("excess", "-", 1.0, 1.0, 0.0, 5.0, "form: eq. (7) of the seed paper; size: assumption"),
        Parameter(
            "recovered",
            "-",
            1.0,
            1.0,
            0.0,
            2.0,
            "assumption: change of the recovered friction over that of mu_d",
            "shape",
            refit_step=0.2,
        ),
    ),
    record=Parameters,
    acts={"law": law},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: residual against slip speed",
        acts_on="contact",
        next_test="stops with the creepage limited to 5 % and to 30 % at equal speed",
        said=(
            Said(
                "decrease",
                "",
                itself,
                "{which} falls faster with slip speed than believed, at {size} times the rate",
                "{which} falls more slowly with slip speed than believed, at {size} times the rate",
            ),
            Said(
                "excess",
                "",
                itself,
                "{which} falls further with slip speed than believed, {size} times as far",
                "{which} falls less far with slip speed than believed, {size} times as far",
            ),
        ),
        variants=either,
        words=which_friction,
        creep_curve=OnCreepCurve(
            null_at_constant_friction={"excess": 0.0},
            test_if_open="points beyond {highest:.0%} creepage, until the friction no longer falls",
        ),
    ),
)
