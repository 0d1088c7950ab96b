"""The diagnosis as a self-contained page; every number in it comes from the JSON."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wsp_env.diagnosis.answer import Closure, Curve, Diagnosis, Evidence
from wsp_env.diagnosis.report_runs import course_plot, figures, heat_maps, still_high
from wsp_env.diagnosis.words import said
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import COLOURS, Section, Table, axes, plotly, write_page

_SHOWN = 14  # candidates in the picture of the evidence


def write_report(path: Path, found: Diagnosis) -> None:
    """Write the page of a diagnosis."""
    if found.verdict == "data":
        text = [f"{one.channel}: {one.suspicion}. Remedy: {one.remedy}." for one in found.suspect_channels]
        sections = [Section("Suspect channels", text, []), _remains(found)]
        write_page(path, f"Diagnosis of {found.campaign}: data", found.sentence, sections, "Written by: wsp diagnose")
        return
    sections = [_where(found), _what(found), *_fitted(found), _before_after(found), _remains(found)]
    write_page(path, f"Diagnosis of {found.campaign}: {found.verdict}", found.sentence, sections, "Written by: wsp diagnose")


def _where(found: Diagnosis) -> Section:
    rows = [
        (one.equation, ", ".join(map(str, one.axles)) or "-", ", ".join(one.runs), one.where, f"{one.share:.0%}")
        for one in found.location
    ]
    shows: list[Any] = [Table(("Balance", "Axles", "Runs", "Range", "Share"), rows)] if rows else []
    text = [
        "Colours: mean squares of the baseline's residuals, normal variation fitted away, over the squared deviation that the "
        "channels' noise gives them. A sound vehicle leaves 1 or less, as the fit takes some of the noise along. The first "
        "table of Before and after has another scale: there such squares are divided by those of null recordings, so that 1 "
        "is exactly what noise and normal variation leave."
    ]
    if not rows:
        text.insert(0, "No balance is off by more than normal variation explains.")
    maps = [
        heat_maps(found.residuals["cells"], "run", {"before": "Residuals of the baseline, by run"}, "run"),
        heat_maps(
            found.residuals["places"], "place_m", {"before": "The same along the track, all runs"}, "place of the axle [m]"
        ),
    ]
    return Section("Where", text, [*shows, *maps])


def _what(found: Diagnosis) -> Section:
    shown = sorted(found.evidence, key=lambda one: -one.gain)[:_SHOWN]
    rows = [
        (_called(one), f"{one.gain:.0f}", f"{min(one.null):.0f} to {max(one.null):.0f}", f"{min(one.surprise, 300):.1f}",
         f"{one.held_out:.0f}", f"{one.multiple:.2f}" if one.multiple else "-")
        for one in shown
    ]  # fmt: skip
    header = ("Candidate", "Reduction", "Null band", "-log10 p", "Held out", "Size / smallest of interest")
    text = [
        "By how much every candidate, alone, reduces chi-square in the recordings, and in null recordings: what the fitted "
        "baseline would have recorded with noise and normal variation alone.",
        "Reduction of chi-square: by how much the sum of squared residuals, in deviations of noise, falls when the candidate "
        f"is added. Null band: the least to the largest in {len(shown[0].null) if shown else 0} null recordings. "
        "p: the probability of such a reduction in a null recording; -log10 p = 4 is 1 in 10 000. "
        "Held out: the reduction in the runs to validate, with amplitudes fitted to the runs to tune on. "
        "A closure is a free function: it shows what is there, not what it is.",
    ]
    pairs = Table(
        ("Two together", "Reduction", "In null recordings"),
        [(" and ".join(pair.names).replace("_", " "), f"{pair.gain:.0f}", f"{pair.null_gain:.0f}") for pair in found.pairs],
        "The pairs of mechanisms that reduce chi-square most.",
    )
    return Section("What", text, [_evidence(shown), Table(header, rows), pairs, _confounding(found)])


def _called(one: Evidence) -> str:
    return one.name.replace("_", " ") if one.name in ALL else f"{one.name} (closure)"


def _evidence(shown: Sequence[Evidence]) -> Any:
    objects, _ = plotly()
    names = [_called(one) for one in shown]
    figure = objects.Figure()
    figure.add_bar(x=[max(one.gain, 0.1) for one in shown], y=names, orientation="h", name="data", marker_color=COLOURS[0])
    bands = [(max(min(one.null), 0.1), max(max(one.null), 0.1), None) for one in shown]
    figure.add_scatter(
        x=[x for band in bands for x in band], y=[y for name in names for y in (name, name, None)], mode="lines",
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


def _fitted(found: Diagnosis) -> list[Section]:
    sections = []
    for one in found.mechanisms:
        rows = [
            (name, f"{value.value:.4g}", value.unit, f"{value.interval90[0]:.4g} to {value.interval90[1]:.4g}")
            for name, value in one.parameters.items()
        ]
        others = ", ".join(name.replace("_", " ") for name in one.alternatives[1:])
        text = [
            f"{_capital(said(one.name, one.parameters))}. What it leaves: {ALL[one.name].signature.trace}.",
            f"Confidence {one.confidence:.2f}; {one.multiple:.1f} times the smallest effect of interest; reduces chi-square "
            f"by {one.gain:.0f}, against at most {one.null_gain:.0f} in null recordings; held out, by {one.held_out_gain:.0f}.",
            f"These data cannot tell it from: {others}." if others else "No other mechanism of the library comes near.",
        ]
        table = Table(("Parameter", "Value", "Unit", "90 % interval"), rows)
        shows = [table, _curve(one.name, one.curve)] if one.curve else [table]
        sections.append(Section(f"The fitted mechanism: {one.name.replace('_', ' ')}", text, shows))
    return sections


def _curve(name: str, curve: Curve) -> Any:
    objects, _ = plotly()
    figure = objects.Figure()
    figure.add_scatter(
        x=[*curve.x, *curve.x[::-1]], y=[*curve.high, *curve.low[::-1]], fill="toself", mode="none", name="90 % interval",
        fillcolor="rgba(0,114,178,0.2)",
    )  # fmt: skip
    figure.add_scatter(x=curve.x, y=curve.fitted, mode="lines+markers", name="mechanism", marker_color=COLOURS[0])
    figure.add_scatter(
        x=curve.x, y=curve.observed, mode="markers", name="recorded, with standard error", marker_color=COLOURS[1],
        error_y={"array": curve.deviation},
    )  # fmt: skip
    figure.update_layout(title=f"What it changes in the {curve.equation} balance", height=420)
    if ALL[name].signature.over == "axle":
        figure.update_xaxes(dtick=1)
    return axes(figure, curve.over, curve.change)


def _before_after(found: Diagnosis) -> Section:
    fit = found.fit
    rows = [
        (group, f"{fit.baseline[group]:.3f}", f"{fit.extended[group]:.3f}", f"{fit.noise_floor:.3f}") for group in fit.baseline
    ]
    table = Table(("Runs", "Baseline", "Extended", "Noise floor"), rows, "Mean squares relative to null recordings.")
    removed = "" if fit.removed_validate is None else f" {fit.removed_validate:.0%} of the removable held-out residual is gone."
    text = [f"Parameters fitted to the runs to tune on alone, scored on the runs to validate too.{removed}"]
    shows: list[Any] = [table]
    if found.course:
        text.append(
            "The course of one run: the speed's residual still holds the normal variation of brakes and track. It is computed "
            "with the measured torque, as E (eq. 19) is: by construction both are the same before and after, unless what was "
            "found acts on the vehicle, its brakes or its speed sensor."
        )
        shows.append(course_plot(found.course, bool(found.mechanisms)))
    text.append(still_high(found))
    if found.mechanisms:
        sides = {"before": "Residuals before", "after": "and after, by run"}
        shows.append(heat_maps(found.residuals["cells"], "run", sides, "run"))
    return Section("Before and after", text, [*shows, *figures(found)])


def _remains(found: Diagnosis) -> Section:
    text, shows = [], []
    if found.closure:
        text.append(
            f"Still structured: {found.closure.depends_on}, reduction of chi-square {found.closure.gain:.0f} "
            f"(held out: {found.closure.held_out_gain:.0f})."
        )
        if found.closure.shape:
            shows.append(_shape(found.closure))
    text += [f"Next test: {found.next_test}.", *(f"{_capital(note)}." for note in found.notes)]
    units = {(name, one.name): one.unit for name, mechanism in ALL.items() for one in mechanism.parameters}
    rows = [
        (name.replace("_", " "), size, f"{value:.3g}", units[name, size])
        for name, sizes in found.detectable.items()
        for size, value in sizes.items()
    ]
    table = Table(("Mechanism", "Parameter", "Smallest change that would have been seen", "Unit"), rows)
    return Section("What remains", text, [*shows, table])


def _shape(closure: Closure) -> Any:
    """Draw a closure's values at its nodes; where nodes come again, another axle's, run's or part's curve goes on."""
    objects, _ = plotly()
    figure, seen = objects.Figure(), Counter[float]()
    curves: dict[int, list[tuple[float, float, float]]] = {}
    for point in closure.shape:
        seen[point[0]] += 1
        curves.setdefault(seen[point[0]], []).append(point)
    for i, points in curves.items():
        x, values, deviations = zip(*points, strict=True)
        figure.add_scatter(
            x=x, y=values, mode="lines+markers", name=str(i), marker_color=COLOURS[(i - 1) % len(COLOURS)],
            error_y={"array": deviations}, showlegend=len(curves) > 1,
        )  # fmt: skip
    title = f"What remains: {closure.depends_on}, with its standard deviation"
    figure.update_layout(title=title, height=420, legend_title="run" if closure.kind.over == "time" else "part")
    if closure.kind.over in ("axle", "frequency"):
        figure.update_xaxes(dtick=1)
    return axes(figure, closure.over, closure.unit)


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"
