"""The README's picture: a diagnosis. The run that shows best what a validation concealed, before and after it was found.

`make picture`, or `python experiments/readme_picture.py [FILE]`.
"""

import os
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.answer import Diagnosis, RunTrace
from wsp_env.recordings import concealed_campaign, read_campaign
from wsp_env.report import COLOURS

_SIDES = {"before": ("law as tuned and validated", COLOURS[1]), "after": ("with what the diagnosis found", COLOURS[2])}
_LINE = 100  # letters


def draw(found: Diagnosis) -> Figure:
    """Draw one run before and after, beside the same error in all of them."""
    course = found.course
    assert course is not None
    figure = Figure(figsize=(10, 4.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.9, 1.0))
    if course.shows == "speed":
        _speed(left, course)
        rows = [(one.run, one.speed_error_before_mps, one.speed_error_after_mps) for one in found.runs]
        _errors(right, rows, "error $E$ of the vehicle's speed [m/s]")
    else:
        _adhesion(left, course)
        rows = [
            (f"{run.run} axle {k + 1}", 100.0 * before, 100.0 * after)
            for run in found.runs
            for k, (before, after) in enumerate(zip(run.adhesion_error_before, run.adhesion_error_after, strict=True))
            if before is not None and after is not None
        ]
        _errors(right, rows, "error $e_j$ of the adhesion [%]")
    held_out = ", held out" if course.group == "validate" else ""
    left.set_title(f"Run {course.run}{held_out}", fontsize=10)
    left.set_xlabel("time [s]")
    left.legend(fontsize=8)
    for axis in (left, right):
        axis.grid(alpha=0.3)
    figure.suptitle("\n".join(textwrap.wrap(found.sentence.replace(" %", "\u00a0%"), _LINE)), fontsize=11, fontweight="bold")
    return figure


def _speed(axis: Axes, course: RunTrace) -> None:
    for side, (words, colour) in _SIDES.items():
        axis.plot(course.speed_time_s, getattr(course, f"speed_residual_{side}_mps"), color=colour, linewidth=1.6, label=words)
    axis.axhline(0.0, color="#888", linewidth=0.8)
    axis.set_ylabel("vehicle speed, recorded less simulated [m/s]")


def _adhesion(axis: Axes, course: RunTrace) -> None:
    axis.plot(course.time_s, course.adhesion_measured, ".", color=COLOURS[6], markersize=4, alpha=0.6, label="recorded")
    for side, (words, colour) in _SIDES.items():
        axis.plot(course.time_s, getattr(course, f"adhesion_{side}"), color=colour, linewidth=1.6, label=words)
    axis.set_ylabel(f"adhesion coefficient of axle {course.axle} [-]")


def _errors(axis: Axes, rows: Sequence[tuple[str, float, float]], label: str) -> None:
    """Draw an error in every row, before and after."""
    for index, (_, colour) in enumerate(_SIDES.values(), start=1):
        axis.plot(np.array([row[index] for row in rows], float), range(len(rows)), "o", color=colour, markersize=6)
    axis.set_yticks(range(len(rows)), [row[0] for row in rows], fontsize=8)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xlim(left=0.0)
    axis.set_xlabel(label)
    axis.set_title("All runs", fontsize=10)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/picture.png")
    draw(diagnose(read_campaign(concealed_campaign()), lambda step: None, os.cpu_count() or 1)).savefig(target)
    print(target)
