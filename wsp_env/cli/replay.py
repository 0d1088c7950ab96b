"""`wsp replay`: controllers under the conditions of recorded stops, beside the stops as recorded."""

import json
import sys
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

from wsp_env.envs.model import read_model
from wsp_env.evaluation.controller import read_settings
from wsp_env.evaluation.replay import FIGURES, RECORDED, SIMULATED, Course, Replay, replay
from wsp_env.output import OutputError, ready
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.recordings import Campaign, read_campaign
from wsp_env.report import COLOURS, Figure, Section, Table, axes, plotly, terminal_table, write_page

_DIGITS = {"distance_m": 0, "time_s": 1, "mean_slip_mps": 2, "slip_deviation_mps": 2, "largest_creepage": 2}
_HEADS = {
    "distance_m": "distance [m]",
    "time_s": "time [s]",
    "mean_slip_mps": "mean slip [m/s]",
    "slip_deviation_mps": "deviation [m/s]",
    "largest_creepage": "largest creepage [-]",
    "beyond_limit_s": "beyond limit [s]",
    "locked_s": "locked [s]",
}


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    controllers: tuple[str, ...] = ("none", "rule-based"),
    set: tuple[str, ...] = (),
    track: Annotated[str, tyro.conf.arg(metavar="constant|recorded")] = "constant",
    model: Path | None = None,
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "",
    out: Path = Path("out/replay"),
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Let controllers brake under the conditions of recorded stops; writes replay.html.

    The law is tuned on the campaign; every stop gets its initial speed, demand, load, mu_cd and tau. Two rows show how far this
    can be trusted: the stop as recorded, and the stop simulated with the recorded brake torque.

    Parameters
    ----------
    campaign
        Folder that holds campaign.toml and one table per run.
    controllers
        Short names (none, rule-based, slip, extremum, adaptive), folders of policies, package.module:Class, path.py:Class;
        such code is run.
    set
        Parameters of controllers, as rule-based.slip_base_mps=0.4.
    track
        Adhesion along the track: one mu_cd per stop, or as estimated from the recording.
    model
        A model.json of `wsp diagnose`, whose mechanisms are switched on.
    vehicle
        Gives what campaign.toml does not tell: valve times, sensors, which axles form a bogie. A name (wsp vehicle list) or a
        vehicle file, with the campaign's number of axles; none: the coach's.
    out
        Folder of the page.
    json_
        Print the figures as JSON.

    """
    from wsp_env.parameters.quantity import ParameterError

    if track not in ("constant", "recorded"):
        raise ParameterError(f"track {track!r} is unknown; valid: constant, recorded")
    chosen = read_settings(controllers, set)
    mechanisms = read_model(str(model)).mechanisms if model else {}
    base = find_vehicle(vehicle) if vehicle else None
    page = out / "replay.html"
    ready(page)
    console = Console(stderr=json_, highlight=False)
    if not console.is_terminal:
        console = Console(stderr=json_, highlight=False, width=160)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("reading and tuning", total=len(chosen) + 2)
        recorded = read_campaign(campaign)
        progress.advance(bar)
        result = replay(
            recorded,
            chosen,
            along_track=track == "recorded",
            mechanisms=mechanisms,
            base=base,
            done=lambda what: progress.update(bar, advance=1, description=escape(what)),
        )
    for name, message in result.failures.items():
        print(f"wsp: {name} failed: {message}", file=sys.stderr)
    try:
        _write_page(page, result, recorded)
        written = f"Speeds and slips: {page}"
    except (ModuleNotFoundError, OutputError) as missing:  # the table does without
        written = f"no page: {missing}"
    if json_:
        print(json.dumps(result.to_json()))
    else:
        console.print(terminal_table(_table(result)))
        console.print(written, markup=False)
    if result.failures:
        sys.exit(1)


def _table(result: Replay) -> Table:
    rows, previous = [], ""
    for course in result.courses:
        cells = [f"{course.figures[name]:.{_DIGITS.get(name, 1)}f}" for name in FIGURES]
        rows.append(("" if course.stop == previous else course.stop, course.who, *cells))
        previous = course.stop
    caption = f"tau = {result.tau_m_per_j:.3e} m/J; from the start of braking to the last recorded speed"
    return Table(("stop", "controller", *(_HEADS[name] for name in FIGURES)), rows, caption)


def _write_page(path: Path, result: Replay, campaign: Campaign) -> None:
    objects, _ = plotly()
    names = list(dict.fromkeys(course.who for course in result.courses))
    colour = {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}
    recorded = {course.stop: course.figures["distance_m"] for course in result.courses if course.who == RECORDED}
    front = objects.Figure()
    for name in names:
        own = [course for course in result.courses if course.who == name]
        front.add_scatter(
            x=[course.figures["mean_slip_mps"] for course in own],
            y=[course.figures["distance_m"] / recorded[course.stop] for course in own],
            text=[course.stop for course in own],
            mode="markers",
            name=name,
            marker={"color": colour[name], "size": 9},
        )
    axes(front, "mean slip speed [m/s]", "distance over the recorded stop's [-]", height=480)
    sections = [
        Section("Figures", _trust(result.courses), (_table(result),)),
        Section(
            "Distance against slip",
            ("Further down stops shorter, further left slides less; point at a mark for its stop.",),
            (front,),
        ),
    ]
    for stop in dict.fromkeys(course.stop for course in result.courses):
        sections.append(Section(f"Stop {stop}", (), (_speeds([c for c in result.courses if c.stop == stop], colour),)))
    if said := [sentence for stop in recorded for sentence in campaign.runs[stop].warnings]:
        sections.append(Section("What was repaired in the recordings, or looks wrong", said))
    lead = f"Controllers under the conditions of campaign {result.campaign}, beside the stops as they were recorded."
    write_page(path, "Replayed stops", lead, sections, "Written by: wsp replay")


def _trust(courses: tuple[Course, ...]) -> tuple[str, ...]:
    pairs = {
        who: {course.stop: course.figures["distance_m"] for course in courses if course.who == who}
        for who in (RECORDED, SIMULATED)
    }
    worst = max(abs(pairs[SIMULATED][stop] / way - 1.0) for stop, way in pairs[RECORDED].items())
    return (
        f"Simulated with the recorded brake torque, the stops are at most {100 * worst:.1f} % longer or shorter than recorded: "
        "the law and the vehicle hold to this extent. Brakes are replayed as hard and as early as recorded, all axles alike.",
        "A controller's own stop cannot be compared sample by sample with the recorded one: tiny causes make two stops under a "
        "controller with thresholds part. Compare distances, and the statistics of the slide.",
    )


def _speeds(courses: list[Course], colour: dict[str, str]) -> Figure:
    objects, subplots = plotly()
    figure = subplots.make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for course in courses:
        thin = slice(None, None, max(1, len(course.time_s) // 600))
        line = {"color": colour[course.who], "width": 1.6}
        for row, values in ((1, course.speed_mps), (2, course.slip_mps.max(axis=1))):
            trace = objects.Scatter(
                x=course.time_s[thin], y=values[thin], name=course.who, line=line, legendgroup=course.who, showlegend=row == 1
            )
            figure.add_trace(trace, row=row, col=1)
    axes(figure, "", "", height=520)
    figure.update_xaxes(title_text="time since braking began [s]", row=2)
    figure.update_yaxes(title_text="speed [m/s]", row=1)
    figure.update_yaxes(title_text="largest slip [m/s]", row=2)
    return figure
