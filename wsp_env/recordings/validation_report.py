"""The page that `wsp validate` writes: the seed paper's figures 6 to 11 and tables 4 and 7 for one campaign."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wsp_env.recordings.simulate import WINDOW_S
from wsp_env.recordings.tuning import Tuning
from wsp_env.recordings.validation import CLOSED_LOOP_BY, RIVALS, ClosedLoop, ValidatedStop, Validation
from wsp_env.recordings.validation_plots import Worst, adhesion_plot, errors_plot, speeds_plot, transition_plot, worst
from wsp_env.report import Facts, Origin, PageOptions, Section, Table, write_page


def adhesion_table(tuning: Tuning) -> Table:
    """Table 4: e_j per axle and run."""
    axles = len(next(iter(tuning.runs.values())).error)
    header = ("run", "used to", "friction mu_cd [-]", *(f"axle {k} [%]" for k in range(1, axles + 1)))
    rows = []
    for name, score in tuning.runs.items():
        mark = "" if score.mu_cd_tuned else "*"
        errors = (
            "no sensor" if k in score.missing_axles else "no slide" if error is None else f"{100 * error:.1f}"
            for k, error in enumerate(score.error, 1)
        )
        rows.append((name, score.group, f"{score.mu_cd:.4f}{mark}", *errors))
    caption = "per axle the relative error e_j of the adhesion coefficient, as in the seed paper's Table 4"
    if not all(score.mu_cd_tuned for score in tuning.runs.values()):
        caption += "; *: as believed, not tuned"
    return Table(header, rows, caption)


def slide_table(validation: Validation) -> Table:
    """Table 7: E, mean slide and its deviation, recorded and simulated, of each run's first axle and worst axle."""
    rows = []
    for name, stop in validation.stops.items():
        s = stop.slide
        means = np.abs(np.subtract(s.recorded_mean_mps, s.simulated_mean_mps)).max()
        first = (s.recorded_mean_mps, s.simulated_mean_mps, s.recorded_deviation_mps, s.simulated_deviation_mps)
        rows.append((name, f"{s.speed_error_mps:.2f}", *(f"{values[0]:.2f}" for values in first), f"{means:.2f}"))
    header = (
        "run", "speed error E [m/s]", "mean slide, recorded [m/s]", "simulated [m/s]", "deviation, recorded [m/s]",
        "simulated [m/s]", "means apart, worst axle [m/s]",
    )  # fmt: skip
    caption = "vehicle simulated with the recorded brake torque over the whole stop; first axle, as the seed paper's Table 7"
    return Table(header, rows, caption)


def window_table(validation: Validation) -> Table:
    """Return what the law is worth: errors over windows beside simpler laws."""
    header = ("run", *(f"{what} [m/s]" for what in RIVALS.values()))
    rows = [
        (name, *(f"{stop.window_rms_mps[rival]:.3f}" if stop.window_rms_mps else "too slow" for rival in RIVALS))
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
        (c.name, f"{c.value:.3g} {c.unit}".strip(), f"{c.limit:.3g} {c.unit}".strip(), "yes" if c.met else "no")
        for c in validation.criteria
    ]
    return Table(("figure", "here, worst", "seed paper, worst", "met"), rows, f"over the runs that were {validation.scored}")


def write(
    path: Path,
    validation: Validation,
    closed_loop: Table | None = None,
    made_from: Origin = Origin("wsp validate"),
    options: PageOptions = PageOptions(),
) -> None:
    """Write the page, with the table of a closed loop where there is one; it needs the extra [report]."""
    campaign = validation.campaign
    shown = worst(validation)
    first = [] if shown is None else [adhesion_plot(validation, shown.run, shown.axle, height=430)]
    sections = [
        Section("", () if shown is None else (_shown(validation, shown),), (_facts(validation), *first)),
        Section(
            "The seed paper's own figures",
            (),
            (criteria_table(validation), adhesion_table(validation.tuning), errors_plot(validation)),
            fold=True,
        ),
        Section(
            "Transition from degraded to recovered adhesion",
            ("Each point is one sample of one sliding wheel: lambda by eq. (3) over the energy spent; the curve is eq. (4).",),
            (transition_plot(validation),),
            fold=True,
        ),
        *(_run(validation, name) for name in validation.stops),
        Section("The vehicle's speed and the slide, all runs", (), (slide_table(validation),), fold=True),
        Section("What the law is worth", (), (window_table(validation),), fold=True),
    ]
    if closed_loop:
        sections.append(Section("In closed loop", (), (closed_loop,), fold=True))
    if said := [sentence for stop in validation.stops.values() for sentence in stop.run.warnings]:
        sections.append(Section("What was repaired in the recordings, or looks wrong", said, fold=True))
    write_page(path, f"Validation of campaign {campaign.name}", validation.verdict, sections, made_from, options)


def _facts(validation: Validation) -> Facts:
    """Return what the first screen says beside the verdict: how sure, and what is left in metres."""
    campaign, tuning = validation.campaign, validation.tuning
    scored = ", ".join(campaign.validate) or "none: the verdict rests on the runs tuned on"
    rows = [("Tuned on", f"{', '.join(campaign.tune)}: {tuning.sentence}"), ("Only scored", scored)]
    if ways := [_ways(stop) for name, stop in validation.stops.items() if name in (campaign.validate or campaign.tune)]:
        off = [round(simulated - recorded, 1) + 0.0 for recorded, simulated in ways]  # no "-0.0"
        share = max(abs(simulated / recorded - 1.0) for recorded, simulated in ways)
        apart = f"{min(off):+.1f} to {max(off):+.1f} m" if len(off) > 1 else f"{off[0]:+.1f} m"
        rows.append(
            ("Left in a stop", f"simulated with the recorded brake torque, stops differ by {apart} "
             f"(at most {100.0 * share:.1f} % of the way braked)")
        )  # fmt: skip
    met = [criterion for criterion in validation.criteria if criterion.met]
    rows.append(("Figures of the paper", f"{len(met)} of {len(validation.criteria)} met; they measure the fit of this law, and "
                 "cannot see physics that tau and mu_cd hide: wsp diagnose looks for it"))  # fmt: skip
    return Facts(rows)


def _ways(stop: ValidatedStop) -> tuple[float, float]:
    """Return how far [m] a stop ran while it was simulated, as recorded and as simulated."""
    samples = stop.simulated.speed_mps.shape[1]
    span = slice(stop.start, stop.start + samples)
    time = stop.derived.time_s[span]
    recorded, simulated = (
        float(np.trapezoid(v[: len(time)], time)) for v in (stop.derived.speed_mps[span], stop.simulated.speed_mps[0])
    )
    return max(recorded, 1e-9), simulated


def _shown(validation: Validation, one: Worst) -> str:
    held_out = " held-out" if one.run in validation.campaign.validate else ""
    return f"The worst fit of a{held_out} axle: run {one.run}, axle {one.axle + 1}, {100.0 * one.error:.1f} % off on average."


def _run(validation: Validation, name: str) -> Section:
    group = "only scored" if name in validation.campaign.validate else "tuned on"
    text = (
        "Measured adhesion (eqs. 1 and 11), calculated from the measured slip (eq. 10), and while a wheel slides the limits of "
        "both (eq. 5). Below: the vehicle simulated with the recorded brake torque. Nothing corrects the simulated slide: "
        "compare the vehicle's speed and the statistics of the slide, not wheel by wheel.",
    )
    shows = (adhesion_plot(validation, name), speeds_plot(validation, name))
    return Section(f"Run {name} ({group}), every axle", text, shows, fold=True)
