"""`wsp compare`: the same stop with and without recovery of adhesion."""

import json
import math
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape

from wsp_env.cli.out import OutFile
from wsp_env.cli.pages import Pages
from wsp_env.cli.plant_options import PhysicsOptions
from wsp_env.evaluation.compare import PARTED_MPS, Comparison, StopOptions, compare
from wsp_env.evaluation.controller import read_settings
from wsp_env.evaluation.runner import ControllerFailure
from wsp_env.executor import Processes
from wsp_env.output import OutputError, ready
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.parameters.velim import TAU_M_PER_J
from wsp_env.report import COLOURS, Origin, PageOptions, Section, Table, axes, plotly, terminal_table, write_page


def main(
    controller: str = "rule-based",
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "coach",
    mu_cd: tuple[float, ...] = (0.015, 0.02, 0.03, 0.04),
    tau: tuple[float, ...] = (0.95e-4, TAU_M_PER_J, 3.8e-4),
    stop: Annotated[StopOptions, tyro.conf.arg(name="")] = StopOptions(),
    plant: Annotated[PhysicsOptions, tyro.conf.arg(name="")] = PhysicsOptions(),
    set: tuple[str, ...] = (),
    out: OutFile = Path("out/compare.html"),
    page: Pages = PageOptions(),
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Brake the same stop under the classic and the recovering law (the seed paper's Fig. 16), over mu_cd and tau.

    Prints where the two part and the distance gained; writes a page.

    Parameters
    ----------
    controller
        As for `wsp evaluate`.
    vehicle
        A name (wsp vehicle list) or a vehicle file (wsp vehicle show coach > mine.toml).
    mu_cd
        Kinetic friction coefficients of the contaminated rail [-].
    tau
        Recovery rates [m/J], above 0.
    stop
        The stop.
    plant
        What computes the vehicle's motion.
    set
        Parameters of the controller, as rule-based.slip_base_mps=0.4.
    out
        The page.
    page
        How the page is written.
    json_
        Print the table as JSON.

    """
    braked = plant.on(find_vehicle(vehicle))
    plant.check(braked)
    if not mu_cd or not tau or min(tau) <= 0.0:
        raise ParameterError("give at least one --mu-cd and one --tau, each tau above 0: the classic law is run anyway")
    parameters = read_settings((controller,), set)[controller]
    ready(*page.files(out))
    try:
        conduct = plant.conduct()
        with Console(stderr=True).status(f"{escape(controller)} brakes"):
            result = compare(
                controller, braked, mu_cd, tau, stop, conduct=conduct, parameters=parameters, executor=Processes(1)
            )
    except ControllerFailure as failure:
        raise ParameterError(str(failure)) from None
    title = f"{controller} on the {braked.name} from {stop.speed:g} m/s, demand {stop.demand:g}"
    table = _table(result)
    written = True
    try:
        _page(out, title, result, table, page)
    except (ModuleNotFoundError, OutputError) as missing:  # the table does without
        Console(stderr=True).print(f"no page: {missing}", markup=False)
        written = False
    if json_:
        pairs = [{k: v if math.isfinite(v) else None for k, v in vars(pair).items()} for pair in result.pairs]
        print(json.dumps({"stop": title, "parted_mps": PARTED_MPS, "pairs": pairs}, indent=2))
        return
    console = Console()
    console = console if console.is_terminal else Console(width=150)
    console.print(title, markup=False)
    console.print(terminal_table(table))
    if written:
        print(f"\n{out}")


def _table(result: Comparison) -> Table:
    header = (
        "friction mu_cd [-]", "recovery rate tau [1e-4 m/J]", "classic [m]", "recovering [m]", "gained [m]", "gained [%]",
        "parted at [m/s]", "after [s]", "largest gap [m/s]", "mean slip classic [m/s]", "mean slip recovering [m/s]",
    )  # fmt: skip
    rows = []
    for pair in result.pairs:
        metres = [
            _cell(getattr(pair, f"{name}_m"), 0) + _scatter(getattr(pair, f"{name}_ci_m"))
            for name in ("classic", "recovering", "gained")
        ]
        parted = (pair.parted_mps, pair.parted_s, pair.largest_gap_mps, pair.classic_slip_mps, pair.recovering_slip_mps)
        cells = map(_cell, (100.0 * pair.gained_share, *parted), (1, 1, 1, 2, 2, 2))
        rows.append((f"{pair.mu_cd:g}", f"{1e4 * pair.tau:.3g}", *metres, *cells))
    said = f"parted: the speeds at the same time differ by more than {PARTED_MPS:g} m/s"
    return Table(header, rows, said + "; ±: 95 % interval of the mean over the draws, differences draw by draw")


def _rate(tau: float) -> str:
    return f"recovery rate tau {1e4 * tau:.3g}e-4 m/J"


def _scatter(half: float) -> str:
    return f" ±{half:.0f}" if math.isfinite(half) else ""


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _page(path: Path, title: str, result: Comparison, table: Table, options: PageOptions) -> None:
    objects, subplots = plotly()
    rates = list(dict.fromkeys(pair.tau for pair in result.pairs))
    frictions = list(result.classic)
    speeds = subplots.make_subplots(
        rows=len(frictions),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        subplot_titles=[f"friction mu_cd {f:g}" for f in frictions],
    )
    for number, friction in enumerate(frictions, start=1):
        curves = [("classic law", result.classic[friction], "black")]
        curves += [(_rate(rate), result.recovering[friction, rate], COLOURS[i]) for i, rate in enumerate(rates)]
        for name, speed, colour in curves:
            line = {"color": colour, "width": 1.8}
            end = int((speed > 0.0).sum()) + 1
            trace = objects.Scatter(
                x=result.time[:end:10], y=speed[:end:10], name=name, legendgroup=name, showlegend=number == 1, line=line
            )
            speeds.add_trace(trace, row=number, col=1)
    axes(speeds, "", "speed [m/s]", height=120 + 230 * len(frictions))
    speeds.update_xaxes(title_text="time [s]", row=len(frictions))
    gained = objects.Figure()
    for i, rate in enumerate(rates):
        own = [pair for pair in result.pairs if pair.tau == rate]
        line = {"color": COLOURS[i]}
        gained.add_scatter(
            x=[p.mu_cd for p in own],
            y=[p.gained_m for p in own],
            mode="lines+markers",
            name=_rate(rate),
            line=line,
        )
    axes(gained, "friction of the degraded rail mu_cd [-]", "distance gained by recovery [m]", height=420)
    sections = [
        Section("", (), [gained]),
        Section("Distances", (), [table], fold=True),
        Section("Running speed under both laws", ("The paper's Fig. 16, over the grid.",), [speeds], fold=True),
    ]
    lead = "The same stop with and without the recovery of adhesion that sliding brings: all else is equal."
    write_page(path, title, f"{lead} {_headline(result)}", sections, Origin("wsp compare"), options)


def _headline(result: Comparison) -> str:
    """Say in a sentence what recovery is worth."""
    gains = [pair for pair in result.pairs if math.isfinite(pair.gained_m)]
    if not gains:
        return "Not every stop ended, so no distance can be compared."
    least, most = (pick(gains, key=lambda pair: pair.gained_m) for pick in (min, max))
    return (
        f"Recovery changes the stopping distance by {-most.gained_m:+.0f} m (mu_cd {most.mu_cd:g}) to {-least.gained_m:+.0f} m "
        f"(mu_cd {least.mu_cd:g}) over this grid."
    )
