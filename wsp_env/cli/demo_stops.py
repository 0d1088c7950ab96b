"""The stops of `wsp demo`: those recorded, braked under the tuned law, with what was found, and by a learned policy."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wsp_env.evaluation.controller import load
from wsp_env.evaluation.replay import braked
from wsp_env.evaluation.runner import Conduct, StopRecords, run
from wsp_env.parameters.quantity import ParameterError, replace
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Stop
from wsp_env.recordings import Campaign, conditions
from wsp_env.recordings.tuning import Tuning
from wsp_env.report import COLOURS, Figure, Section, Table, axes, plotly

#: The learned policy for the vehicle of the recordings; it stands beside the package in a clone and is not installed.
POLICY = Path(__file__).parents[2] / "agents" / "trained" / "coach"

_SHOWN_POINTS = 600  # of a line


@dataclasses.dataclass(frozen=True)
class World:
    """What stops are braked in: a vehicle, conditions by the name of the recorded stop, and mechanisms."""

    vehicle: Vehicle
    stops: Mapping[str, Stop]
    conduct: Conduct

    def brake(self, controller: str) -> StopRecords:
        """Let a controller brake all stops."""
        return run(load(controller), self.vehicle, list(self.stops.values()), self.conduct)


def worlds(campaign: Campaign, tuning: Tuning, model: Mapping[str, Any]) -> tuple[World, World]:
    """Return the recorded stops under the tuned law, and under the model of a diagnosis (what model.json holds)."""
    vehicle, stops, names = braked(campaign, conditions(campaign, tuning))
    tuned = World(vehicle, dict(zip(names, stops, strict=True)), Conduct())
    frictions, tau = model["mu_cd"], model["tau_m_per_J"]
    moved = {name: dataclasses.replace(stop, mu_cd=frictions[name], tau=tau) for name, stop in tuned.stops.items()}
    own = replace(vehicle, {"contact": dict(model["contact"])}, "vehicle parameter")
    return tuned, World(own, moved, Conduct(mechanisms=model["mechanisms"]))


def found_section(before: World, after: World, run_shown: str) -> Section:
    """Show the recorded stops, braked by the rules under the tuned law and with what was found."""
    without, found = before.brake("rule-based"), after.brake("rule-based")
    rows = [
        (name, *_figures(without, i), *_figures(found, i), f"{found.distance[i] - without.distance[i]:+.1f}")
        for i, name in enumerate(before.stops)
    ]
    head = (
        "stop",
        "tuned law: distance [m]",
        "mean slip [m/s]",
        "with the finding: distance [m]",
        "mean slip [m/s]",
        "change [m]",
    )
    mean = float((found.distance - without.distance).mean())
    text = (
        "The environment brakes with what was found: wsp diagnose writes it into model.json. Under the conditions of the "
        f"recorded stops the rule-based WSP then stops {abs(mean):.1f} m {'shorter' if mean < 0.0 else 'longer'} on average "
        "than under the tuned law alone. By this a simulation without the finding is wrong.",
    )
    index = list(before.stops).index(run_shown)
    figure = _adhesion({"tuned law": without, "with the finding": found}, index)
    return Section(
        f"The stop with the found physics (conditions of {run_shown} in the picture)", text, (Table(head, rows), figure)
    )


def policy_section(world: World, policy: Path = POLICY) -> Section:
    """Show the rules beside the learned policy, both in the world with what was found."""
    title = "Rules beside the learned policy, with the found physics"
    braked_by = {"no protection": world.brake("none"), "rule-based": world.brake("rule-based")}
    text = ["The same stops with what was found. The policy was trained without it, and sees wheel speeds and the demand only."]
    try:
        braked_by["learned policy"] = world.brake(str(policy)) if policy.is_dir() else _absent(policy)
    except (ModuleNotFoundError, ParameterError) as missing:
        text = [f"The learned policy is left out: {missing}."]
    else:
        rules, learned = braked_by["rule-based"], braked_by["learned policy"]
        share = float(learned.distance.sum() / rules.distance.sum() - 1.0)
        slips = " against ".join(f"{_slip(one):.2f} m/s" for one in (learned, rules))
        side = "shorter" if share < 0.0 else "longer"
        text.append(f"It stops {100.0 * abs(share):.1f} % {side} than the rules, at a mean slip of {slips}.")
    rows = [
        (name, who, *_figures(one, i), f"{one.air[i].sum():.0f}")
        for i, name in enumerate(world.stops)
        for who, one in braked_by.items()
    ]
    table = Table(("stop", "controller", "distance [m]", "mean slip [m/s]", "air used [Nl]"), rows)
    return Section(title, text, (table, _bars(braked_by, list(world.stops))))


def _absent(policy: Path) -> StopRecords:
    raise ParameterError(f"{policy} is not there; it comes with a clone of the repository")


def _slip(result: StopRecords) -> float:
    """Return the mean slip speed [m/s] over all stops and axles, while they move."""
    moving = result.speed > 0.0
    return float(result.slip[moving].mean())


def _figures(result: StopRecords, index: int) -> tuple[str, str]:
    last = int(result.steps[index])
    return f"{result.distance[index]:.1f}", f"{result.slip[: last + 1, index].mean():.2f}"


def _adhesion(results: Mapping[str, StopRecords], index: int) -> Figure:
    """Draw vehicle and wheels, and the adhesion of the leading and the trailing wheelset."""
    objects, subplots = plotly()
    figure = subplots.make_subplots(
        rows=2, cols=2, shared_xaxes=True, shared_yaxes="rows", subplot_titles=list(results), vertical_spacing=0.06
    )
    for column, result in enumerate(results.values(), start=1):
        last = int(result.steps[index]) + 1
        thin = slice(0, last, max(1, last // _SHOWN_POINTS))
        speed, slip = result.speed[thin, index], result.slip[thin, index]
        adhesion = result.adhesion[thin, index]
        lines = (
            (1, "leading wheelset", speed - slip[:, 0], COLOURS[0]),
            (1, "trailing wheelset", speed - slip[:, -1], COLOURS[1]),
            (1, "vehicle", speed, COLOURS[6]),
            (2, "leading wheelset", adhesion[:, 0], COLOURS[0]),
            (2, "trailing wheelset", adhesion[:, -1], COLOURS[1]),
        )
        for row, name, values, colour in lines:
            trace = objects.Scatter(
                x=result.time[thin], y=values, name=name, line={"color": colour, "width": 1.4}, legendgroup=name,
                showlegend=column == 1 and row == 1,
            )  # fmt: skip
            figure.add_trace(trace, row=row, col=column)
    axes(figure, "", "", height=600)
    figure.update_xaxes(title_text="time [s]", row=2)
    figure.update_yaxes(title_text="speed [m/s]", row=1, col=1)
    figure.update_yaxes(title_text="adhesion coefficient [-]", row=2, col=1)
    drawn: Figure = figure
    return drawn


def _bars(results: Mapping[str, StopRecords], stops: Sequence[str]) -> Figure:
    _, subplots = plotly()
    figure = subplots.make_subplots(1, 2, subplot_titles=["stopping distance", "mean slip speed"], horizontal_spacing=0.12)
    for index, (who, one) in enumerate(results.items()):
        slips = [float(_figures(one, i)[1]) for i in range(len(stops))]
        for column, values in ((1, one.distance.tolist()), (2, slips)):
            figure.add_bar(
                x=list(stops), y=values, name=who, legendgroup=who, showlegend=column == 1, marker={"color": COLOURS[index]},
                row=1, col=column,
            )  # fmt: skip
    axes(figure, "stop [-]", "", height=400, legend={"orientation": "h", "x": 0.0, "y": 1.12, "yanchor": "bottom"})
    figure.update_layout(margin={"t": 90})
    figure.update_yaxes(title_text="distance [m]", row=1, col=1)
    figure.update_yaxes(title_text="mean slip [m/s]", row=1, col=2)
    drawn: Figure = figure
    return drawn
