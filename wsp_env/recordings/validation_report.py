"""The page that `wsp validate` writes: the seed paper's figures 6 to 11 and tables 4 and 7 for one campaign."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wsp_env.recordings.derive import limits, transition
from wsp_env.recordings.simulate import WINDOW_S
from wsp_env.recordings.tuning import Tuning
from wsp_env.recordings.validation import CLOSED_LOOP_BY, RIVALS, ClosedLoop, Validation
from wsp_env.report import COLOURS, Figure, Section, Table, axes, plotly, write_page

_POINTS = 1500  # of a line or cloud: more cannot be told apart on a screen


def adhesion_table(tuning: Tuning) -> Table:
    """Table 4: e_j per axle and run."""
    axles = len(next(iter(tuning.runs.values())).error)
    header = ("run", "group", "mu_cd [-]", *(f"e_{k} [%]" for k in range(1, axles + 1)))
    rows = []
    for name, score in tuning.runs.items():
        mark = "" if score.mu_cd_tuned else " (believed)"
        errors = ("-" if error is None else f"{100 * error:.1f}" for error in score.error)
        rows.append((name, score.group, f"{score.mu_cd:.4f}{mark}", *errors))
    return Table(header, rows, "relative errors e_j of the adhesion coefficient, as the seed paper's Table 4; -: never slides")


def slide_table(validation: Validation) -> Table:
    """Table 7: E, mean slide and its deviation, recorded and simulated, of each run's first axle and worst axle."""
    rows = []
    for name, stop in validation.stops.items():
        s = stop.slide
        means = np.abs(np.subtract(s.recorded_mean_mps, s.simulated_mean_mps)).max()
        first = (s.recorded_mean_mps, s.simulated_mean_mps, s.recorded_deviation_mps, s.simulated_deviation_mps)
        rows.append((name, f"{s.speed_error_mps:.2f}", *(f"{values[0]:.2f}" for values in first), f"{means:.2f}"))
    header = (
        "run", "E [m/s]", "mean slide, recorded [m/s]", "simulated [m/s]", "deviation, recorded [m/s]", "simulated [m/s]",
        "means apart, worst axle [m/s]",
    )  # fmt: skip
    caption = "vehicle simulated with the recorded brake torque over the whole stop; first axle, as the seed paper's Table 7"
    return Table(header, rows, caption)


def window_table(validation: Validation) -> Table:
    """Return what the law is worth: errors over windows beside simpler laws."""
    header = ("run", *(f"{what} [m/s]" for what in RIVALS.values()))
    rows = [
        (name, *(f"{stop.window_rms_mps[rival]:.3f}" if stop.window_rms_mps else "-" for rival in RIVALS))
        for name, stop in validation.stops.items()
    ]
    caption = (
        f"RMS error of the simulated r w over windows of {WINDOW_S:g} s that start from the recorded speeds, all axles; no "
        "recovery: tau = 0 with the tuned law's mu_cd; refitted: with the mu_cd that fits best without recovery; no slip: "
        "wheels that roll however hard they are braked"
    )
    return Table(header, rows, caption)


def closed_loop_table(controller: str, stops: Mapping[str, ClosedLoop]) -> Table:
    """Return the slide under a controller beside the recorded one, axle by axle."""
    rows = [
        (name if axle == 0 else "", str(axle + 1), *(f"{value:.2f}" for value in values))
        for name, s in stops.items()
        for axle, values in enumerate(
            zip(s.recorded_mean_mps, s.simulated_mean_mps, s.recorded_deviation_mps, s.simulated_deviation_mps, strict=True)
        )
    ]
    header = (
        "run", "axle", "mean slide, recorded [m/s]", f"{controller} [m/s]", "deviation, recorded [m/s]", f"{controller} [m/s]",
    )  # fmt: skip
    caption = f"closed loop with {controller} under each run's conditions; compared by {CLOSED_LOOP_BY}"
    return Table(header, rows, caption)


def criteria_table(validation: Validation) -> Table:
    """Return the paper's figures beside this campaign's."""
    rows = [
        (c.name, f"{c.value:.3g} {c.unit}", f"{c.limit:.3g} {c.unit}", "yes" if c.met else "no") for c in validation.criteria
    ]
    return Table(("figure", "here, worst", "seed paper, worst", "met"), rows, f"over the runs that were {validation.scored}")


def write(path: Path, validation: Validation, closed_loop: Table | None = None) -> None:
    """Write the page, with the table of a closed loop where there is one; it needs the extra [report]."""
    campaign = validation.campaign
    lead = f"{validation.verdict} Tuned on {', '.join(campaign.tune)}: {validation.tuning.sentence}."
    sections = [
        Section(
            "The seed paper's own figures",
            (),
            (criteria_table(validation), adhesion_table(validation.tuning), _errors(validation)),
        ),
        Section(
            "Transition from degraded to recovered adhesion",
            ("Each point is one sample of one sliding wheel: lambda by eq. (3) over the energy spent; the curve is eq. (4).",),
            (_transition(validation),),
        ),
        Section(
            "Adhesion coefficient over time, first axle",
            ("Measured (eqs. 1 and 11), calculated from the measured slip (eq. 10), and the limits of both (eq. 5).",),
            tuple(_adhesion(validation, name) for name in validation.stops),
        ),
        Section(
            "The vehicle, simulated with the recorded brake torque",
            (
                "Nothing corrects the simulated slide: the recorded controller answered to the recorded wheels. Compare "
                "the whole stop by the vehicle's speed and by the statistics of the slide, not wheel by wheel.",
            ),
            (slide_table(validation), *(_speeds(validation, name) for name in validation.stops)),
        ),
        Section("What the law is worth", (), (window_table(validation),)),
    ]
    if closed_loop:
        sections.append(Section("In closed loop", (), (closed_loop,)))
    if said := [sentence for stop in validation.stops.values() for sentence in stop.run.warnings]:
        sections.append(Section("What was repaired in the recordings, or looks wrong", said))
    write_page(path, f"Validation of campaign {campaign.name}", lead, sections, "Written by: wsp validate")


def _thin(n: int) -> slice:
    return slice(None, None, max(1, n // _POINTS))


def _transition(validation: Validation) -> Figure:
    objects, _ = plotly()
    figure = objects.Figure()
    law = validation.campaign.contact.law
    largest = 1.0
    for index, (name, score) in enumerate(validation.tuning.runs.items()):
        derived = validation.stops[name].derived
        energy = derived.energy_jpm[derived.usable]
        if not score.slides or not energy.size:
            continue
        largest = max(largest, float(energy.max()))
        shown = _thin(len(energy))
        marker = {"size": 3, "color": COLOURS[index % len(COLOURS)], "opacity": 0.5}
        values = transition(derived, score.mu_cd, law)[derived.usable]
        figure.add_scatter(x=energy[shown], y=values[shown], mode="markers", name=f"{name} ({score.group})", marker=marker)
    grid = np.linspace(0.0, largest, 300)
    line = {"color": "black", "width": 3}
    curve = 1.0 - np.exp(-validation.tuning.tau_m_per_J * grid)
    figure.add_scatter(x=grid, y=curve, mode="lines", name="1 - exp(-tau W_sp)", line=line)
    figure.update_layout(legend_itemsizing="constant")
    return axes(figure, "specific dissipated energy W_sp [J/m]", "transition function lambda [-]", height=480)


def _errors(validation: Validation) -> Figure:
    objects, _ = plotly()
    figure = objects.Figure()
    for axle in range(validation.campaign.vehicle.axles):
        sliding = {name: score.error[axle] for name, score in validation.tuning.runs.items() if score.error[axle] is not None}
        percent = [100.0 * error for error in sliding.values() if error is not None]
        figure.add_bar(x=list(sliding), y=percent, name=f"axle {axle + 1}", marker_color=COLOURS[axle % len(COLOURS)])
    return axes(figure, "run [-]", "relative adhesion error e_j [%]", height=320)


def _adhesion(validation: Validation, name: str) -> Figure:
    objects, _ = plotly()
    figure = objects.Figure()
    derived, score = validation.stops[name].derived, validation.tuning.runs[name]
    f_d, f_r = (limit[:, 0] for limit in limits(derived, score.mu_cd, validation.campaign.contact.law))
    model = validation.tuning.adhesion(validation.campaign, derived, score.mu_cd)[:, 0]
    inside = derived.speed_mps > 1.0  # below, the creepage has no meaning
    shown = _thin(int(inside.sum()))
    lines = (
        ("f_r, fully recovered", f_r),
        ("f_d, degraded", f_d),
        ("f, measured", derived.adhesion[:, 0]),
        ("f, calculated", model),
    )
    for (label, values), colour in zip(lines, (COLOURS[2], COLOURS[1], COLOURS[5], COLOURS[0]), strict=True):
        x, y = derived.time_s[inside][shown], values[inside][shown]
        figure.add_scatter(x=x, y=y, mode="lines", name=label, line={"color": colour, "width": 1.5})
    return axes(figure, "time [s]", "adhesion coefficient [-]", height=360, title=f"{name} ({score.group})")


def _speeds(validation: Validation, name: str) -> Figure:
    objects, _ = plotly()
    figure = objects.Figure()
    stop = validation.stops[name]
    derived, whole = stop.derived, stop.simulated
    samples = whole.speed_mps.shape[1]
    part, span = _thin(samples), slice(stop.start, stop.start + samples)
    time = derived.time_s[span]
    recorded = derived.speed_mps[span] - derived.slip_speed_mps[span, 0]
    lines = (
        ("vehicle, recorded", derived.speed_mps[span], COLOURS[6], "solid"),
        ("vehicle, simulated", whole.speed_mps[0], COLOURS[6], "dot"),
        ("first axle r w, recorded", recorded, COLOURS[5], "solid"),
        ("first axle r w, simulated", whole.circumferential_mps[0][:, 0], COLOURS[0], "solid"),
    )
    for label, values, colour, dash in lines:
        figure.add_scatter(
            x=time[part], y=values[part], mode="lines", name=label, line={"color": colour, "width": 1.5, "dash": dash}
        )
    return axes(figure, "time [s]", "speed [m/s]", height=360, title=f"{name} ({validation.tuning.runs[name].group})")
