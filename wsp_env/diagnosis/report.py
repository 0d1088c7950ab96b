"""The diagnosis as a self-contained page; all numbers come from the JSON.

The first screen is a summary: sentence, worth, confidence, place, removed share, and one run before and after. All details are
in folded sections.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsp_env.diagnosis.answer import Curve, Diagnosis, Estimate
from wsp_env.diagnosis.report_evidence import evidence
from wsp_env.diagnosis.report_facts import LEAST_SHARE, axles_said, doubt, facts, lead, removed_said
from wsp_env.diagnosis.report_runs import course_plot, figures, heat_maps, still_high
from wsp_env.diagnosis.words import BALANCES, capital, mechanism_words, parameter_words, unit_words
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import COLOURS, Facts, Origin, PageOptions, Section, Table, axes, plotly, write_page


def write_report(path: Path, found: Diagnosis, options: PageOptions = PageOptions()) -> None:
    """Write the page of a diagnosis."""
    parts = [
        _channels(found),
        _where(found),
        *_fitted(found),
        *_discovered(found),
        _law(found),
        _before_after(found),
        evidence(found),
        _remains(found),
    ]
    folds = [part for part in parts if part is not None]
    write_page(path, f"Diagnosis of {found.campaign}", lead(found), [_first(found), *folds], _origin(found), options)


def _first(found: Diagnosis) -> Section:
    """Return the first section, which follows the sentence."""
    shows: list[Any] = [facts(found)]
    if found.course and found.verdict != "data":
        shows.append(course_plot(found.course, found.course.shows, _extended(found)))
    if found.verdict == "data":
        shows.append(_suspicions(found))
    return Section("", (), shows)


def _extended(found: Diagnosis) -> bool:
    """Whether the diagnosis has an extended model, shown as "after"."""
    return bool(found.mechanisms or found.discovered)


def _origin(found: Diagnosis) -> Origin:
    vehicle, believed = found.model.get("vehicle", {}), ""
    if vehicle:
        wheels = f"wheel radius {vehicle['wheel_radius_m']:g} m, wheelset inertia {vehicle['wheelset_inertia_kgm2']:g} kg m2"
        source = f"brake torque {vehicle['brake_torque_source']}"
        believed = f"{vehicle['axles']} axles, {vehicle['mass_kg']:.6g} kg, {wheels}; {source}"
    files = [(one.file, one.sha256) for one in found.sources]
    return Origin("wsp diagnose", believed, files, found.made, found.version)


def _channels(found: Diagnosis) -> Section | None:
    if found.verdict == "data" or not found.suspect_channels:
        return None
    return Section("Suspect channels", (), [_suspicions(found)], fold=True)


def _suspicions(found: Diagnosis) -> Facts:
    return Facts([(one.channel, f"{one.suspicion}. Remedy: {one.remedy}") for one in found.suspect_channels])


def _where(found: Diagnosis) -> Section | None:
    cells, places = found.residuals.get("cells", ()), found.residuals.get("places", ())
    if not cells:
        return None
    count = len({cell["axle"] for cell in cells if cell["axle"]})
    rows = [
        (BALANCES.get(one.equation, one.equation), axles_said(one.axles, count), ", ".join(one.runs), one.where,
         f"{100.0 * one.share:.0f} %")
        for one in found.location if one.share >= LEAST_SHARE
    ]  # fmt: skip
    text = [
        "Colours: mean squares of the residuals relative to what noise and normal variation leave, as in the table of all "
        "runs. A sound vehicle leaves about 1; white is 1 or less. Every step of the scale is a factor."
    ]
    if not found.location:
        text.insert(0, "No balance is off by more than normal variation explains.")
    shows: list[Any] = [Table(("Balance", "Axles", "Runs", "Range", "Share"), rows)] if rows else []
    sides = {"before": "before", "after": "after"} if _extended(found) else {"before": "as tuned"}
    shows.append(heat_maps(cells, "run", sides, "run"))
    if _extended(found):
        text.append(still_high(found))
    if places:
        shows.append(heat_maps(places, "place_m", sides, "place of the axle [m]"))
    else:
        text.append("There is no map over the track: nobody knows where the runs began (campaign.toml: start_position_m).")
    return Section("Where: residuals by run, axle and place", text, shows, fold=True)


def _fitted(found: Diagnosis) -> list[Section]:
    sections = []
    for one in found.mechanisms:
        rows = _parameters(one.parameters)
        others = ", ".join(name.replace("_", " ") for name in one.alternatives[1:])
        text = [
            f"{capital(mechanism_words(one.name, one.parameters))}. How it shows: {ALL[one.name].signature.trace}.",
            f"Confidence {one.confidence:.2f}{doubt(one)}; {one.multiple:.1f} times the smallest effect of interest; reduces "
            f"chi-square by {one.gain:.0f}, where noise alone gives {one.null_gain:.0f}; in the runs held out, at the size "
            f"fitted to the others, by {one.held_out_gain:.0f}.",
            f"These data cannot tell it from: {others}." if others else "No other mechanism of the library comes near.",
        ]
        shows: list[Any] = [Table(("Parameter", "Value", "Unit", "90 % interval"), rows)]
        shows += [_curve(one.name, one.curve)] if one.curve else []
        sections.append(Section(f"The fitted mechanism: {one.name.replace('_', ' ')}", text, shows, fold=True))
    return sections


def _law(found: Diagnosis) -> Section | None:
    friction = found.model.get("mu_cd")
    if found.verdict == "data" or not friction:
        return None
    worth = found.worth.stops_m if found.worth is not None else {}
    rows = [(run, f"{mu:.4f}", f"{worth[run]:+.2g}" if run in worth else "") for run, mu in friction.items()]
    header = ("Run", "mu_cd [-]", "Findings change the stop by [m]")
    text = [f"tau = {found.model['tau_m_per_J']:.4g} m/J, with the findings in the model, as in model.json."]
    if note := found.model.get("note_mu_cd"):
        text.append(f"mu_cd is {note}.")
    table = Table(header if worth else header[:2], rows if worth else [row[:2] for row in rows])
    return Section("The tuned law", text, [table], fold=True)


def _parameters(parameters: Mapping[str, Estimate]) -> list[tuple[str, str, str, str]]:
    """Return a row for each parameter; the interval of a parameter that was not fitted is "not fitted"."""
    rows = []
    for name, one in parameters.items():
        low, high = one.interval90
        words, unit = parameter_words(name), "" if name in ("axle", "last_axle") else unit_words(one.unit)
        value = "all" if name == "axle" and not one.value else f"{one.value:.4g}"
        rows.append((words, value, unit, f"{low:.4g} to {high:.4g}" if low != high else "not fitted"))
    return rows


def _discovered(found: Diagnosis) -> list[Section]:
    sections = []
    for one in found.discovered:
        text = [
            f"{capital(one.slot)}: {one.equation}." + (f" It depends on: {', '.join(one.features)}." if one.features else ""),
            f"{one.multiple:.1f} times the smallest effect of interest; reduces chi-square by {one.gain:.0f}; held out, by "
            f"{one.held_out_gain:.0f}{doubt(one)}. Removed: {removed_said(one.removed_validate)}.",
        ]
        if one.looks_like:
            text.append(f"It looks like: {', '.join(one.looks_like)}.")
        if one.alternatives:
            text.append(f"These recordings cannot tell it from: {', '.join(one.alternatives)}.")
        # What was chosen and not fitted (slot, axles, feature) is in the equation.
        fitted = {name: value for name, value in one.parameters.items() if value.interval90[0] != value.interval90[1]}
        table = Table(("Parameter", "Value", "Unit", "90 % interval"), _parameters(fitted))
        sections.append(Section(f"The term found: {one.equation}", text, [table], fold=True))
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
    return axes(figure, curve.over.removesuffix(" [-]"), curve.change)


def _before_after(found: Diagnosis) -> Section | None:
    fit, shows = found.fit, []
    sides = {"Baseline": fit.baseline, "Extended": fit.extended} if _extended(found) else {"As tuned": fit.baseline}
    if not _extended(found) and fit.extended != fit.baseline:
        sides["With what is too small to matter"] = fit.extended
    rows = [(group, *(f"{side[group]:.3f}" for side in sides.values()), f"{fit.noise_floor:.3f}") for group in fit.baseline]
    text = ["Parameters fitted to the runs to tune on alone, scored on the runs to validate too."]
    if rows:
        caption = "Mean squares relative to what noise and normal variation leave, which is 1."
        shows.append(Table(("Runs", *sides, "Noise floor"), rows, caption))
    if found.course:
        same = ", so it changes only if the finding acts on the vehicle, its brakes or its speed sensor"
        text.append(
            "The course of one run: its residuals still hold the normal variation of brakes and track. That of the speed is "
            f"computed with the measured torque, as the speed error E (eq. 19) is{same if _extended(found) else ''}."
        )
        other = "adhesion" if found.course.shows == "speed" else "speed"
        shows.append(course_plot(found.course, other, _extended(found)))
    if found.runs:
        shows += figures(found, _extended(found))
    return Section("Before and after, all runs" if _extended(found) else "All runs", text, shows, fold=True) if shows else None


def _remains(found: Diagnosis) -> Section | None:
    text: list[str] = []
    shows: list[Any] = []
    text += [f"{capital(note)}." for note in found.notes]
    units = {(name, one.name): one.unit for name, mechanism in ALL.items() for one in mechanism.parameters}
    rows = [
        (name.replace("_", " "), parameter_words(size), f"{value:.3g}", unit_words(units.get((name, size), "")))
        for name, sizes in found.detectable.items()
        for size, value in sizes.items()
    ]
    if unseen := [name.replace("_", " ") for name, sizes in found.detectable.items() if not sizes]:
        text.append(f"These recordings would not have shown at any possible size: {', '.join(unseen)}.")
    header = ("Mechanism", "Parameter", "Smallest change that would have been seen", "Unit")
    shows += [Table(header, rows)] if rows else []
    return Section("What remains, and what could have been seen", text, shows, fold=True) if text or shows else None
