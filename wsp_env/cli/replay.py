"""`wsp replay`: controllers under the conditions of recorded stops, beside the stops as recorded."""

import dataclasses
import json
import sys
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

from wsp_env.cli.out import OutFolder
from wsp_env.cli.pages import Pages
from wsp_env.cli.plant_options import PlantOptions
from wsp_env.cli.workers import WorkersOption, executor_of
from wsp_env.envs.model import TunedModel, read_model
from wsp_env.evaluation.controller import read_settings
from wsp_env.evaluation.replay import FIGURES, RECORDED, SIMULATED, Course, Replay, replay
from wsp_env.executor import Workers
from wsp_env.output import OutputError, ready
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.recordings import Campaign, read_campaign
from wsp_env.recordings.origin import hashes, origin
from wsp_env.report import COLOURS, Figure, Origin, PageOptions, Section, Table, axes, plotly, terminal_table, write_page

_DIGITS = {"distance_m": 0, "time_s": 1, "mean_slip_mps": 2, "slip_deviation_mps": 2, "largest_creepage": 2}
_HEADS = {
    "distance_m": "distance [m]",
    "time_s": "time [s]",
    "mean_slip_mps": "mean slip [m/s]",
    "slip_deviation_mps": "slip std. [m/s]",
    "largest_creepage": "largest creepage [-]",
    "beyond_limit_s": "beyond limit [s]",
    "locked_s": "locked [s]",
}


@dataclasses.dataclass(frozen=True)
class BrakedOptions:
    """What the controllers brake, and where.

    Parameters
    ----------
    track
        Adhesion along the track: one mu_cd per stop, or as estimated from the recording.
    model
        A model.json of `wsp diagnose` on these recordings: its tau, mu_cd and mechanisms brake, in the stops that are
        simulated with the recorded torque, too.
    vehicle
        Gives what campaign.toml does not tell: valve times, sensors, which axles form a bogie. A name (wsp vehicle list) or a
        vehicle file, with the campaign's number of axles; none: the coach's.

    """

    track: Annotated[str, tyro.conf.arg(metavar="constant|recorded")] = "constant"
    model: Path | None = None
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = ""


def main(
    campaign: tyro.conf.Positional[Path],
    /,
    controllers: tuple[str, ...] = ("none", "rule-based"),
    set: tuple[str, ...] = (),
    braked: Annotated[BrakedOptions, tyro.conf.arg(name="")] = BrakedOptions(),
    plant: Annotated[PlantOptions, tyro.conf.arg(name="")] = PlantOptions(),
    workers: WorkersOption = Workers(),
    out: OutFolder = Path("out/replay"),
    page: Pages = PageOptions(),
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Let controllers brake under the conditions of recorded stops; writes replay.html.

    The law is tuned on the campaign, or taken with its mechanisms from --model; every stop gets its initial speed, demand,
    load, mu_cd and tau. Two rows show how far this can be trusted: the stop as recorded, and the stop simulated with the
    recorded brake torque.

    Parameters
    ----------
    campaign
        Folder that holds campaign.toml and one table per run.
    controllers
        Short names (none, rule-based, slip, extremum, adaptive), folders of policies, package.module:Class, path.py:Class;
        such code is run.
    set
        Parameters of controllers, as rule-based.slip_base_mps=0.4.
    braked
        What the controllers brake, and where.
    plant
        What computes the vehicle's motion under the controllers.
    workers
        Who does the work, a task for every controller; the results do not depend on it.
    out
        Folder of the page.
    page
        How the page is written.
    json_
        Print the figures as JSON.

    """
    from wsp_env.parameters.quantity import ParameterError

    if braked.track not in ("constant", "recorded"):
        raise ParameterError(f"track {braked.track!r} is unknown; valid: constant, recorded")
    chosen = read_settings(controllers, set)
    model = read_model(str(braked.model)) if braked.model else None
    base = find_vehicle(braked.vehicle) if braked.vehicle else None
    executor = executor_of(workers)
    target = out / "replay.html"
    ready(*page.files(target))
    console = Console(stderr=json_, highlight=False)
    if not console.is_terminal:
        console = Console(stderr=json_, highlight=False, width=160)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("reading and tuning", total=len(chosen) + 2)
        recorded = read_campaign(campaign)
        _warn_of_other_sources(model, campaign)
        progress.advance(bar)
        result = replay(
            recorded,
            chosen,
            along_track=braked.track == "recorded",
            conduct=plant.conduct(mechanisms={}),
            model=model,
            base=base,
            executor=executor,
            done=lambda what: progress.update(bar, advance=1, description=escape(what)),
        )
    for name, message in result.failures.items():
        print(f"wsp: {name} failed: {message}", file=sys.stderr)
    try:
        _write_page(target, result, recorded, origin("wsp replay", recorded, campaign), page)
        written = f"Speeds and slips: {target}"
    except (ModuleNotFoundError, OutputError) as missing:  # the table does without
        written = f"no page: {missing}"
    if json_:
        print(json.dumps(result.to_json()))
    else:
        console.print(terminal_table(_table(result)))
        console.print(_headline(result), markup=False)
        console.print(written, markup=False)
    if result.failures:
        sys.exit(1)


def _warn_of_other_sources(model: TunedModel | None, campaign: Path) -> None:
    """Say on stderr that a model was found on other recordings: runs of the same names then get foreign mu_cd."""
    if model is None or not model.sources:
        return
    here = {name: digest for name, digest in hashes(campaign) if name != "campaign.toml"}
    if other := [name for name, digest in here.items() if model.sources.get(name) != digest]:
        print(
            f"wsp: warning: {model.path} was found on other recordings than {', '.join(other)}; its mu_cd belong to those. "
            "Diagnose this campaign, and replay it with its own model.json.",
            file=sys.stderr,
        )


def _table(result: Replay) -> Table:
    rows, previous = [], ""
    for course in result.courses:
        cells = [f"{course.figures[name]:.{_DIGITS.get(name, 1)}f}" for name in FIGURES]
        rows.append(("" if course.stop == previous else course.stop, course.who, *cells))
        previous = course.stop
    caption = f"tau = {result.tau_m_per_j:.3e} m/J; from the start of braking to the last recorded speed"
    return Table(("stop", "controller", *(_HEADS[name] for name in FIGURES)), rows, caption)


def _write_page(path: Path, result: Replay, campaign: Campaign, made_from: Origin, options: PageOptions) -> None:
    names = list(dict.fromkeys(course.who for course in result.courses))
    colour = {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}
    recorded = list(dict.fromkeys(course.stop for course in result.courses))
    sections = [
        Section(
            "",
            ("Left: metres longer (+) or shorter than the stop simulated with its recorded torque.",),
            (_front(result, colour),),
        ),
        Section("How far this can be trusted", _trust(result.courses), fold=True),
        Section("Figures of every stop", (), (_table(result),), fold=True),
    ]
    for stop in dict.fromkeys(course.stop for course in result.courses):
        shown = _speeds([c for c in result.courses if c.stop == stop], colour)
        sections.append(Section(f"Stop {stop}: speeds and slips", (), (shown,), fold=True))
    if said := [sentence for stop in recorded for sentence in campaign.runs[stop].warnings]:
        sections.append(Section("What was repaired in the recordings, or looks wrong", said, fold=True))
    lead = f"{_headline(result)} {_trusted(result.courses)}"
    write_page(path, f"Stops of campaign {result.campaign}, braked by others", lead, sections, made_from, options)


def _front(result: Replay, colour: dict[str, str]) -> Figure:
    """Draw what each controller does to each stop: metres of distance, and slip."""
    _, subplots = plotly()
    titles = ["stopping distance, change", "mean slip speed"]
    figure = subplots.make_subplots(1, 2, subplot_titles=titles, horizontal_spacing=0.12)
    simulated = {course.stop: course.figures["distance_m"] for course in result.courses if course.who == SIMULATED}
    for who, shade in colour.items():
        own = [course for course in result.courses if course.who == who]
        stops = [course.stop for course in own]
        metres = [course.figures["distance_m"] - simulated[course.stop] for course in own]
        slips = [course.figures["mean_slip_mps"] for course in own]
        for column, values in ((1, metres), (2, slips)):
            if column == 2 or who != SIMULATED:
                figure.add_bar(
                    x=stops, y=values, name=_called(who), legendgroup=who, showlegend=column == 2, marker={"color": shade},
                    row=1, col=column,
                )  # fmt: skip
    axes(figure, "stop [-]", "", height=400, legend={"orientation": "h", "x": 0.0, "y": 1.12, "yanchor": "bottom"})
    figure.update_layout(margin={"t": 90})
    figure.update_yaxes(title_text="change of distance [m]", row=1, col=1)
    figure.update_yaxes(title_text="mean slip [m/s]", row=1, col=2)
    result_: Figure = figure
    return result_


def _called(who: str) -> str:
    """Return what to call a controller in a sentence."""
    return "no protection" if who == "none" else who


def _headline(result: Replay) -> str:
    """Say in a sentence what each controller does to the distance and to the slide of the recorded stops."""
    ways, slips = ({(c.stop, c.who): c.figures[name] for c in result.courses} for name in ("distance_m", "mean_slip_mps"))
    stops = list(dict.fromkeys(course.stop for course in result.courses))
    parts = []
    for who in dict.fromkeys(course.who for course in result.courses):
        if who in (RECORDED, SIMULATED):
            continue
        changes = [ways[stop, who] - ways[stop, SIMULATED] for stop in stops if (stop, who) in ways]
        share = sum(changes) / sum(ways[stop, SIMULATED] for stop in stops)
        slip = sum(slips[stop, who] for stop in stops) / len(stops)
        side = "longer" if share > 0.0 else "shorter"
        same = abs(share) < 0.0005
        moved = (
            "as long" if same else f"{abs(sum(changes)) / len(changes):.1f} m ({100.0 * abs(share):.1f} %) {side} on average"
        )
        parts.append(f"{_called(who)}: {moved}, mean slip {slip:.2f} m/s")
    own = sum(slips[stop, SIMULATED] for stop in stops) / len(stops)
    return (
        f"Against the {len(stops)} recorded stops, simulated with their recorded brake torque (mean slip {own:.2f} m/s), "
        f"the same stops with {'; with '.join(parts)}."
        if parts
        else "No controller finished the stops."
    )


def _worst(courses: tuple[Course, ...]) -> float:
    """Return by which share the simulated distance is off at most."""
    pairs = {
        who: {course.stop: course.figures["distance_m"] for course in courses if course.who == who}
        for who in (RECORDED, SIMULATED)
    }
    return max(abs(pairs[SIMULATED][stop] / way - 1.0) for stop, way in pairs[RECORDED].items())


def _trusted(courses: tuple[Course, ...]) -> str:
    return f"The simulation itself is off by at most {100.0 * _worst(courses):.1f} %: smaller differences say nothing."


def _trust(courses: tuple[Course, ...]) -> tuple[str, ...]:
    return (
        f"Simulated with the recorded brake torque, the stops are at most {100 * _worst(courses):.1f} % longer or shorter than "
        "recorded: the law and the vehicle hold to this extent. Brakes are replayed as hard and as early as recorded, all "
        "axles alike.",
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
