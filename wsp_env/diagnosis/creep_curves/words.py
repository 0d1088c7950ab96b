"""What a diagnosis of creep curves says in words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import Closure
from wsp_env.diagnosis.creep_curves.answer import Inseparable, NamedOnCurve
from wsp_env.diagnosis.creep_curves.model import CreepModel, CurveFit
from wsp_env.diagnosis.creep_curves.search import CreepSearch
from wsp_env.diagnosis.creep_curves.separation import radius_note
from wsp_env.diagnosis.words import said

#: Why the other mechanisms of the library are not searched on creep curves.
NOT_SEARCHED = (
    "not searched, as a steady curve of one wheel cannot show them: what needs a history, a place or a second axle (film "
    "memory, cleaning, patches), recovery of the film (the rail is taken as it is), loads, brakes, vehicle and sensors' lags"
)


def sentence(verdict: str, named: Sequence[NamedOnCurve]) -> str:
    """Return the verdict in one sentence."""
    if verdict == "adequate":
        return "The law is adequate: Kalker's slope and the believed friction explain these points as far as they can show."
    if verdict == "insufficient":
        return "The points are insufficient: they scatter too much, or cover too little, to show any mechanism of the library."
    if verdict == "unknown":
        return "The curve has another shape than any mechanism of the library explains: an unknown function of creepage."
    told = []
    for one in named:
        others = [name.replace("_", " ") for name in one.alternatives[1:]]
        doubt = f" (or {', '.join(others)}: these points cannot tell)" if others else ""
        told.append(f"{'probably ' if others else ''}{said(one.name, one.parameters)}{doubt}")
    return f"What the law lacks: {'; and '.join(told)}."


def next_test(verdict: str, named: Sequence[NamedOnCurve], open_parameters: Sequence[Inseparable], model: CreepModel) -> str:
    """Return the measurement that would tell most next."""
    if verdict == "adequate":
        return "none is needed for what these points can show; points at other creepages and speeds would show more"
    if verdict == "insufficient":
        return "more points, from rolling freely to beyond the largest adhesion"
    if verdict == "unknown":
        return "the same curve again at another speed, with the state of the rail noted before and after"
    tests = []
    if any(len(one.alternatives) > 1 for one in named):
        tests.append("the same curve at another speed: a fall by slip follows the slip speed, one by heat the slip power")
    if any(parameter.startswith("falling_friction") for one in open_parameters for parameter in one.parameters):
        tests.append(f"points beyond {model.creepage.max():.0%} creepage, until the friction no longer falls")
    if any(one.name == "initial_slope" for one in named):
        tests.append(
            f"points below {model.creepage.min():.2%} creepage, down to rolling freely: only they show the slope itself"
        )
    return "; ".join(tests) or "the same curve at another speed and wheel load"


def notes(search: CreepSearch, fit: CurveFit, closure: Closure | None, seen: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what else there is to say."""
    found = []
    if blind := [name for name in search.candidates if name not in fit.names and name not in seen]:
        found.append(f"beside the model these points would not show, at any size within its bounds: {', '.join(blind)}")
    if closure and fit.names:
        found.append(
            f"a smooth function of creepage would gain {closure.gain:.0f} more (held out: {closure.held_out_gain:.0f}): "
            "the mechanisms' form is not exact"
        )
    if len(np.unique(search.model.speed)) == 1:
        found.append("all points have one speed, so that speed-dependent friction, part of the friction level, is not searched")
    if note := radius_note(search, fit):
        found.append(note)
    return (*found, NOT_SEARCHED)
