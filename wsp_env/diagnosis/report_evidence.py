"""The evidence section of a diagnosis' page: each candidate alone."""

from collections.abc import Sequence
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis, Evidence
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import COLOURS, Section, Table, axes, plotly

_SHOWN = 14  # candidates in the picture of the evidence


def evidence(found: Diagnosis) -> Section | None:
    """Return the section on the evidence of each candidate alone; None if no candidate was tried."""
    if not found.evidence:
        return None
    shown = sorted(found.evidence, key=lambda one: -one.gain)[:_SHOWN]
    rows = [
        (_called(one), f"{one.gain:.0f}", f"{one.surprise:.1f}", f"{one.multiple:.2f}" if one.multiple else "not computed")
        for one in shown
    ]  # fmt: skip
    header = ("Candidate", "Reduction", "log10 of evidence", "Size / smallest of interest")
    text = [
        "What every candidate, alone, explains in the recordings about the tuned law, beside all else at sizes too small to "
        "matter.",
        "Reduction: by how much the sum of squared residuals falls, in units of the noise's variance, if the candidate may be "
        "as large as the recordings say. Evidence: how much likelier the recordings are with it than with it too small to "
        "matter, less what its variants cost. If one mechanism in fifty is missing, one with 2.98 or more is sure to 95 %. A "
        "candidate that is not in the library is a term without a name. It is nine times less likely beforehand, and sure from "
        "3.93 on. Sizes are those of the linear search; the first page gives the fitted ones.",
    ]
    shows: list[Any] = [_picture(shown), Table(header, rows)]
    return Section("Evidence: every candidate alone", text, shows, fold=True)


def _called(one: Evidence) -> str:
    return one.name.replace("_", " ") if one.name in ALL else f"{one.name} (term)"


def _picture(shown: Sequence[Evidence]) -> Any:
    objects, _ = plotly()
    names = [_called(one) for one in shown]
    figure = objects.Figure()
    figure.add_bar(x=[max(one.gain, 0.1) for one in shown], y=names, orientation="h", marker_color=COLOURS[0])
    figure.update_layout(title="Reduction of chi-square by each candidate, alone", height=140 + 26 * len(shown))
    figure.update_xaxes(type="log")
    figure.update_yaxes(autorange="reversed")
    axes(figure, "reduction of chi-square [-]", "")
    figure.update_layout(margin={"l": 290})
    return figure
