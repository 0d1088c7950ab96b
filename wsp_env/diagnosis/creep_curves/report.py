"""The diagnosis of creep curves as a self-contained page; all numbers come from the JSON."""

from pathlib import Path
from typing import Any

from wsp_env.diagnosis.creep_curves.answer import CreepDiagnosis, ShownCurve
from wsp_env.diagnosis.report_facts import LEAST_SHARE, MEANINGS
from wsp_env.diagnosis.words import mechanism_words, parameter_words, unit_words
from wsp_env.report import COLOURS, Facts, Origin, PageOptions, Section, Table, axes, plotly, write_page

_TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)  # [%]


def write_creep_report(
    path: Path,
    found: CreepDiagnosis,
    made_from: Origin = Origin("wsp diagnose"),
    options: PageOptions = PageOptions(),
) -> None:
    """Write the page of a diagnosis of creep curves."""
    sections = [_first(found), _where(found), _what(found), _fitted(found), _held_out(found), _open(found), _remains(found)]
    write_page(path, f"Diagnosis of {found.campaign}", found.sentence, sections, made_from, options)


def _first(found: CreepDiagnosis) -> Section:
    """Return the first section, which follows the sentence."""
    rows = [("Verdict", f"{found.verdict}: {MEANINGS[found.verdict]}")]
    sure = [f"{one.name.replace('_', ' ')}: {one.confidence:.2f} of 1" for one in found.mechanisms]
    rows += [("Confidence", "; ".join(sure))] if sure else []
    places = [f"{one.where} ({one.share:.0%} of it)" for one in found.location if one.share >= LEAST_SHARE]
    rows += [("Where", "; ".join(places))] if places else []
    if found.mechanisms:
        removed = found.fit.removed_validate
        rows += [("Removed", f"{min(max(removed, 0.0), 1.0):.0%} of the removable error of held-out points")] if removed else []
    rows.append(("Next test", f"{found.next_test[:1].upper()}{found.next_test[1:]}"))
    return Section("", (), [Facts(rows), *(_curve(one, bool(found.mechanisms)) for one in found.curves[:1])])


def _where(found: CreepDiagnosis) -> Section:
    text = ["The baseline has Kalker's slope and the believed friction, its level fitted. The band is the fit's 90 % interval."]
    if not found.location:
        text.append("Nowhere do the points lie off the baseline by more than their scatter explains.")
    rows = [(one.where, ", ".join(one.runs), f"{one.share:.0%}") for one in found.location if one.share >= LEAST_SHARE]
    caption = "Share: of what that law misses beyond the scatter."
    table = [Table(("Where the law misses the points", "Curve", "Share"), rows, caption)] if rows else []
    return Section("Where", text, [*(_curve(one, bool(found.mechanisms)) for one in found.curves[1:]), *table], fold=True)


def _curve(one: ShownCurve, extended: bool) -> Any:
    objects, _ = plotly()
    percent = [100.0 * e for e in one.grid]
    figure = objects.Figure()
    if extended:
        figure.add_scatter(x=percent, y=one.low, mode="lines", line={"width": 0}, showlegend=False, hoverinfo="skip")
        figure.add_scatter(
            x=percent, y=one.high, mode="lines", line={"width": 0}, fill="tonexty", fillcolor="rgba(0, 158, 115, 0.25)",
            name="90 % interval", hoverinfo="skip",
        )  # fmt: skip
    points = {"color": COLOURS[6], "size": 5, "opacity": 0.55}
    figure.add_scatter(x=[100.0 * e for e in one.creepage], y=one.adhesion, mode="markers", name="measured", marker=points)
    figure.add_scatter(x=percent, y=one.baseline, mode="lines", name="baseline", line={"color": COLOURS[1], "dash": "dash"})
    if extended:
        figure.add_scatter(x=percent, y=one.fitted, mode="lines", name="with the mechanisms found", line={"color": COLOURS[2]})
    figure.update_layout(title={"text": f"{one.name}, {one.speed_mps:g} m/s", "x": 0.06, "font": {"size": 14}}, height=460)
    figure.update_xaxes(type="log", tickvals=_TICKS)
    return axes(
        figure, "creepage [%]", "adhesion coefficient [-]", legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0}
    )


def _what(found: CreepDiagnosis) -> Section:
    rows = [
        (one.name.replace("_", " "), f"{one.gain:.0f}", f"{max(one.null):.0f}", f"{one.held_out:.0f}",
         f"{one.multiple:.1f}" if one.multiple else "not computed")
        for one in found.evidence
    ]  # fmt: skip
    header = ("Candidate, alone", "Reduction", "Largest in null recordings", "Held out", "Size / smallest of interest")
    caption = (
        "Reduction of chi-square: fall of the sum of squares over the scatter's variance. A function of creepage is no "
        "mechanism: it shows how "
        "much there is to explain."
    )
    text = [
        "By how much every candidate reduces chi-square beside the baseline, in the measured points and in null recordings: "
        "the fitted baseline with the points' own scatter, its sign drawn anew by blocks of neighbours."
    ]
    names = list(found.confounding)
    cosines = [(a.replace("_", " "), *(f"{found.confounding[a][b]:.2f}" for b in names)) for a in names]
    confusion = Table(("Cosine between", *(name.replace("_", " ") for name in names)), cosines, "1: the points cannot tell.")
    return Section("What", text, [Table(header, rows, caption), confusion], fold=True)


def _fitted(found: CreepDiagnosis) -> Section:
    text = []
    for one in found.mechanisms:
        others = ", ".join(name.replace("_", " ") for name in one.alternatives[1:])
        apart = f" These points cannot tell it from {others}." if others else ""
        text.append(
            f"{one.name.replace('_', ' ').capitalize()}: {mechanism_words(one.name, one.parameters)}. "
            f"Confidence {one.confidence:.2f}; "
            f"{one.multiple:.1f} times the smallest effect of interest; reduces chi-square by {one.gain:.0f} beside the "
            f"others, against at most {one.null_gain:.0f} in null recordings; held out {one.held_out_gain:.0f}.{apart}"
        )
    estimates = {
        f"{one.name.replace('_', ' ')}: {parameter_words(name)}": value
        for one in found.mechanisms
        for name, value in one.parameters.items()
    } | {parameter_words(name): value for name, value in found.law.items()}
    rows = [
        (name, f"{one.value:.4g}", unit_words(one.unit), f"{one.interval90[0]:.4g} to {one.interval90[1]:.4g}")
        for name, one in estimates.items()
    ]
    table = Table(
        ("Parameter", "Value", "Unit", "90 % interval"), rows, "Below the mechanisms' parameters: what the law then is."
    )
    return Section("The fitted law", text or ["No mechanism is added: the friction level alone is fitted."], [table], fold=True)


def _held_out(found: CreepDiagnosis) -> Section:
    objects, _ = plotly()
    score, fit = found.cross_validation, found.fit
    removed = "" if fit.removed_validate is None else f" {fit.removed_validate:.0%} of the removable held-out residual is gone."
    text = [f"{score.blocks} blocks of neighbouring creepages, each predicted by the law fitted to the others.{removed}"]
    rows = [
        (name, f"{score.fitted[name]:.4f}", f"{score.held_out[name]:.4f}", f"{score.scatter:.4f}")
        for name in ("baseline", "extended")
    ]
    caption = "Root mean square errors of the adhesion coefficient [-]; no law can go below the scatter."
    table = Table(("Law", "Fitted to all points", "Held out", "Scatter"), rows, caption)
    figure = objects.Figure()
    centres = [50.0 * (low + high) for low, high in score.creepage]
    for name, colour in (("baseline", COLOURS[1]), ("extended", COLOURS[2])):
        figure.add_scatter(x=centres, y=score.held_out_by_block[name], mode="lines+markers", name=name, line={"color": colour})
    figure.add_hline(y=score.scatter, line_dash="dot", annotation_text="scatter of the points", annotation_position="top left")
    figure.update_layout(title="Held-out error of every block", height=360)
    figure.update_xaxes(type="log", tickvals=_TICKS)
    figure.update_yaxes(rangemode="tozero")
    return Section("Before and after", text, [table, axes(figure, "creepage [%]", "root mean square error [-]")], fold=True)


def _open(found: CreepDiagnosis) -> Section:
    text = [f"{one.words}." for one in found.inseparable]
    if not text:
        text = ["No parameter makes up for another over these points."]
    names = list(found.correlations)
    rows = [(a.replace("_", " "), *(f"{found.correlations[a][b]:+.2f}" for b in names)) for a in names]
    table = Table(("Rank correlation of", *(name.replace("_", " ") for name in names)), rows, "Estimates over null recordings.")
    return Section("What these points cannot separate", text, [table] if len(names) > 1 else [], fold=True)


def _remains(found: CreepDiagnosis) -> Section:
    text = [f"Next test: {found.next_test}.", *(f"{note[0].upper()}{note[1:]}." for note in found.notes)]
    rows = [
        (name.replace("_", " "), parameter_words(size), f"{value:.3g}")
        for name, sizes in found.detectable.items()
        for size, value in sizes.items()
    ]
    table = Table(("Mechanism", "Parameter", "Smallest change that would have been seen"), rows)
    return Section("What remains", text, [table] if rows else [], fold=True)
