"""How the multibody coach runs: its critical speed, and a curve of 300 m on the flange.

    python -m experiments.multibody.running [--picture docs/multibody_curve.png]

Lateral stability: the whole coach is put 3 mm to the left on straight, smooth, dry track without brake, and runs for 12 s.
Below the critical speed the lateral shift decays, above it ends in a limit cycle.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from rich.console import Console

from experiments.multibody.pictures import figure
from wsp_env.parameters.track_geometry import Curve, TrackGeometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.velim import CONTACT, TAU_M_PER_J
from wsp_env.plant.multibody.plant import MultibodyPlant
from wsp_env.plant.multibody.structure import WHEELSETS, Y_
from wsp_env.plant.port import Setup, Stop
from wsp_env.report import COLOURS, Table, terminal_table

#: Running speeds [m/s], wheels on dry rails.
SPEEDS_MPS = (40.0, 50.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0, 90.0, 95.0)
DRY = 0.28
OFFSET_M = 3e-3
#: Paper: S1002 on UIC60 1:20. A curve that its cant balances, mean distance of the contact points 1.5 m.
RADIUS_M, CANT_M = 300.0, 0.15


class Run(NamedTuple):
    """A run without brake, sampled at every control interval."""

    time: np.ndarray  # (T,) [s]
    shift: np.ndarray  # (T, N, A) [m]
    load: np.ndarray  # (T, N, A, 2) [N]
    quotient: np.ndarray  # (T, N, A, 2) [-]
    given_up: dict[int, str]


def roll(speeds_mps: tuple[float, ...], seconds: float, track: TrackGeometry | None = None, offset_m: float = 0.0) -> Run:
    """Roll freely at several speeds."""
    vehicle = dataclasses.replace(COACH, contact=CONTACT)
    plant = MultibodyPlant(vehicle, len(speeds_mps), Setup(track_geometry=track))
    radius, flat = np.full(vehicle.axles, vehicle.wheel_radius_m), np.ones(1)
    for i, speed in enumerate(speeds_mps):
        plant.start(i, Stop(DRY, TAU_M_PER_J, speed, vehicle.mass_kg, 0.0, 0.0, 0.0, i, radius, flat, flat))
    plant.bodies.position[:, Y_ : WHEELSETS + 6 * vehicle.axles : 6] = offset_m
    samples = []
    command = np.full((plant.n, vehicle.axles), -1.0)
    for _ in range(round(seconds / plant.setup.control_interval_s)):
        plant.step(command)
        truth = plant.further_truth()
        samples.append([truth[name].copy() for name in ("lateral_shift_m", "wheel_load_n", "derailment_quotient")])
    shift, load, quotient = (np.array(values) for values in zip(*samples, strict=True))
    time = plant.setup.control_interval_s * (1.0 + np.arange(len(shift)))
    return Run(time, shift, load, quotient, dict(plant.given_up()))


def stability(console: Console) -> None:
    """Print what becomes of a lateral offset at every speed."""
    run = roll(SPEEDS_MPS, 12.0, offset_m=OFFSET_M)
    size = np.abs(run.shift).max(axis=2)
    early, late = (size[(run.time > begin) & (run.time <= begin + 3.0)].max(axis=0) for begin in (3.0, 9.0))
    rows = [
        (f"{speed:g}", f"{3.6 * speed:.0f}", f"{1e3 * a:.3f}", f"{1e3 * b:.3f}", _said(a, b))
        for speed, a, b in zip(SPEEDS_MPS, early, late, strict=True)
    ]
    header = ("speed [m/s]", "[km/h]", "largest shift, 3 to 6 s [mm]", "9 to 12 s [mm]", "")
    console.print(terminal_table(Table(header, rows, f"an offset of {1e3 * OFFSET_M:g} mm at mu_cd {DRY:g}")))


def _said(early_m: float, late_m: float) -> str:
    if late_m > OFFSET_M:
        return "limit cycle"
    return "grows" if late_m > early_m else "decays"


def curve(console: Console, picture: Path | None) -> None:
    """Print and draw a run through a curve of 300 m, at the speed that its cant balances."""
    speed = math.sqrt(math.tan(math.asin(CANT_M / 1.5)) * COACH.gravity_mps2 * RADIUS_M)
    lie = Curve(begin_m=60.0, transition_m=60.0, length_m=150.0, radius_m=RADIUS_M, cant_m=CANT_M)
    run = roll((speed,), 450.0 / speed, TrackGeometry(curves=(lie,)))
    place = speed * run.time
    full = (place > lie.begin_m + lie.transition_m + 40.0) & (place < lie.end_m - lie.transition_m)
    shift, load, quotient = run.shift[:, 0], run.load[:, 0], run.quotient[:, 0]
    rows = [
        (
            str(k + 1), f"{1e3 * shift[full, k].mean():.2f}", f"{1e3 * np.abs(np.diff(shift[:, k])).max():.2f}",
            *(f"{load[full, k, j].mean() / 1e3:.1f}" for j in (0, 1)), *(f"{quotient[full, k, j].mean():.3f}" for j in (0, 1)),
        )
        for k in range(COACH.axles)
    ]  # fmt: skip
    header = ("axle", "shift [mm]", "largest change in 20 ms [mm]", "load left [kN]", "right", "Y/Q left", "right")
    title = f"in the full curve of {RADIUS_M:g} m to the left, {speed:.1f} m/s, {1e3 * CANT_M:g} mm of cant"
    console.print(terminal_table(Table(header, rows, title)))
    console.print(
        f"all of the run: wheel loads {load.min() / 1e3:.1f} to {load.max() / 1e3:.1f} kN, "
        f"largest Y/Q {np.nanmax(quotient):.3f}, given up: {run.given_up or 'no'}"
    )
    if picture:
        _draw(place, shift, load, quotient, lie, picture)


def _draw(place: np.ndarray, shift: np.ndarray, load: np.ndarray, quotient: np.ndarray, lie: Curve, path: Path) -> None:
    drawn = figure(8.0, 6.4)
    axes: Any = drawn.subplots(3, 1, sharex=True)
    for k in range(shift.shape[1]):
        axes[0].plot(place, 1e3 * shift[:, k], color=COLOURS[k], label=f"axle {k + 1}")
        for j, style in ((0, ":"), (1, "-")):
            axes[1].plot(place, load[:, k, j] / 1e3, style, color=COLOURS[k], linewidth=0.9)
            axes[2].plot(place, quotient[:, k, j], style, color=COLOURS[k], linewidth=0.9)
    ends = (lie.begin_m, lie.begin_m + lie.transition_m, lie.end_m - lie.transition_m, lie.end_m)
    names = ("lateral shift [mm]\n(to the left)", "wheel load Q [kN]\n(full: outer wheels)", "Y / Q")
    for axis, name in zip(axes, names, strict=True):
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
        axis.axvspan(ends[0], ends[3], color="#f1f1f1", zorder=0)
        axis.axvspan(ends[1], ends[2], color="#e2e2e2", zorder=0)
    axes[0].legend(fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.44, 1.0))
    axes[2].set_xlabel("place of the leading axle [m]; grey: transitions and full curve")
    drawn.savefig(path)


def main(picture: Path | None = None) -> None:
    """Print the tables.

    Parameters
    ----------
    picture
        Where to draw the run through the curve.

    """
    console = Console(width=130, highlight=False)
    stability(console)
    curve(console, picture)


if __name__ == "__main__":
    tyro.cli(main)
