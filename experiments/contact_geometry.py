"""Where S1002 touches UIC60: contact points, rolling radius difference, conicity, and 42 reference cases.

`python -m experiments.contact_geometry [FILE]` writes a page with the figures and the table. `--table` prints the
table, `--pictures` draws the pictures of the documentation.
"""

import csv
import io
import sys
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wsp_env.contact.geometry.centre import centred
from wsp_env.contact.geometry.conicity import equivalent_conicity, rolling_radius_difference
from wsp_env.contact.geometry.detect import scan
from wsp_env.contact.geometry.equilibrium import SIDES, Pressed, contacts, loaded, settled
from wsp_env.contact.geometry.patch import PatchTable, make_patch_table
from wsp_env.contact.geometry.port import Contact, Pair, Pose, empty_contacts
from wsp_env.contact.geometry.profile import evaluate
from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair
from wsp_env.report import COLOURS, Section, Table, axes, plotly, write_page

#: Limits within which a case agrees: position [mm], normal force and peak pressure [-].
POSITION_MM, SHARE = 0.2, 0.03
#: In the pictures: lateral shifts, how far the wheel is lifted, and the gap of a second contact that is drawn.
SHIFTS_MM, LIMIT_MM, LIFT_M, NEARLY_M = np.arange(-8.0, 8.01, 0.5), 8.0, 12e-3, 2e-5


class Case(NamedTuple):
    """One wheel of a reference case beside what is computed here; several contacts count as one by their loads."""

    side: str
    shift_mm: float
    position_mm: float  # centre of load, across the track, from the middle of the track outwards
    reference_position_mm: float
    normal_n: float
    reference_normal_n: float
    pressure_mpa: float
    reference_pressure_mpa: float
    contacts: int

    @property
    def misses(self) -> list[str]:
        """Return which of the limits it misses."""
        found = []
        if abs(self.position_mm - self.reference_position_mm) > POSITION_MM:
            found.append(f"position by {self.position_mm - self.reference_position_mm:+.2f} mm")
        for name, value, reference in (
            ("normal force", self.normal_n, self.reference_normal_n),
            ("peak pressure", self.pressure_mpa, self.reference_pressure_mpa),
        ):
            if abs(value / reference - 1.0) > SHARE:
                found.append(f"{name} by {value / reference - 1.0:+.1%}")
        return found


def manchester_pair() -> tuple[Pair, PatchTable]:
    """Return wheel and rail of the benchmark: r 460 mm, rails 1:40, G 82 GPa, Poisson's ratio 0.28."""
    pair = make_pair(s1002(), uic60(), Wheelset(radius_m=0.46), Track(inclination=1.0 / 40.0))
    return pair, make_patch_table(2.0 * 82e9 * 1.28, 0.28)


def reference_rows() -> list[dict[str, str]]:
    """Return the rows of the reference table, `wsp_env/data/manchester_contact_a22.csv`."""
    return list(csv.DictReader(io.StringIO((files("wsp_env") / "data" / "manchester_contact_a22.csv").read_text())))


def compare() -> list[Case]:
    """Return the 42 wheels of the Manchester contact benchmark, A-2.2, with 10 kN each and friction 0.3.

    The reference's frame has y to the right and z down: shift and yaw change sign.
    """
    pair, table = manchester_pair()
    cases: dict[tuple[str, float], Case] = {}
    rows = reference_rows()
    for shift in sorted({float(row["lateral_shift_mm"]) for row in rows}):
        yaw = next(float(row["yaw_rad"]) for row in rows if float(row["lateral_shift_mm"]) == shift)
        pose, wheels = loaded(-shift * 1e-3, -yaw, 10e3, 0.3, pair, table)
        for row in rows:
            if float(row["lateral_shift_mm"]) == shift:
                wheel = wheels[list(SIDES).index(row["side"])]
                cases[row["side"], shift] = _case(row, pose, wheel, pair)
    return [cases[row["side"], float(row["lateral_shift_mm"])] for row in rows]


def _case(row: dict[str, str], pose: Pose, wheel: list[Pressed], pair: Pair) -> Case:
    found, centre = empty_contacts(), empty_contacts()
    scan(pose, SIDES[row["side"]], pair, found)
    places = []
    for i in range(len(wheel)):
        centred(pose, SIDES[row["side"]], pair, found, i, centre)
        places.append(abs(Contact(*map(float, centre[0])).y) * 1e3)
    normal = sum(one.normal for one in wheel)
    position = sum(one.normal * place for one, place in zip(wheel, places, strict=True)) / normal
    return Case(
        row["side"], float(row["lateral_shift_mm"]), position, abs(float(row["track_y_mm"])), normal,
        float(row["normal_force_N"]), max(one.max_pressure for one in wheel) / 1e6, float(row["peak_pressure_MPa"]), len(wheel),
    )  # fmt: skip


def table_rows(cases: Iterable[Case]) -> list[list[str]]:
    """Return the rows of the table of the docs."""
    return [
        [
            case.side, f"{case.shift_mm:g}", f"{case.position_mm:.2f}", f"{case.reference_position_mm:.2f}",
            f"{case.normal_n / 1e3:.2f}", f"{case.reference_normal_n / 1e3:.2f}", f"{case.pressure_mpa:.0f}",
            f"{case.reference_pressure_mpa:.0f}", str(case.contacts), "; ".join(case.misses) or "agrees",
        ]
        for case in cases
    ]  # fmt: skip


HEADER = ("wheel", "shift [mm]", "y [mm]", "reference", "N [kN]", "reference", "p0 [MPa]", "reference", "contacts", "verdict")


class Joined(NamedTuple):
    """A point of the wheel and the point of the rail that it touches, in the picture of the centred, lifted wheel [mm]."""

    shift: float
    y: tuple[float, float]
    z: tuple[float, float]
    first: bool  # the deepest contact of its wheel


def outlines(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Return the right-hand wheel, lifted, and rail in the track's frame, y outwards and z up, shapes (2, 800) [mm]."""
    s = np.linspace(pair.first, pair.last, 800)
    y = np.linspace(pair.rail.breaks[0], pair.rail.breaks[-1], 800)
    z = evaluate(pair.rail, y)[0]
    across, up = y * pair.cosine - z * pair.sine, y * pair.sine + z * pair.cosine
    wheel = np.array([s + pair.taping, LIFT_M - evaluate(pair.wheel, s)[0]])
    return wheel * 1e3, np.array([pair.rail_y + across, pair.rail_z + up]) * 1e3


def joined_points(pair: Pair, shifts_mm: np.ndarray) -> list[Joined]:
    """Return the contacts of the right-hand wheel at lateral shifts to the right."""
    found = []
    for shift in shifts_mm:
        touching = contacts(settled(-shift * 1e-3, 0.0, pair), "right", pair)
        for i, one in enumerate(c for c in touching if c.penetration > -NEARLY_M):
            wheel_z = LIFT_M - float(evaluate(pair.wheel, one.at_wheel)[0])
            y = ((one.at_wheel + pair.taping) * 1e3, abs(one.y) * 1e3)
            found.append(Joined(float(shift), y, (wheel_z * 1e3, one.z * 1e3), i == 0))
    return found


def contact_figure(pair: Pair, shifts_mm: np.ndarray) -> Any:
    """Draw both right-hand profiles, wheel lifted, with lines between the points that touch."""
    objects, _ = plotly()
    figure = objects.Figure()
    wheel, rail = outlines(pair)
    figure.add_scatter(x=wheel[0], y=wheel[1], name="wheel S1002, lifted", line={"color": COLOURS[0]})
    figure.add_scatter(x=rail[0], y=rail[1], name="rail UIC60", line={"color": "black"})
    for one in joined_points(pair, shifts_mm):
        figure.add_scatter(
            x=one.y, y=one.z, mode="lines+markers", showlegend=False, marker={"size": 4},
            line={"color": COLOURS[2 if one.first else 1], "width": 1}, hovertext=f"shift {one.shift:g} mm",
        )  # fmt: skip
    figure.update_yaxes(scaleanchor="x")
    return axes(figure, "lateral position from the middle of the track [mm]", "height over the rails' tops [mm]", height=520)


def conicities(pair: Pair) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return shifts and rolling radius differences [mm], amplitudes [mm] and equivalent conicities [-]."""
    shifts = np.linspace(-LIMIT_MM, LIMIT_MM, 161) * 1e-3
    amplitudes = np.linspace(1.0, LIMIT_MM - 0.5, 27) * 1e-3
    differences = rolling_radius_difference(shifts, pair)
    return shifts * 1e3, differences * 1e3, amplitudes * 1e3, equivalent_conicity(amplitudes, shifts, differences)


def conicity_figure(pairs: dict[str, Pair]) -> Any:
    """Draw the rolling radius difference and the equivalent conicity of each pair."""
    _, subplots = plotly()
    figure = subplots.make_subplots(1, 2, horizontal_spacing=0.12)
    for colour, (name, pair) in zip(COLOURS, pairs.items(), strict=False):
        shifts, differences, amplitudes, conicity = conicities(pair)
        line = {"color": colour}
        figure.add_scatter(x=shifts, y=differences, name=name, line=line, row=1, col=1)
        figure.add_scatter(x=amplitudes, y=conicity, name=name, line=line, showlegend=False, row=1, col=2)
    axes(figure, "lateral shift to the left [mm]", "radius left less right [mm]", height=420)
    figure.update_xaxes(title_text="amplitude [mm]", row=1, col=2)
    figure.update_yaxes(title_text="equivalent conicity [-]", row=1, col=2)
    return figure


def draw(pairs: dict[str, Pair]) -> tuple[Any, Any]:
    """Return the same two figures for the documentation, as matplotlib draws them."""
    from matplotlib.figure import Figure

    points = Figure(figsize=(10, 3.0), dpi=100, layout="constrained")
    for axis, (name, pair) in zip(points.subplots(1, len(pairs), sharey=True), pairs.items(), strict=True):
        for outline, colour in zip(outlines(pair), ("C0", "black"), strict=True):
            axis.plot(*outline, color=colour)
        for one in joined_points(pair, SHIFTS_MM):
            axis.plot(one.y, one.z, color="C2" if one.first else "C1", linewidth=0.7, marker=".", markersize=3)
        axis.set(title=f"right wheel (lifted), rail {name}", xlabel="lateral position [mm]", aspect="equal")
    points.axes[0].set_ylabel("height [mm]")
    rolling = Figure(figsize=(10, 3.6), dpi=100, layout="constrained")
    left, right = rolling.subplots(1, 2)
    for name, pair in pairs.items():
        shifts, differences, amplitudes, conicity = conicities(pair)
        left.plot(shifts, differences, label=f"rail {name}")
        right.plot(amplitudes, conicity, label=f"rail {name}")
    left.set(xlabel="lateral shift to the left [mm]", ylabel="radius left less right [mm]")
    right.set(xlabel="amplitude [mm]", ylabel="equivalent conicity [-]", ylim=(0.0, 1.0))
    left.legend()
    for axis in (left, right):
        axis.grid(alpha=0.3)
    return points, rolling


def coach_pairs() -> dict[str, Pair]:
    """Return the coach's wheels, r 445 mm, on rails 1:20 and 1:40."""
    return {f"1:{n}": make_pair(s1002(), uic60(), Wheelset(), Track(inclination=1.0 / n)) for n in (20, 40)}


def write(target: Path) -> None:
    """Write the page."""
    cases = compare()
    agree = sum(not case.misses for case in cases)
    pairs = coach_pairs()
    sections = [
        Section(
            f"Contact points of the right wheel, rail {name}",
            ["Each line joins a point of the wheel and the point of the rail it touches, for lateral shifts of -8 to 8 mm. "
             "Orange lines: a second contact within 20 um."],
            [contact_figure(pair, SHIFTS_MM)],
        )
        for name, pair in pairs.items()
    ]  # fmt: skip
    sections += [
        Section("Rolling radius difference and equivalent conicity", ["Rigid wheelset of r 445 mm, gauge 1435 mm, no yaw."],
                [conicity_figure(pairs)]),
        Section("Manchester contact benchmark, A-2.2",
                [f"{agree} of {len(cases)} cases agree within {POSITION_MM:g} mm, and {SHARE:.0%} in force and pressure."],
                [Table(HEADER, table_rows(cases))]),
    ]  # fmt: skip
    write_page(target, "Wheel-rail contact geometry", "S1002 on UIC60: where they touch, how they roll.", sections)


if __name__ == "__main__":
    if "--table" in sys.argv[1:]:
        print("\n".join("| " + " | ".join(cells) + " |" for cells in [list(HEADER), *table_rows(compare())]))
    elif "--pictures" in sys.argv[1:]:
        for name, figure in zip(("points", "rolling"), draw(coach_pairs()), strict=True):
            figure.savefig(f"docs/contact_{name}.png")
    else:
        page = Path(sys.argv[1] if len(sys.argv) > 1 else "out/contact_geometry.html")
        write(page)
        print(page)
