"""The evidence of a diagnosis, for its page: every candidate alone, pairs, and what cannot be told apart."""

from collections.abc import Sequence
from typing import Any

from wsp_env.diagnosis.answer import Diagnosis, Evidence
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import COLOURS, Section, Table, axes, plotly

_SHOWN = 14  # candidates in the picture of the evidence


def evidence(found: Diagnosis) -> Section | None:
    """Return what every candidate explains alone; None where none was tried."""
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
        "Reduction: by how much the sum of squared residuals, in deviations of noise, falls when the candidate may be as "
        "large as the recordings say. Evidence: how much likelier the recordings are with it than with it too small to "
        "matter, less what its variants cost; 3.7 is 99 % at a prior of one in fifty. A candidate that is not in the library "
        "is a term without a name.",
    ]
    shows: list[Any] = [_picture(shown), Table(header, rows)]
    pairs = Table(
        ("Two together", "Reduction", "In null recordings"),
        [(" and ".join(pair.names).replace("_", " "), f"{pair.gain:.0f}", f"{pair.null_gain:.0f}") for pair in found.pairs],
        "The pairs of mechanisms that reduce chi-square most.",
    )
    shows += [pairs] if found.pairs else []
    shows += [_confounding(found)] if found.confounding else []
    return Section("Evidence: every candidate alone", text, shows, fold=True)


def _called(one: Evidence) -> str:
    return one.name.replace("_", " ") if one.name in ALL else f"{one.name} (term)"


def _picture(shown: Sequence[Evidence]) -> Any:
    objects, _ = plotly()
    names = [_called(one) for one in shown]
    figure = objects.Figure()
    figure.add_bar(x=[max(one.gain, 0.1) for one in shown], y=names, orientation="h", name="data", marker_color=COLOURS[0])
    bands = [(max(min(one.null), 0.1), max(max(one.null), 0.1), None) for one in shown if one.null]
    banded = [name for name, one in zip(names, shown, strict=True) if one.null]
    figure.add_scatter(
        x=[x for band in bands for x in band], y=[y for name in banded for y in (name, name, None)], mode="lines",
        name="null band", line={"color": COLOURS[1], "width": 6},
    )  # fmt: skip
    figure.update_layout(title="Reduction of chi-square by each candidate, alone", height=140 + 26 * len(shown))
    figure.update_xaxes(type="log")
    figure.update_yaxes(autorange="reversed")
    axes(figure, "reduction of chi-square [-]", "", legend={"orientation": "h", "y": 1.08, "x": 0.5})
    figure.update_layout(margin={"l": 290})
    return figure


def _confounding(found: Diagnosis) -> Any:
    objects, _ = plotly()
    names = list(found.confounding)
    z = [[found.confounding[a][b] for b in names] for a in names]
    labels = [name.replace("_", " ") for name in names]
    figure = objects.Figure(objects.Heatmap(z=z, x=labels, y=labels, colorscale="Blues", zmin=0.0, zmax=1.0))
    figure.update_layout(title="Cosines between what mechanisms can do to these residuals", height=620)
    axes(figure, "", "")
    figure.update_layout(margin={"l": 190, "b": 170})
    return figure
