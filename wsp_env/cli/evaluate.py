"""`wsp evaluate`: controllers through the test programme, side by side."""

import dataclasses
import functools
import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, BinaryIO, TypeVar

import polars
import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from wsp_env.cli.out import OutFolder
from wsp_env.cli.pages import Pages
from wsp_env.cli.plant_options import PhysicsOptions
from wsp_env.cli.workers import WorkersOption, executor_of
from wsp_env.evaluation.controller import read_settings
from wsp_env.evaluation.evaluate import BOUND, Failure, ProgrammeResult, Trace, evaluate
from wsp_env.evaluation.figures import FIGURES
from wsp_env.evaluation.programme import STANDARD, Draws, read_programme, select_cases
from wsp_env.evaluation.programme_report import LEFT_LIMIT, write_report
from wsp_env.evaluation.summary import Verdict, decided, judge, summarise
from wsp_env.executor import Workers
from wsp_env.output import all_of, ready, write_whole
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.report import Origin, PageOptions

#: Columns of the printed table: figure, heading, digits.
_COLUMNS = (
    ("distance_m", "distance\n[m]", 0),
    ("ratio_dry", "/ dry", 2),
    ("ratio_bound", "/ bound", 2),
    ("mean_slip_mps", "mean slip\n[m/s]", 2),
    ("slip_deviation_mps", "slip std.\n[m/s]", 2),
    ("largest_creepage", "largest\ncreepage", 2),
    ("beyond_limit_s", "beyond\nlimit [s]", 1),
    ("locked_s", "locked\n[s]", 1),
    ("utilisation", "utili-\nsation", 2),
    ("air_nl", "air\n[Nl]", 0),
    ("contact_energy_mj", "energy\n[MJ]", 2),
)
#: Files of the tables.
TABLES = ("stops.csv", "stops.parquet", "summary.csv")

#: What names a controller.
Named = TypeVar("Named", Trace, Verdict, Failure)

_RATIO = [figure for figure, _, _ in _COLUMNS].index("ratio_bound")


@dataclasses.dataclass(frozen=True)
class ProgrammeOptions:
    """Which stops are braked, and with what sensors.

    Parameters
    ----------
    programme
        File with cases and requirements in place of the standard one.
    cases
        Names of the programme's cases; none: all that the vehicle is fast enough for.
    draws
        Stops of each case under each law.
    seed
        Of the draws.
    pressure_sensors
        The vehicle measures its cylinder pressures.

    """

    programme: Path = STANDARD
    cases: tuple[str, ...] = ()
    draws: int = Draws.number
    seed: int = Draws.seed
    pressure_sensors: bool = False


def main(
    controllers: tuple[str, ...] = ("none", "rule-based"),
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "coach",
    set: tuple[str, ...] = (),
    stops: Annotated[ProgrammeOptions, tyro.conf.arg(name="")] = ProgrammeOptions(),
    workers: WorkersOption = Workers(),
    plant: Annotated[PhysicsOptions, tyro.conf.arg(name="")] = PhysicsOptions(),
    out: OutFolder = Path("out/evaluate"),
    page: Pages = PageOptions(),
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Put controllers through the test programme and compare them.

    Writes stops.csv, stops.parquet, summary.csv and report.html. What was computed before is kept in the folder: an
    interrupted evaluation goes on where it stopped.

    Parameters
    ----------
    controllers
        Short names (none, rule-based, slip, extremum, adaptive), folders of policies, package.module:Class, path.py:Class,
        libraries in C (.so) and FMUs (see wsp export template); such code is run.
    vehicle
        A name (wsp vehicle list) or a vehicle file (wsp vehicle show coach > mine.toml).
    set
        Parameters of controllers, as rule-based.slip_base_mps=0.4.
    stops
        Which stops are braked.
    workers
        Who does the work; the results do not depend on it.
    plant
        What computes the vehicle's motion.
    out
        Folder of the results.
    page
        How report.html is written.
    json_
        Print stops, summary, verdicts and failures as JSON.

    """
    braked = plant.on(find_vehicle(vehicle))
    plant.check(braked)
    draws = Draws(stops.draws, stops.seed)
    executor = executor_of(workers)
    if repeated := {name for name in controllers if controllers.count(name) > 1}:
        raise ParameterError(f"controller {', '.join(sorted(repeated))} is named twice")
    chosen = read_settings(controllers, set)
    table = read_programme(stops.programme)
    wanted = select_cases(table, braked, stops.cases)
    ready(*(out / name for name in TABLES), *page.files(out / "report.html"), out / "cases" / "case.npz")
    errors = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=errors, transient=True) as progress:
        bar = progress.add_task("", total=len(wanted) * (len(chosen) + 1))
        result = evaluate(
            chosen,
            table,
            wanted,
            braked,
            out / "cases",
            draws=draws,
            executor=executor,
            conduct=plant.conduct(pressure_sensors=stops.pressure_sensors),
            done=lambda what: progress.update(bar, advance=1, description=escape(what)),
        )
    for failure in result.failures:
        errors.print(f"{failure.controller} failed in {failure.case}: {failure.message}", soft_wrap=True, markup=False)
    summary, verdicts = summarise(result.stops), judge(result.stops, table.required_of(braked), result.failures)
    labels = _labels(controllers)
    shown, judged = _labelled(summary, labels), _relabelled(verdicts, labels)
    pictured = ProgrammeResult(
        _labelled(result.stops, labels), _relabelled(result.traces, labels), _relabelled(result.failures, labels)
    )
    written = list(TABLES)

    def report() -> None:
        title = f"{table.name}, {braked.name}, {_counted(draws.number)}"
        try:
            made_from = _origin(braked, stops, draws)
            write_report(out / "report.html", pictured, shown, judged, title, made_from, page)
            written.extend(file.name for file in page.files(out / "report.html"))
        except ModuleNotFoundError as missing:  # the tables do without
            errors.print(f"no report.html: {missing}", markup=False)

    def tell() -> None:
        if json_:
            print(json.dumps(_plain(result, summary, verdicts), indent=2))
        else:
            _print(shown, judged, draws.number)
            print(f"\n{out}/: {', '.join(written)}")

    all_of(*_writers(out, result, summary), report, tell)
    if result.failures:
        sys.exit(1)


def _origin(vehicle: Vehicle, stops: ProgrammeOptions, draws: Draws) -> Origin:
    """Return what the page says of itself: the vehicle, the programme's file with its hash, the draws."""
    digest = hashlib.sha256(stops.programme.read_bytes()).hexdigest()
    drawn = f"{_counted(draws.number)} of each case, seed {draws.seed}"
    return Origin("wsp evaluate", vehicle.name, [(stops.programme.name, digest)], notes=[drawn])


def _counted(draws: int) -> str:
    return "1 draw" if draws == 1 else f"{draws} draws"


def _labels(controllers: tuple[str, ...]) -> dict[str, str]:
    """Return what to call each controller in tables: a file without its folders, where that leaves it unique."""
    short = {name: name.rstrip("/").rpartition("/")[2] for name in controllers}
    return {name: label if list(short.values()).count(label) == 1 else name for name, label in short.items()}


def _labelled(table: polars.DataFrame, labels: Mapping[str, str]) -> polars.DataFrame:
    return table.with_columns(polars.col("controller").replace(labels))


def _relabelled(items: Iterable[Named], labels: Mapping[str, str]) -> tuple[Named, ...]:
    return tuple(dataclasses.replace(item, controller=labels.get(item.controller, item.controller)) for item in items)


def _writers(out: Path, result: ProgrammeResult, summary: polars.DataFrame) -> list[Callable[[], None]]:
    """Return what writes each of `TABLES`."""
    fills: tuple[Callable[[BinaryIO], object], ...] = (
        lambda file: result.stops.write_csv(file),
        lambda file: result.stops.write_parquet(file),
        lambda file: summary.write_csv(file),
    )
    return [functools.partial(write_whole, out / name, fill) for name, fill in zip(TABLES, fills, strict=True)]


def _plain(result: ProgrammeResult, summary: polars.DataFrame, verdicts: tuple[Verdict, ...]) -> object:
    """Return what `--json` prints; a number that is not finite becomes null."""
    document: dict[str, object] = {
        "figures": {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in FIGURES.items()},
        "stops": result.stops.to_dicts(),
        "summary": summary.to_dicts(),
        "verdicts": [vars(verdict) for verdict in verdicts],
        "decided": decided(verdicts),
        "failures": [vars(failure) for failure in result.failures],
    }
    return _finite(document)


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _print(summary: polars.DataFrame, verdicts: tuple[Verdict, ...], draws: int) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=175)
    for columns in range(len(_COLUMNS), _RATIO, -1):  # as many as fit
        table = _stops_table(summary, draws, columns)
        if Console(width=1000).measure(table).maximum <= console.width:
            break
    console.print(table)
    if verdicts:
        console.print(_verdict_table(verdicts))
        console.print("\n".join(decided(verdicts)), markup=False, soft_wrap=True)


def _stops_table(summary: polars.DataFrame, draws: int, columns: int) -> Table:
    """Return the table with the first `columns` of the figures."""
    title = f"Means of {draws} draws; distances with 95 % confidence intervals" if draws > 1 else "1 draw"
    caption = LEFT_LIMIT + ("" if columns == len(_COLUMNS) else "\nmore figures in summary.csv, or in a wider window")
    table = Table(title=title, caption=caption, caption_justify="left")
    for heading in ("case", "law", "controller"):
        table.add_column(heading, no_wrap=True)
    for _, heading, _ in _COLUMNS[:columns]:
        table.add_column(escape(heading), justify="right", no_wrap=True)
    rows = summary.to_dicts()
    seen = list(dict.fromkeys((row["case"], row["law"]) for row in rows if row["controller"] == BOUND))
    for case, law in seen:
        group = [row for row in rows if (row["case"], row["law"]) == (case, law)]
        for i, row in enumerate(group):
            cells = [_cell(row, figure, digits) for figure, _, digits in _COLUMNS]
            if row["stopped"] < row["draws"]:
                cells[0] += f" ({row['draws'] - row['stopped']} ran on)"
            cells[_RATIO] += "*" if row["within_limit"] < row["draws"] else " "
            first = (case, law) if i == 0 else ("", "")
            table.add_row(*map(escape, (*first, row["controller"])), *cells[:columns], end_section=i == len(group) - 1)
    return table


def _cell(row: dict[str, Any], figure: str, digits: int) -> str:
    value = row[figure]
    if value is None or not math.isfinite(value):
        return "" if value is None else "-"
    half = row[f"{figure}_ci"]
    spread = f" ±{half:.{digits}f}" if figure == "distance_m" and math.isfinite(half) else ""
    return f"{value:.{digits}f}{spread}"


def _verdict_table(verdicts: tuple[Verdict, ...]) -> Table:
    table = Table(title="Requirements (worst stop)")
    for heading in ("requirement", "controller", "", "worst", "at most", "where", "mean"):
        table.add_column(heading, no_wrap=True, justify="right" if heading in ("worst", "at most") else "left")
    previous = ""
    for verdict in verdicts:
        mark = "[green]pass[/green]" if verdict.passed else "[red]FAIL[/red]"
        mean = f"{verdict.mean:.4g} of {verdict.mean_at_most:.4g}" if math.isfinite(verdict.mean_at_most) else ""
        name = "" if verdict.requirement == previous else verdict.requirement
        worst = f"{verdict.worst:.4g}" if math.isfinite(verdict.worst) else "-"
        limit = f"{verdict.at_most:.4g} {verdict.unit}".rstrip()
        table.add_row(escape(name), escape(verdict.controller), mark, worst, limit, escape(verdict.where), mean)
        previous = verdict.requirement
    return table
