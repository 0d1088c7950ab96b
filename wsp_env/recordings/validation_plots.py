"""The plots of `wsp validate`: the law against each run, axle by axle, with what it leaves; the vehicle simulated."""

from typing import Any, NamedTuple

import numpy as np

from wsp_env.recordings.derive import braking, limits, transition
from wsp_env.recordings.validation import Validation
from wsp_env.report import COLOURS, Figure, axes, plotly

_POINTS = 130  # of a line that is one of many
_CLOUD = 1200  # points of a cloud
_LEAST_SPEED_MPS = 1.0  # below, the creepage has no meaning


class Worst(NamedTuple):
    """The axle and the run that the law fits worst."""

    run: str
    axle: int  # from 0
    error: float  # e_j [-]


def worst(validation: Validation) -> Worst | None:
    """Return the worst fit of the runs that were only scored (of all, if there is none); None where no wheel slides."""
    campaign, runs = validation.campaign, validation.tuning.runs
    held_out = [name for name in campaign.validate if runs[name].slides]
    errors = [
        Worst(name, axle, error)
        for name in held_out or list(runs)
        for axle, error in enumerate(runs[name].error)
        if error is not None
    ]
    return max(errors, key=lambda one: one.error, default=None)


def adhesion_plot(validation: Validation, name: str, only: int | None = None, height: int = 520) -> Figure:
    """Draw adhesion, measured and calculated, over what is left of it, while a run brakes: every axle, or only one.

    Before braking the creepage is noise, and the limits of eq. (5) say something only while a wheel slides. The upper one is
    far above: alone, an axle is drawn without it.
    """
    _, subplots = plotly()
    stop, score = validation.stops[name], validation.tuning.runs[name]
    derived = stop.derived
    chosen = list(range(validation.campaign.vehicle.axles)) if only is None else [only]
    f_d, f_r = limits(derived, score.mu_cd, validation.campaign.contact.law)
    model = validation.tuning.adhesion(validation.campaign, derived, score.mu_cd)
    start, end = braking(stop.run, validation.campaign.sample_time_s)
    within = np.flatnonzero(derived.speed_mps > _LEAST_SPEED_MPS)
    shown = within[(within >= start) & (within < end)]
    shown = shown[:: max(1, len(shown) // (_POINTS if only is None else 2 * _POINTS))]
    titles = [_title(validation, name, axle) for axle in chosen]
    figure = subplots.make_subplots(
        2, len(chosen), shared_xaxes=True, shared_yaxes="rows", subplot_titles=titles, row_heights=[0.64, 0.36],
        vertical_spacing=0.06, horizontal_spacing=0.03,
    )  # fmt: skip
    for column, axle in enumerate(chosen, start=1):
        slides = np.asarray(derived.usable)[shown, axle]
        measured, calculated = derived.adhesion[shown, axle], model[shown, axle]
        lines: tuple[tuple[str, np.ndarray, str, str, int], ...] = (
            ("limit f_d, degraded", np.where(slides, f_d[shown, axle], np.nan), COLOURS[1], "dot", 1),
            ("f, measured", measured, COLOURS[5], "solid", 1),
            ("f, calculated", calculated, COLOURS[0], "solid", 1),
            ("measured less calculated", measured - calculated, COLOURS[6], "solid", 2),
        )
        if only is None:
            lines = (("limit f_r, fully recovered", np.where(slides, f_r[shown, axle], np.nan), COLOURS[2], "dot", 1), *lines)
        for label, values, colour, dash, row in lines:
            figure.add_scatter(
                x=derived.time_s[shown], y=values, mode="lines", name=label, legendgroup=label, showlegend=column == 1,
                line={"color": colour, "width": 1.4, "dash": dash}, row=row, col=column,
            )  # fmt: skip
        figure.add_hline(y=0.0, line={"color": "#888", "width": 1}, row=2, col=column)
    return _panels(figure, ("adhesion coefficient [-]", "residual [-]"), len(chosen), height)


def speeds_plot(validation: Validation, name: str) -> Figure:
    """Draw each axle's speed and the vehicle's, recorded and simulated, and by how much the vehicle's differ."""
    _, subplots = plotly()
    stop = validation.stops[name]
    derived, whole = stop.derived, stop.simulated
    samples = whole.speed_mps.shape[1]
    part = np.arange(samples)[:: max(1, samples // _POINTS)]
    span = part + stop.start
    count = validation.campaign.vehicle.axles
    figure = subplots.make_subplots(
        2, count, shared_xaxes=True, shared_yaxes="rows", row_heights=[0.68, 0.32], vertical_spacing=0.08,
        horizontal_spacing=0.03, subplot_titles=[f"axle {axle + 1}" for axle in range(count)],
        specs=[[{}] * count, [{"colspan": count}, *[None] * (count - 1)]],
    )  # fmt: skip
    time, speed = derived.time_s[span], derived.speed_mps[span]
    for axle in range(count):
        lines = (
            ("r w, recorded", speed - derived.slip_speed_mps[span, axle], COLOURS[5], "solid"),
            ("r w, simulated", whole.circumferential_mps[0][part, axle], COLOURS[0], "solid"),
            ("vehicle, recorded", speed, COLOURS[6], "solid"),
            ("vehicle, simulated", whole.speed_mps[0][part], COLOURS[1], "dot"),
        )
        for label, values, colour, dash in lines:
            figure.add_scatter(
                x=time, y=values, mode="lines", name=label, legendgroup=label, showlegend=axle == 0,
                line={"color": colour, "width": 1.3, "dash": dash}, row=1, col=axle + 1,
            )  # fmt: skip
    figure.add_scatter(
        x=time, y=speed - whole.speed_mps[0][part], mode="lines", name="vehicle, recorded less simulated",
        line={"color": COLOURS[3], "width": 1.4}, row=2, col=1,
    )  # fmt: skip
    figure.add_hline(y=0.0, line={"color": "#888", "width": 1}, row=2, col=1)
    _panels(figure, ("speed [m/s]", "difference [m/s]"), count, 500)
    figure.update_xaxes(title_text="", row=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return figure


def transition_plot(validation: Validation) -> Figure:
    """Draw lambda over the energy spent: each sample of each sliding wheel, and the tuned curve."""
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
        shown = slice(None, None, max(1, len(energy) // _CLOUD))
        marker = {"size": 3, "color": COLOURS[index % len(COLOURS)], "opacity": 0.5}
        values = transition(derived, score.mu_cd, law)[derived.usable]
        group = "held out" if score.group == "validate" else "tuned on"
        figure.add_scatter(x=energy[shown], y=values[shown], mode="markers", name=f"{name} ({group})", marker=marker)
    grid = np.linspace(0.0, largest, 300)
    line = {"color": "black", "width": 3}
    curve = 1.0 - np.exp(-validation.tuning.tau_m_per_J * grid)
    figure.add_scatter(x=grid, y=curve, mode="lines", name="tuned law: 1 - exp(-tau W_sp)", line=line)
    figure.update_layout(legend_itemsizing="constant")
    return axes(figure, "specific dissipated energy W_sp [J/m]", "transition function lambda [-]", height=480)


def errors_plot(validation: Validation) -> Figure:
    """Draw e_j of every axle and run."""
    objects, _ = plotly()
    figure = objects.Figure()
    for axle in range(validation.campaign.vehicle.axles):
        sliding = {name: score.error[axle] for name, score in validation.tuning.runs.items() if score.error[axle] is not None}
        percent = [100.0 * error for error in sliding.values() if error is not None]
        figure.add_bar(x=list(sliding), y=percent, name=f"axle {axle + 1}", marker_color=COLOURS[axle % len(COLOURS)])
    return axes(figure, "run [-]", "relative adhesion error e_j [%]", height=320)


def _title(validation: Validation, name: str, axle: int) -> str:
    error = validation.tuning.runs[name].error[axle]
    return f"run {name}, axle {axle + 1}: " + ("never slides" if error is None else f"error {100.0 * error:.1f} %")


def _panels(figure: Any, names: tuple[str, str], columns: int, height: int) -> Figure:
    """Give a figure of two rows its titles: one at each edge."""
    axes(figure, "", "", height=height, legend={"orientation": "h", "x": 0.0, "y": 1.1, "yanchor": "bottom"})
    figure.update_layout(margin={"t": 100})
    figure.update_annotations(font_size=13)
    for column in range(1, columns + 1):
        figure.update_xaxes(title_text="time [s]", row=2, col=column)
    for row, name in enumerate(names, start=1):
        figure.update_yaxes(title_text=name, row=row, col=1)
    result: Figure = figure
    return result
