"""Pictures of the multibody coach: wheel loads through a stop, and an animation of the coach braking.

    python -m experiments.multibody.pictures [--loads docs/multibody_loads.png] [--animation docs/multibody_braking.gif]

One stop from 36 m/s at mu_cd 0.04 under the rule-based controller, with the coach's usual brake. The animation runs eight times
as fast as the stop; what the carbody pitches and sinks is drawn 150 times as large.
"""

from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments.multibody.stops import Driven, Planned, drive
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.report import COLOURS

#: In the animation: how much larger the carbody's motion is drawn, frames a second, and by how much it is faster.
LARGER, FRAMES_PER_S, FASTER = 150.0, 10.0, 8.0

#: Of the drawn coach [m]: half length, bottom and top of the carbody, half the length of a bogie frame.
HALF_M, BOTTOM_M, TOP_M, BOGIE_M = 13.2, 1.05, 3.9, 1.6


def figure(width: float, height: float) -> Any:
    """Return an empty figure that no window shows."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), dpi=100, layout="constrained")
    FigureCanvasAgg(made)
    return made


def draw_loads(stop: Driven, path: Path) -> None:
    """Draw speeds, deceleration and the load of one wheel of every axle over time."""
    picture = figure(8.0, 6.4)
    speeds, slowing, loads = picture.subplots(3, 1, sharex=True, height_ratios=[3, 1.4, 3])
    speeds.plot(stop.time, stop.speed, color="black", label="coach")
    for k in range(COACH.axles):
        speeds.plot(stop.time, stop.speed - stop.slip[:, k], color=COLOURS[k], linewidth=0.8, label=f"axle {k + 1}")
        loads.plot(stop.time, stop.wheel_load[:, k] / 1e3, color=COLOURS[k], linewidth=0.8)
    slowing.plot(stop.time, _smooth(stop.deceleration, 25), color="black", linewidth=0.9)
    loads.axhline(COACH.static_wheel_load_n / 1e3, color="grey", linestyle=":", label="at rest")
    for axis, label in ((speeds, "speed [m/s]"), (slowing, "deceleration\n[m/s2]"), (loads, "wheel load [kN]")):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    speeds.legend(fontsize=8, ncols=5, loc="upper right")
    loads.legend(fontsize=8)
    loads.set_xlabel("time [s]")
    picture.savefig(path)


def _smooth(values: np.ndarray, samples: int) -> np.ndarray:
    return np.convolve(values, np.full(samples, 1.0 / samples), mode="same")


def animate(stop: Driven, path: Path) -> None:
    """Write the animation: the coach from its left side, its wheel loads as bars, its speed."""
    from matplotlib.animation import FuncAnimation, PillowWriter

    every = round(FASTER / FRAMES_PER_S / (stop.time[1] - stop.time[0]))
    picture = figure(8.0, 3.2)
    axis = picture.subplots()
    middle = 0.5 * (COACH.axle_positions_m[0] + COACH.axle_positions_m[-1])

    def frame(step: int) -> list[Any]:
        axis.clear()
        at = min(step * every, len(stop.time) - 1)
        turn, shift = stop.more["body_turn_rad"][at], stop.more["body_shift_m"][at]
        corners = np.array([[-HALF_M, BOTTOM_M], [HALF_M, BOTTOM_M], [HALF_M, TOP_M], [-HALF_M, TOP_M], [-HALF_M, BOTTOM_M]])
        angle, sunk = LARGER * turn[0, 1], LARGER * shift[0, 2]
        x = corners[:, 0] * np.cos(angle) + (corners[:, 1] - BOTTOM_M) * np.sin(angle)
        z = BOTTOM_M - corners[:, 0] * np.sin(angle) + (corners[:, 1] - BOTTOM_M) * np.cos(angle) + sunk
        axis.fill(x, z, facecolor="#dbe7f0", edgecolor="black")
        for b in (0, 1):
            own = middle - np.mean(np.array(COACH.axle_positions_m)[2 * b : 2 * b + 2])
            tilt = LARGER * turn[1 + b, 1]
            axis.plot(
                own + np.array([-BOGIE_M, BOGIE_M]), 0.6 + np.array([1.0, -1.0]) * BOGIE_M * np.tan(tilt), "k", linewidth=3
            )
        for k, place in enumerate(COACH.axle_positions_m):
            load = stop.wheel_load[at, k] / COACH.static_wheel_load_n - 1.0
            wheel = np.linspace(0.0, 2.0 * np.pi, 40)
            axis.plot(middle - place + 0.445 * np.cos(wheel), 0.445 + 0.445 * np.sin(wheel), color=COLOURS[k])
            axis.bar(middle - place, 8.0 * load, 1.4, bottom=-2.0, color=COLOURS[k])
            axis.text(middle - place, -0.55, f"{100 * load:+.0f} %", ha="center", fontsize=8)
        axis.axhline(0.0, color="grey", linewidth=1.0)
        axis.set(
            xlim=(-16.0, 16.0), ylim=(-3.4, 5.2), aspect="equal", yticks=[], xlabel="along the coach [m], running to the right"
        )
        axis.set_title(
            f"{stop.time[at]:4.1f} s   {3.6 * stop.speed[at]:3.0f} km/h   motion of bodies x {LARGER:g}   "
            "bars: change of wheel load",
            fontsize=9,
            loc="left",
        )
        return []

    frames = int(np.ceil(len(stop.time) / every)) + 5
    FuncAnimation(picture, frame, frames=frames).save(path, writer=PillowWriter(fps=int(FRAMES_PER_S)))


def main(loads: Path = Path("docs/multibody_loads.png"), animation: Path = Path("docs/multibody_braking.gif")) -> None:
    """Brake once and draw.

    Parameters
    ----------
    loads
        Picture of the wheel loads.
    animation
        Animation of the coach.

    """
    planned = Planned("A1", 36.0, 0.04, coast_s=1.0)
    (stop,) = drive([planned], keep=("body_turn_rad", "body_shift_m"))
    draw_loads(stop, loads)
    animate(stop, animation)


if __name__ == "__main__":
    tyro.cli(main)
