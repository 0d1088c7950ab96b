"""An effect's size net of the law: what stops do differently by it than by the law as it is tuned to their recordings.

Much of what an effect does another tau and another mu_cd do as well. Whoever tunes has done that already; what is left is what
a simulation lacks. The stops are driven by the truth twice: with the effect, and without it but with tau and mu_cd moved as
the tuning moved them when the effect came into the recordings.
"""

import dataclasses

from experiments.concealed.interest import DISTANCE_SHARE, SLIP_MPS, Outcome, compared, outcomes
from experiments.concealed.setup import Setup
from wsp_env.recordings.tuning import Tuning

#: Mean slip [m/s] of an axle from which on a stop is a sliding one: twice what matters.
_SLIDES_MPS = 2.0 * SLIP_MPS


def net(setup: Setup, plain: Setup, beside: Tuning | None, without: Tuning | None) -> float:
    """Return the size of what is concealed in a campaign, in multiples of what matters: 1 % of distance or 0.1 m/s of slip.

    Parameters
    ----------
    setup, plain : the campaign with its effects, and the same without
    beside, without : the law tuned to the recordings of either; None where nothing slides

    """
    law = plain
    if beside is not None and without is not None:
        ratio = {name: beside.runs[name].mu_cd / without.runs[name].mu_cd for name in plain.runs}
        tau = plain.law.tau * beside.tau_m_per_J / without.tau_m_per_J
        runs = {name: run._replace(mu_cd=run.mu_cd * ratio[name]) for name, run in plain.runs.items()}
        law = dataclasses.replace(plain, law=plain.law._replace(tau=tau), runs=runs)
    base = outcomes(law)
    distance, slip = compared(base, outcomes(setup), _kinds(base))
    return max(abs(distance) / DISTANCE_SHARE, slip / SLIP_MPS)


def _kinds(base: dict[str, Outcome]) -> list[list[str]]:
    """Part stops that slide from those that do not: a mean over both would hide either."""
    slides = {name: float(slip.max()) > _SLIDES_MPS for name, (_, slip) in base.items()}
    kinds = ([name for name in base if slides[name] is wanted] for wanted in (True, False))
    return [kind for kind in kinds if kind]
