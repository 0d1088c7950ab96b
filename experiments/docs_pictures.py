"""The pictures of the documentation's pages: what commands write, and what a page speaks of.

`python experiments/docs_pictures.py [NAME ...]` writes docs/NAME.png, by default all of them. Pages are taken by a headless
Chromium, curves are drawn by matplotlib.
"""

import contextlib
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from wsp_env.cli import main as wsp
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.programme import Draws, draw_stops, read_programme, select_cases
from wsp_env.evaluation.runner import run
from wsp_env.parameters.uic_z1 import BOGIE, VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.velim import CONTACT, TAU_M_PER_J
from wsp_env.recordings import concealed_campaign, demo_campaign
from wsp_env.recordings.creep_curves import eurosprinter_curve
from wsp_env.report import COLOURS
from wsp_env.report.paper import browser

DOCS = Path(__file__).parents[1] / "docs"
_WIDTH_PX = 1100
_COLOURS_KEPT = 256  # of a picture: flat areas and thin lines need no more
_PATIENCE_S = 600.0


def page(name: str, file: Path, height_px: int) -> None:
    """Take a picture of a page's beginning."""
    found = browser()
    assert found is not None, "needs Chromium or Google Chrome"
    with tempfile.TemporaryDirectory() as profile:
        command = [
            found, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking",
            f"--user-data-dir={profile}", "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=20000",
            f"--window-size={_WIDTH_PX},{height_px}", f"--screenshot={DOCS / f'{name}.png'}", file.resolve().as_uri(),
        ]  # fmt: skip
        subprocess.run(command, capture_output=True, timeout=_PATIENCE_S, check=True)
    _in_few_colours(DOCS / f"{name}.png")


def _in_few_colours(file: Path) -> None:
    from PIL import Image

    with Image.open(file) as picture:
        picture.convert("RGB").quantize(_COLOURS_KEPT, dither=Image.Dither.NONE).save(file, optimize=True)


def drawn(name: str, figure: Figure) -> None:
    """Write a figure."""
    figure.savefig(DOCS / f"{name}.png", dpi=100)
    _in_few_colours(DOCS / f"{name}.png")


def done(*words: object) -> None:
    """Run a command of wsp."""
    assert wsp([str(word) for word in words]) == 0, words


def repaired(place: Path) -> None:
    """Show signals of a campaign with a gap and a spike."""
    import polars as pl

    folder = place / "repaired"
    folder.mkdir()
    for file in (demo_campaign() / name for name in ("A5.csv", "B2.csv")):
        table = pl.read_csv(file)
        row = pl.int_range(pl.len())
        wheel = pl.col("axle2_wheel_speed_radps").cast(pl.Float64)
        start = table.height // 3
        gap = pl.when((row >= start) & (row < start + 25)).then(None).otherwise(wheel)
        table.with_columns(gap.alias("axle2_wheel_speed_radps")).write_csv(folder / file.name)
    done("inspect", folder, "--vehicle", "coach", "--standalone")
    page("signals_repaired", folder / "signals.html", 900)


def creep(place: Path) -> None:
    """Show measured creep curves and what they lack."""
    done("diagnose", eurosprinter_curve(), "--out", place / "creep", "--standalone")
    page("creep_report", place / "creep" / "report.html", 860)


def compared(place: Path) -> None:
    """Show two campaigns side by side."""
    out = place / "compared"
    done("compare-campaigns", demo_campaign(), concealed_campaign(), "--tuned-only", "--out", out, "--standalone")
    (found,) = out.glob("*.html")
    page("compared", found, 820)


def evaluated(place: Path) -> None:
    """Show controllers in the programme."""
    names = ("none", "rule-based", "adaptive")
    cases = ("low-120", "low-160", "patches-160", "change-up-160", "change-down-160")
    options = ["--vehicle", "bogie", "--cases", *cases, "--draws", "2", "--out", place / "evaluate", "--standalone"]
    done("evaluate", "--controllers", *names, *options)
    page("evaluated", place / "evaluate" / "report.html", 860)


def rendering(place: Path) -> None:
    """Show a stop as an environment draws it."""
    from PIL import Image

    env = gym.make("wsp_env/Bogie-v1", render_mode="rgb_array")
    env.reset(seed=3, options={"mu_cd": 0.03, "tau": 2e-4, "demand": 1.0, "track": "constant"})
    controller = load("rule-based")
    controller.reset(1, BOGIE)
    ended = False
    while not ended:
        batch = env.unwrapped.batch  # type: ignore[attr-defined]  # gymnasium: any environment
        _, _, terminated, truncated, _ = env.step(controller.act(batch.measurement())[0].astype(int) + 1)
        ended = terminated or truncated
    Image.fromarray(env.render()).save(DOCS / "rendering.png")  # type: ignore[arg-type]  # rgb_array: an array
    _in_few_colours(DOCS / "rendering.png")


def controllers(place: Path) -> None:
    """Draw the same stop under four controllers."""
    programme = read_programme()
    (case,) = select_cases(programme, BOGIE, ["low-120"])
    stops = draw_stops(case, programme, BOGIE, Draws(1, seed=0)).stops
    figure = Figure(figsize=(10, 5.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    for axis, name in zip(panels, ("none", "rule-based", "extremum", "adaptive"), strict=True):
        found = run(load(name), BOGIE, list(stops))
        last = 1  # the recovering law
        moving = slice(int(found.steps[last]) + 1)
        time_s = found.time[moving]
        axis.plot(time_s, 3.6 * found.speed[moving, last], color="black", linewidth=1.6, label="vehicle")
        for k in range(BOGIE.axles):
            wheel = 3.6 * (found.speed[moving, last] - found.slip[moving, last, k])
            axis.plot(time_s, wheel, color=COLOURS[k], linewidth=0.9, label=f"wheel, axle {k + 1}")
        axis.set_title(f"{name}: {found.distance[last]:.0f} m", fontsize=10)
        axis.grid(alpha=0.3)
    for axis in panels[2:]:
        axis.set_xlabel("time [s]")
    for axis in panels[::2]:
        axis.set_ylabel("speed [km/h]")
    panels[0].legend(fontsize=8)
    drawn("controllers", figure)


def vehicles(place: Path) -> None:
    """Draw where the named vehicles carry their axles."""
    shown: dict[str, Vehicle] = {name: one for name, one in VEHICLES.items() if one.axles <= 8}
    figure = Figure(figsize=(10, 1.3 * len(shown)), layout="constrained")
    for axis, (name, one) in zip(figure.subplots(len(shown), 1, sharex=True), shown.items(), strict=True):
        at = np.asarray(one.axle_positions_m)
        axis.axhline(0.0, color="#999", linewidth=1.0)
        for x in at:
            circle = np.linspace(0.0, 2.0 * np.pi, 60)
            radius = one.wheel_radius_m
            axis.plot(x + radius * np.cos(circle), radius + radius * np.sin(circle), color=COLOURS[0])
        low, high = float(at.min()), float(at.max())
        axis.fill_between([low - 1.5, high + 1.5], 1.0, 2.2, color="#cfd8e0")
        axis.set_title(f"{name}, {one.mass_kg / 1e3:.1f} t", loc="left", fontsize=9)
        axis.set_yticks([])
        axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("behind the leading axle [m]")
    drawn("vehicles", figure)


def exchanged(place: Path) -> None:
    """Draw two sensors whose wires are exchanged: the torque is taken from one wheel, and the other one turns faster."""
    import polars as pl

    table = pl.read_csv(demo_campaign() / "A5.csv")  # in which a WSP works
    table = table.filter(pl.col("time_s").is_between(8.0, 14.0))
    time = table["time_s"].to_numpy()
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, (title, wheels) in enumerate((("as recorded", (1, 2)), ("wheels 1 and 2 exchanged", (2, 1)))):
        for row, (what, label) in enumerate((("wheel_speed_radps", "wheel [rad/s]"), ("brake_torque_nm", "torque [kN m]"))):
            axis = panels[row, column]
            for own, source in zip((1, 2), wheels if row == 0 else (1, 2), strict=True):
                scale = 1.0 if row == 0 else 1e-3
                values = scale * table[f"axle{source}_{what}"].to_numpy()
                axis.plot(time, values, color=COLOURS[own - 1], linewidth=1.0, label=f"channel of axle {own}")
            axis.set_ylabel(label)
            axis.grid(alpha=0.3)
        panels[0, column].set_title(title, fontsize=10)
        panels[1, column].set_xlabel("time [s]")
    panels[0, 0].legend(fontsize=8, loc="lower left")
    drawn("exchanged", figure)


def drive_it(place: Path) -> None:
    """Draw the simulator of docs/drive_it.md while it runs."""
    text = _block("drive_it.md")
    course: list[tuple[float, ...]] = []
    begins = "    v, way, tick = v -"
    assert begins in text
    kept = "    course.append((tick * h, v, *(radius * omega)))\n"
    exec(text.replace(begins, kept + begins), {"course": course})
    rows = np.array(course)
    figure = Figure(figsize=(10, 3.4), layout="constrained")
    axis = figure.subplots()
    axis.plot(rows[:, 0], rows[:, 1], color="black", linewidth=1.8, label="vehicle")
    for k in range(rows.shape[1] - 2):
        axis.plot(rows[:, 0], rows[:, 2 + k], color=COLOURS[k], linewidth=1.0, label=f"wheel {k + 1}, circumference")
    axis.set_xlabel("time [s]")
    axis.set_ylabel("speed [m/s]")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    drawn("drive_it", figure)


def laws(place: Path) -> None:
    """Draw adhesion over slip, by the law of the seed paper and the classic one."""
    slip, speed = np.linspace(0.0, 6.0, 400), 20.0
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    axis = figure.subplots()
    for tau, words, colour in ((TAU_M_PER_J, "recovering", COLOURS[2]), (0.0, "classic (tau = 0)", COLOURS[1])):
        axis.plot(slip, degraded_adhesion(slip, speed, 53e3, 0.06, tau, CONTACT.law), color=colour, label=words)
    axis.set_xlabel("slip v - r w [m/s] at 20 m/s")
    axis.set_ylabel("adhesion coefficient [-]")
    axis.legend(fontsize=9)
    axis.grid(alpha=0.3)
    drawn("laws", figure)


def odd(place: Path) -> None:
    """Show the signals of the odd files that docs/odd_files.md writes."""
    with contextlib.chdir(place):
        exec(_block("odd_files.md"), {})
        done("inspect", "odd", "--vehicle", "coach", "--standalone")
        page("odd_signals", Path("odd/signals.html"), 760)


def _block(name: str) -> str:
    """Return the first block of Python of a page."""
    found = re.search(r"^```python\n(.*?)^```", (DOCS / name).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


PICTURES: dict[str, Callable[[Path], None]] = {
    "signals_repaired": repaired, "creep_report": creep, "compared": compared, "evaluated": evaluated, "rendering": rendering,
    "controllers": controllers, "vehicles": vehicles, "exchanged": exchanged,
    "drive_it": drive_it, "laws": laws, "odd_signals": odd,
}  # fmt: skip


def main() -> None:
    """Write the pictures."""
    with tempfile.TemporaryDirectory() as place:
        for name in sys.argv[1:] or PICTURES:
            PICTURES[name](Path(place))
            print(f"docs/{name}.png", flush=True)


if __name__ == "__main__":
    main()
