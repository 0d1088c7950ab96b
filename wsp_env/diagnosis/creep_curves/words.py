"""The words of a diagnosis of creep curves: verdict, next test and notes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import Verdict
from wsp_env.diagnosis.creep_curves.answer import Closure, Inseparable, NamedOnCurve
from wsp_env.diagnosis.creep_curves.model import CreepModel, CurveFit, creep_mechanisms
from wsp_env.diagnosis.creep_curves.search import CreepSearch
from wsp_env.diagnosis.creep_curves.separation import mechanism_of, radius_note
from wsp_env.diagnosis.words import mechanism_words
from wsp_env.plant.mechanisms import LIBRARY


def sentence(verdict: Verdict, named: Sequence[NamedOnCurve]) -> str:
    """Return the verdict in one sentence."""
    if verdict == "adequate":
        return "The law is adequate: Kalker's slope and the believed friction explain these points as far as they can show."
    if verdict == "insufficient":
        return "The points are insufficient: they scatter too much, or cover too little, to show any mechanism of the library."
    if verdict == "unknown":
        return "The curve has another shape than any mechanism of the library explains: an unknown function of creepage."
    parts = []
    for one in named:
        others = [name.replace("_", " ") for name in one.alternatives[1:]]
        doubt = f" (or {', '.join(others)}: these points cannot tell)" if others else ""
        parts.append(f"{'probably ' if others else ''}{mechanism_words(one.name, one.parameters)}{doubt}")
    return f"What the law lacks: {'; and '.join(parts)}."


def next_test(
    verdict: Verdict, named: Sequence[NamedOnCurve], open_parameters: Sequence[Inseparable], model: CreepModel
) -> str:
    """Return the measurement that would give most information next."""
    if verdict == "adequate":
        return "none is needed for what these points can show; points at other creepages and speeds would show more"
    if verdict == "insufficient":
        return "more points, from rolling freely to beyond the largest adhesion"
    if verdict == "unknown":
        return "the same curve again at another speed, with the state of the rail noted before and after"
    tests = []
    if any(len(one.alternatives) > 1 for one in named):
        tests.append("the same curve at another speed: a fall by slip follows the slip speed, one by heat the slip power")
    span = {"lowest": model.creepage.min(), "highest": model.creepage.max()}
    shows = creep_mechanisms()
    left_open = {mechanism_of(parameter) for one in open_parameters for parameter in one.parameters}
    tests += [one.test_if_open.format(**span) for name, one in shows.items() if name in left_open]
    tests += [shows[one.name].test_if_named.format(**span) for one in named]
    tests = [test for test in tests if test]
    return "; ".join(tests) or "the same curve at another speed and wheel load"


def notes(search: CreepSearch, fit: CurveFit, closure: Closure | None, seen: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the remaining notes of the answer."""
    found = []
    if blind := [name for name in search.candidates if name not in fit.names and name not in seen]:
        found.append(f"beside the model these points would not show, at any size within its bounds: {', '.join(blind)}")
    if closure and fit.names:
        found.append(
            f"a smooth function of creepage would reduce chi-square by {closure.gain:.0f} more "
            f"(held out: {closure.held_out_gain:.0f}): the mechanisms' form is not exact"
        )
    speeds = len(np.unique(search.model.speed))
    if few := [_called(name) for name, shows in creep_mechanisms().items() if shows.least_speeds > speeds]:
        found.append(
            f"not searched, as it is part of the friction level at {speeds} speed{'s' * (speeds > 1)}: {', '.join(few)}"
        )
    if note := radius_note(search, fit):
        found.append(note)
    blind = [_called(name) for name, card in LIBRARY.items() if card.signature.creep_curve is None]
    found.append(f"not searched, as a steady curve of one wheel on the rail as it is cannot show them: {', '.join(blind)}")
    return tuple(found)


def _called(name: str) -> str:
    return name.replace("_", " ")
