"""`wsp demo`: recorded stops, the law tuned on them and validated, a bogie braking under it, a measured creep curve."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.markup import escape
from scipy.optimize import least_squares

from wsp_env.cli.pages import Pages
from wsp_env.contact.kalker import kalker_force
from wsp_env.contact.polach import contact_stiffness, polach_adhesion
from wsp_env.envs.single import BrakingEnv
from wsp_env.evaluation.controller import load
from wsp_env.output import ready
from wsp_env.parameters import eurosprinter
from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.recordings import (
    Campaign,
    Smoothing,
    Tuning,
    demo_campaign,
    derive,
    read_campaign,
    rolling_radii,
    transition,
)
from wsp_env.recordings.origin import origin
from wsp_env.recordings.validation import Validation, validate
from wsp_env.recordings.validation_plots import adhesion_plot, worst
from wsp_env.recordings.validation_report import criteria_table
from wsp_env.report import COLOURS, PageOptions, Section, Table, axes, plotly, terminal_table, write_page

_LAWS = {"recovering": "sliding cleans the rail (lambda by tau)", "classic": "no recovery (lambda = 0)"}


def main(
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/demo.html"),
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "bogie",
    page: Pages = PageOptions(),
) -> None:
    """Read recorded stops, tune the law, validate it, brake a bogie; half a minute at the very first run, then seconds.

    Parameters
    ----------
    out
        The page with interactive plots to write.
    vehicle
        What brakes: a name (wsp vehicle list) or a vehicle file (wsp vehicle show coach > mine.toml). It brakes as hard for its
        weight as the recorded one.
    page
        How the page is written.

    """
    braked = find_vehicle(vehicle)
    plotly()
    ready(*page.files(out))
    console = Console(highlight=False)
    with console.status("reading recorded stops and tuning tau ..."):
        campaign = read_campaign(demo_campaign())
        validation = validate(campaign)
        tuning = validation.tuning
    with console.status("braking with a rule-based WSP under both laws ..."):
        run = campaign.tune[-1]
        pins = {
            "mu_cd": tuning.runs[run].mu_cd,
            "tau": tuning.tau_m_per_J,
            "initial_speed": float(campaign.runs[run].vehicle_speed_mps[0]),
            "demand": 1.0,
            "load": 0.0,
            "gradient": 0.0,
            "track": "constant",
        }
        own = plant_vehicle(campaign.vehicle, campaign.contact, campaign.name)
        share = braked.static_wheel_load_n * braked.wheel_radius_m / (own.static_wheel_load_n * own.wheel_radius_m)
        full_torque_nm = share * float(np.quantile(campaign.runs[run].brake_torque_nm, 0.99))
        stops = {law: brake(law, pins, full_torque_nm, braked) for law in _LAWS}
    with console.status("fitting the measured creep curve ..."):
        curves = creep_curves()
    sections = [
        recorded_section(campaign, tuning),
        validated_section(validation),
        stops_section(stops, run, braked),
        creep_section(curves),
    ]
    for section in sections:
        console.print(f"\n[bold]{escape(section.title)}[/bold]")
        console.print("\n".join(section.text), markup=False)
        for shown in section.shows:
            if isinstance(shown, Table):
                console.print(terminal_table(shown))
    lead = (
        "Recorded stops are read, the recovery rate tau is tuned on some and validated on the others, and a vehicle brakes "
        "under the tuned law."
    )
    made_from = origin("wsp demo", campaign, demo_campaign())
    write_page(out, "wsp-env: what it does, in four pictures", lead, sections, made_from, page)
    console.print(f"\nInteractive plots: [bold]{escape(str(out))}[/bold]")


def brake(law: str, pins: dict[str, Any], full_torque_nm: float, vehicle: Vehicle = BOGIE) -> dict[str, np.ndarray]:
    """Brake a vehicle to standstill with the rule-based WSP, full demand giving a torque per axle [N m].

    Returns the truth of `info` along the stop by name, (T,) or (T, axles).
    """
    stronger = dataclasses.replace(vehicle.brake, torque_per_bar_nm=full_torque_nm / vehicle.brake.full_pressure_bar)
    values = dataclasses.asdict(dataclasses.replace(vehicle, brake=stronger))
    env = gym.make("wsp_env/Bogie-v1", adhesion=law, vehicle=values)
    _, info = env.reset(seed=0, options=pins)
    assert isinstance(env.unwrapped, BrakingEnv)
    batch = env.unwrapped.batch
    protection = load("rule-based")
    protection.reset(1, batch.vehicle)
    truth = []
    ended = False
    while not ended:
        command = protection.act(batch.measurement())
        _, _, terminated, truncated, info = env.step((command[0] + 1).astype(int))
        truth.append({name: value for name, value in info.items() if name != "reward_terms"})
        ended = terminated or truncated
    return {name: np.array([moment[name] for moment in truth]) for name in truth[0]}


@dataclasses.dataclass(frozen=True)
class FittedCurve:
    """A creep curve beside the measured points."""

    name: str
    creepage: np.ndarray  # [-]
    adhesion: np.ndarray  # [-]
    error: float  # root mean square over the points [-]


def creep_curves() -> list[FittedCurve]:
    """Kalker, Polach with constant friction and Polach with falling friction against the Eurosprinter's points.

    The friction of each and, for the last, A, gamma, k_A and k_S are fitted to the points by least squares.
    """
    creepage, adhesion = eurosprinter.measured()
    patch, load_n = eurosprinter.patch(), eurosprinter.NORMAL_LOAD_N
    stiffness = float(contact_stiffness(patch.semi_axis_a, patch.semi_axis_b, patch.shear_modulus, patch.c11))

    def kalker(e: np.ndarray, p: np.ndarray) -> np.ndarray:
        return kalker_force(e, 0.0, 0.0, load_n, p[0], patch)[0] / load_n

    def polach(e: np.ndarray, p: np.ndarray) -> np.ndarray:
        friction, ratio, rate, k_a, k_s = [*p, 1.0, 0.0, 1.0, 1.0] if len(p) == 1 else list(p)
        return np.asarray(polach_adhesion(e, e * eurosprinter.SPEED_MPS, load_n, stiffness, friction, ratio, rate, k_a, k_s))

    one = ([0.3], [0.05], [0.6])  # friction: start, low, high
    all_five = ([0.1, 0.4, 0.5, 0.5, 0.2], [0.01, 0.05, 0.01, 0.01, 0.01], [0.6, 1.0, 5.0, 1.0, 1.0])
    models = (
        ("Kalker's slope, saturated", kalker, *one),
        ("Polach, constant friction", polach, *one),
        ("Polach, falling friction", polach, *all_five),
    )
    grid = np.linspace(0.0, creepage.max(), 400)
    curves = []
    for name, model, start, low, high in models:
        fit = least_squares(lambda p, model=model: model(creepage, p) - adhesion, start, bounds=(low, high))
        curves.append(FittedCurve(name, grid, model(grid, fit.x), float(np.sqrt(np.mean(fit.fun**2)))))
    return curves


def recorded_section(campaign: Campaign, tuning: Tuning) -> Section:
    """Show what the recorded stops say: lambda over W_sp with the tuned curve, the errors e_j."""
    objects, _ = plotly()
    figure = objects.Figure()
    radii = rolling_radii(campaign)
    largest = 0.0
    for index, (name, score) in enumerate(tuning.runs.items()):
        derived = derive(campaign, campaign.runs[name], radii, Smoothing())
        energy = derived.energy_jpm[derived.usable]
        recovered = transition(derived, score.mu_cd, campaign.contact.law)[derived.usable]
        largest = max(largest, float(energy.max()))
        thin = slice(None, None, max(1, len(energy) // 800))
        marker = {"size": 3, "color": COLOURS[index], "opacity": 0.5}
        label = f"{name} ({score.group})"
        figure.add_scatter(x=energy[thin], y=recovered[thin], mode="markers", name=label, marker=marker)
    grid = np.linspace(0.0, largest, 200)
    law = 1.0 - np.exp(-tuning.tau_m_per_J * grid)
    figure.add_scatter(x=grid, y=law, mode="lines", name="1 - exp(-tau W_sp)", line={"color": "black", "width": 3})
    figure.update_layout(legend_itemsizing="constant")
    axes(figure, "specific dissipated energy W_sp [J/m]", "transition function lambda [-]", height=460)
    header = ("run", "group", "mu_cd [-]", *(f"e_{k + 1} [%]" for k in range(campaign.vehicle.axles)))
    rows = [
        (name, score.group, f"{score.mu_cd:.4f}", *("no slide" if e is None else f"{100 * e:.2f}" for e in score.error))
        for name, score in tuning.runs.items()
    ]
    low, high = tuning.interval95
    text = (
        f"{len(tuning.runs)} stops of a four-axle coach, recorded in an independent simulator, give "
        f"tau = {tuning.tau_m_per_J:.3e} m/J (95 % interval {low:.3e} to {high:.3e}), tuned on {', '.join(campaign.tune)} "
        f"and only scored on {', '.join(campaign.validate)}.",
    )
    table = Table(header, rows, "relative error of the adhesion coefficient per axle, as the seed paper's Table 4")
    return Section("Recorded stops, and the law tuned on them", text, (table, figure))


def validated_section(validation: Validation) -> Section:
    """Show the law against the runs it was not tuned on: the paper's figures, and the axle that fits worst."""
    text = [validation.verdict]
    shows: list[Any] = [criteria_table(validation)]
    if (shown := worst(validation)) is not None:
        text.append(f"The worst fit of all held-out axles: run {shown.run}, axle {shown.axle + 1}.")
        shows.append(adhesion_plot(validation, shown.run, shown.axle, height=430))
    return Section("The tuned law, validated on stops it has not seen", text, shows)


def stops_section(stops: dict[str, dict[str, np.ndarray]], run: str, vehicle: Vehicle) -> Section:
    """Compare the two laws over one stop: speeds, adhesion of the leading axle with its limits."""
    objects, subplots = plotly()
    figure = subplots.make_subplots(
        rows=2, cols=2, shared_xaxes=True, shared_yaxes="rows", subplot_titles=list(_LAWS.values()), vertical_spacing=0.06
    )
    for column, (law, stop) in enumerate(stops.items(), start=1):
        wheel = stop["speed_mps"][:, None] - stop["slip_speed_mps"]
        lines = (
            (1, "leading wheelset", wheel[:, 0], COLOURS[5]),
            *([(1, "trailing wheelset", wheel[:, -1], COLOURS[4])] if vehicle.axles > 1 else []),
            (1, "vehicle", stop["speed_mps"], COLOURS[6]),
            (2, "f_r, fully recovered", stop["adhesion_r"][:, 0], COLOURS[2]),
            (2, "f_d, degraded", stop["adhesion_d"][:, 0], COLOURS[1]),
            (2, "f, leading wheelset", stop["adhesion"][:, 0], COLOURS[0]),
        )
        for row, name, values, colour in lines:
            line = {"color": colour, "width": 1.6}
            figure.add_trace(
                objects.Scatter(
                    x=stop["time_s"], y=values, name=name, line=line, legendgroup=name, showlegend=law == "recovering"
                ),
                row=row,
                col=column,
            )
    axes(figure, "", "", height=640)
    figure.update_xaxes(title_text="time [s]", row=2)
    figure.update_yaxes(title_text="speed [m/s]", row=1, col=1)
    figure.update_yaxes(title_text="adhesion coefficient [-]", row=2, col=1)
    header = ("law", "stopping distance [m]", "time [s]", "mean slip speed [m/s]", "locked [s]", "air used [Nl]")
    rows = []
    for law, stop in stops.items():
        step = float(stop["time_s"][0])
        figures = (
            f"{stop['position_m'][-1]:.0f}",
            f"{stop['time_s'][-1]:.1f}",
            f"{stop['slip_speed_mps'].mean():.2f}",
            f"{stop['locked'].any(axis=1).sum() * step:.1f}",
            f"{stop['air_nl'][-1]:.0f}",
        )
        rows.append((law, *figures))
    distance = {law: stop["position_m"][-1] for law, stop in stops.items()}
    saved = 1.0 - distance["recovering"] / distance["classic"]
    text = (
        f"The {vehicle.name} under the conditions of run {run} and as hard a brake, with the rule-based WSP. "
        f"Recovery by sliding makes this stop {100 * saved:.1f} % shorter.",
    )
    return Section(
        f"The {vehicle.name} brakes under the tuned law, with and without recovery", text, (Table(header, rows), figure)
    )


def creep_section(curves: list[FittedCurve]) -> Section:
    """Show the measured points of the Eurosprinter and what three laws make of them."""
    objects, _ = plotly()
    creepage, adhesion = eurosprinter.measured()
    figure = objects.Figure()
    marker = {"color": "#888", "size": 5}
    figure.add_scatter(x=100 * creepage, y=adhesion, mode="markers", name="measured (Engel et al. 1998)", marker=marker)
    for index, curve in enumerate(curves):
        line = {"color": COLOURS[index], "width": 2.5}
        figure.add_scatter(x=100 * curve.creepage, y=curve.adhesion, mode="lines", name=curve.name, line=line)
    axes(figure, "creepage [%]", "adhesion coefficient [-]", height=460)
    rows = [(curve.name, f"{curve.error:.4f}") for curve in curves]
    table = Table(("law", "rms error [-]"), rows, "each fitted to the points by least squares")
    text = (
        "Points measured on a Siemens Eurosprinter locomotive at 10 m/s. With Kalker's slope and a constant friction "
        "coefficient a law rises too steeply and does not fall with the slip speed; reduction factors and falling friction "
        "correct both.",
    )
    return Section("A measured creep curve, and three laws", text, (table, figure))
