"""Where S1002 touches UIC60: contact points, rolling radius difference, conicity, and 42 reference cases.

`python -m experiments.contact_geometry [FILE]` writes a page with the figures and the table; `--table` prints the table.
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


def contact_figure(pair: Pair, shifts_mm: np.ndarray) -> Any:
    """Draw both right-hand profiles, wheel lifted, with lines between the points that touch."""
    objects, _ = plotly()
    figure = objects.Figure()
    wheel, rail = pair.wheel, pair.rail
    s = np.linspace(pair.first, pair.last, 800)
    lift = 12.0  # [mm], to keep the profiles apart
    figure.add_scatter(x=(s + pair.taping) * 1e3, y=lift - evaluate(wheel, s)[0] * 1e3, name="wheel S1002, lifted",
                       line={"color": COLOURS[0]})  # fmt: skip
    across, up = _rail_outline(rail, pair)
    figure.add_scatter(x=across, y=up, name="rail UIC60", line={"color": "black"})
    for shift in shifts_mm:
        pose = settled(-shift * 1e-3, 0.0, pair)
        for i, contact in enumerate(one for one in contacts(pose, "right", pair) if one.penetration > -2e-5):
            at = [(contact.at_wheel + pair.taping) * 1e3, abs(contact.y) * 1e3]
            wheel_z = lift - float(evaluate(wheel, contact.at_wheel)[0]) * 1e3
            figure.add_scatter(
                x=at, y=[wheel_z, contact.z * 1e3], mode="lines+markers", showlegend=False, marker={"size": 4},
                line={"color": COLOURS[2 if i == 0 else 1], "width": 1}, hovertext=f"shift {shift:g} mm, contact {i + 1}",
            )  # fmt: skip
    figure.update_yaxes(scaleanchor="x")
    return axes(figure, "lateral position from the middle of the track [mm]", "height over the rails' tops [mm]", height=520)


def _rail_outline(rail: Any, pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    y = np.linspace(rail.breaks[0], rail.breaks[-1], 800)
    z = evaluate(rail, y)[0]
    return (
        (pair.rail_y + y * pair.cosine - z * pair.sine) * 1e3,
        (pair.rail_z + y * pair.sine + z * pair.cosine) * 1e3,
    )


def conicity_figure(pairs: dict[str, Pair], limit_mm: float = 8.0) -> Any:
    """Draw the rolling radius difference and the equivalent conicity of each pair."""
    _, subplots = plotly()
    figure = subplots.make_subplots(1, 2, horizontal_spacing=0.12)
    shifts = np.linspace(-limit_mm, limit_mm, 161) * 1e-3
    amplitudes = np.linspace(0.5, limit_mm - 0.5, 31) * 1e-3
    for colour, (name, pair) in zip(COLOURS, pairs.items(), strict=False):
        differences = rolling_radius_difference(shifts, pair)
        conicity = equivalent_conicity(amplitudes, shifts, differences)
        line = {"color": colour}
        figure.add_scatter(x=shifts * 1e3, y=differences * 1e3, name=name, line=line, row=1, col=1)
        figure.add_scatter(x=amplitudes * 1e3, y=conicity, name=name, line=line, showlegend=False, row=1, col=2)
    axes(figure, "lateral shift to the left [mm]", "rolling radius difference, left less right [mm]", height=420)
    figure.update_xaxes(title_text="amplitude [mm]", row=1, col=2)
    figure.update_yaxes(title_text="equivalent conicity [-]", row=1, col=2)
    return figure


def write(target: Path) -> None:
    """Write the page."""
    cases = compare()
    agree = sum(not case.misses for case in cases)
    wheelset = Wheelset()
    pairs = {f"1:{n}": make_pair(s1002(), uic60(), wheelset, Track(inclination=1.0 / n)) for n in (20, 40)}
    shifts = np.arange(-8.0, 8.01, 0.5)
    sections = [
        Section(
            f"Contact points of the right wheel, rail {name}",
            ["Each line joins a point of the wheel and the point of the rail it touches, for lateral shifts of -8 to 8 mm. "
             "Orange lines: a second contact within 20 um."],
            [contact_figure(pair, shifts)],
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
    else:
        page = Path(sys.argv[1] if len(sys.argv) > 1 else "out/contact_geometry.html")
        write(page)
        print(page)
