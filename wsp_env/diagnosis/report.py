"""The diagnosis as a self-contained page; every number in it comes from the JSON."""

from pathlib import Path
from typing import Any

from wsp_env.diagnosis.answer import Curve, Diagnosis
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import COLOURS, Section, Table, axes, plotly, write_page

_SHOWN = 14  # candidates in the picture of the evidence


def write_report(path: Path, found: Diagnosis) -> None:
    """Write the page of a diagnosis."""
    sections = [_where(found), _what(found), *_fitted(found), _before_after(found), _remains(found)]
    write_page(path, f"Diagnosis of {found.campaign}: {found.verdict}", found.sentence, sections, "Written by: wsp diagnose")


def _where(found: Diagnosis) -> Section:
    rows = [
        (one.equation, ", ".join(map(str, one.axles)) or "-", ", ".join(one.runs), one.where, f"{one.share:.0%}")
        for one in found.location
    ]
    shows: list[Any] = [Table(("Balance", "Axles", "Runs", "Range", "Share"), rows)] if rows else []
    text = ["Mean squares of the residuals in deviations of noise and normal variation: 1 is what a sound vehicle leaves."]
    if not rows:
        text.insert(0, "No balance is off by more than normal variation explains.")
    return Section("Where", text, [*shows, _map(found), _places(found)])


def _map(found: Diagnosis) -> Any:
    objects, _ = plotly()
    cells = found.residuals["cells"]
    runs = list(dict.fromkeys(cell["run"] for cell in cells))
    series = list(dict.fromkeys((cell["balance"], cell["axle"]) for cell in cells))
    values = {(cell["balance"], cell["axle"], cell["run"]): cell["before"] for cell in cells}
    z = [[values.get((*one, run)) for run in runs] for one in series]
    names = [f"{balance}, axle {axle}" if axle else balance for balance, axle in series]
    figure = objects.Figure(objects.Heatmap(z=z, x=runs, y=names, colorscale="YlOrRd", zmin=0.5, zmax=5.0))
    figure.update_layout(title="Residuals of the baseline, by balance and run", height=120 + 28 * len(series))
    return axes(figure, "run", "")


def _places(found: Diagnosis) -> Any:
    objects, _ = plotly()
    cells = found.residuals["places"]
    places = sorted({cell["place_m"] for cell in cells})
    series = list(dict.fromkeys((cell["balance"], cell["axle"]) for cell in cells))
    values = {(cell["balance"], cell["axle"], cell["place_m"]): cell["before"] for cell in cells}
    z = [[values.get((*one, place)) for place in places] for one in series]
    names = [f"{balance}, axle {axle}" if axle else balance for balance, axle in series]
    figure = objects.Figure(objects.Heatmap(z=z, x=places, y=names, colorscale="YlOrRd", zmin=0.5, zmax=5.0))
    figure.update_layout(title="The same along the track, all runs", height=120 + 28 * len(series))
    return axes(figure, "place of the axle [m]", "")


def _what(found: Diagnosis) -> Section:
    objects, _ = plotly()
    shown = sorted(found.evidence, key=lambda one: -one.gain / max(max(one.null), 1.0))[:_SHOWN][::-1]
    names = [one.name.replace("_", " ") for one in shown]
    figure = objects.Figure()
    figure.add_bar(x=[max(one.gain, 0.1) for one in shown], y=names, orientation="h", name="data", marker_color=COLOURS[0])
    figure.add_scatter(
        x=[max(max(one.null), 0.1) for one in shown], y=names, mode="markers", name="largest null recording",
        marker={"color": COLOURS[1], "symbol": "line-ns-open", "size": 14, "line": {"width": 3}},
    )  # fmt: skip
    figure.update_layout(title="Gain of each candidate, alone", height=120 + 26 * len(shown), margin={"l": 260})
    figure.update_xaxes(type="log")
    axes(figure, "fall of the sum of squares [-]", "", legend={"orientation": "h", "y": 1.08, "x": 0.5})
    figure.update_layout(margin={"l": 260})
    rows = [
        (one.name, f"{one.gain:.0f}", f"{max(one.null):.0f}", f"{min(one.surprise, 300):.1f}", f"{one.held_out:.0f}",
         f"{one.multiple:.2f}" if one.multiple else "-")
        for one in shown[::-1]
    ]  # fmt: skip
    header = ("Candidate", "Gain", "Largest null gain", "Surprise", "Held-out gain", "Size / smallest of interest")
    caption = "Surprise: -log10 of the probability of such a gain in a null recording. Names with spaces are closures."
    text = [
        "Every candidate's gain in the recordings, against its gain in null recordings: what the fitted baseline would have "
        "recorded with noise and normal variation alone."
    ]
    return Section("What", text, [figure, Table(header, rows, caption), _confounding(found)])


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
            f"{ALL[one.name].summary[0].upper()}{ALL[one.name].summary[1:]}. What it leaves: {ALL[one.name].trace}.",
            f"Confidence {one.confidence:.2f}; {one.multiple:.1f} times the smallest effect of interest; gain {one.gain:.0f} "
            f"against at most {one.null_gain:.0f} in null recordings; held-out gain {one.held_out_gain:.0f}.",
            f"These data cannot tell it from: {others}." if others else "No other mechanism of the library comes near.",
        ]
        table = Table(("Parameter", "Value", "Unit", "90 % interval"), rows)
        shows = [table, _curve(one.curve)] if one.curve else [table]
        sections.append(Section(f"The fitted mechanism: {one.name.replace('_', ' ')}", text, shows))
    return sections


def _curve(curve: Curve) -> Any:
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
    if found.mechanisms:
        shows.append(_after(found))
    return Section("Before and after", text, [*shows, *_runs(found)])


def _runs(found: Diagnosis) -> list[Table]:
    """Return the paper's figures by run and axle; before alone where nothing was found."""

    def sides(*values: float | None) -> str:
        shown = values if found.mechanisms else values[:-1]
        return " / ".join("-" if value is None else f"{value:.3g}" for value in shown)

    axles = [f"axle {k + 1}" for k in range(len(found.runs[0].adhesion_error_before))]
    errors = [
        (one.run, one.group,
         *(sides(*(None if e is None else 100.0 * e for e in pair))
           for pair in zip(one.adhesion_error_before, one.adhesion_error_after, strict=True)),
         sides(one.speed_error_before_mps, one.speed_error_after_mps))
        for one in found.runs
    ]  # fmt: skip
    slides = [
        (one.run, one.group, *(f"{mean} ({deviation})" for mean, deviation in zip(
            map(sides, one.slide_mean_recorded_mps, one.slide_mean_before_mps, one.slide_mean_after_mps),
            map(sides, one.slide_deviation_recorded_mps, one.slide_deviation_before_mps, one.slide_deviation_after_mps),
            strict=True)))
        for one in found.runs
    ]  # fmt: skip
    then = " / after" if found.mechanisms else ""
    return [
        Table(("Run", "Group", *axles, "E [m/s]"), errors,
              f"Error of the adhesion coefficient over its mean [%] while the axle slides (Table 4), and E of the speed by the "
              f"measured torque (eq. 19): before{then}."),
        Table(("Run", "Group", *axles), slides,
              f"Mean slide and, in brackets, its deviation [m/s] (eqs. 20 and 21): recorded / before{then}. Whole stops "
              "simulated with the recorded torque, which no controller corrects: compare the statistics, not instants."),
    ]  # fmt: skip


def _after(found: Diagnosis) -> Any:
    objects, _ = plotly()
    cells = found.residuals["cells"]
    names = [f"{cell['run']} {cell['balance']}" + (f" {cell['axle']}" if cell["axle"] else "") for cell in cells]
    figure = objects.Figure()
    for key, colour in (("before", COLOURS[1]), ("after", COLOURS[2])):
        figure.add_scatter(x=names, y=[cell[key] for cell in cells], mode="markers", name=key, marker_color=colour)
    figure.update_layout(title="Mean square of every residual series", height=420, xaxis={"showticklabels": False})
    return axes(figure, "run, balance and axle", "mean square [-]")


def _remains(found: Diagnosis) -> Section:
    text = []
    if found.closure:
        text.append(
            f"Still structured: {found.closure.depends_on}, gain {found.closure.gain:.0f} "
            f"(held out: {found.closure.held_out_gain:.0f})."
        )
    text += [f"Next test: {found.next_test}.", *found.notes]
    rows = [(name, size, f"{value:.3g}") for name, sizes in found.detectable.items() for size, value in sizes.items()]
    table = Table(("Mechanism", "Parameter", "Smallest change that would have been seen"), rows)
    return Section("What remains", text, [table])
