"""The README's picture: a diagnosis. The run that shows best what a validation concealed, before and after it was found.

`make picture`, or `python experiments/readme_picture.py [FILE]`.
"""

import os
import sys
import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.recordings import concealed_campaign, read_campaign
from wsp_env.report import COLOURS

_SIDES = {"before": ("law as tuned and validated", COLOURS[1]), "after": ("with what the diagnosis found", COLOURS[2])}
_LINE = 100  # letters


def draw(found: Diagnosis) -> Figure:
    """Draw the adhesion of one axle over what is left of it, before and after, and what every axle's error was and is."""
    course = found.course
    assert course is not None
    figure = Figure(figsize=(10, 5.6), dpi=110, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(2.2, 1.0), height_ratios=(1.5, 1.0))
    top, bottom, errors = (figure.add_subplot(grid[place]) for place in ((0, 0), (1, 0), (slice(None), 1)))
    measured = np.array(course.adhesion_measured)
    top.plot(course.time_s, measured, ".", color=COLOURS[6], markersize=4, alpha=0.6, label="recorded")
    for side, (words, colour) in _SIDES.items():
        predicted = np.array(getattr(course, f"adhesion_{side}"))
        top.plot(course.time_s, predicted, color=colour, linewidth=1.6, label=words)
        bottom.plot(course.time_s, measured - predicted, color=colour, linewidth=1.3)
    top.set_ylabel("adhesion coefficient [-]")
    top.set_title(f"Run {course.run}, axle {course.axle}", fontsize=10)
    top.legend(fontsize=8)
    bottom.set_ylabel("recorded less simulated [-]")
    bottom.set_xlabel("time [s]")
    bottom.axhline(0.0, color="#888", linewidth=0.8)
    _errors(errors, found)
    for axis in (top, bottom, errors):
        axis.grid(alpha=0.3)
    figure.suptitle("\n".join(textwrap.wrap(found.sentence, _LINE)), fontsize=11, fontweight="bold")
    return figure


def _errors(axis: Axes, found: Diagnosis) -> None:
    """Draw the error of the adhesion of every axle that slides, run by run."""
    rows = [
        (f"{run.run} axle {k + 1}", before, after)
        for run in found.runs
        for k, (before, after) in enumerate(zip(run.adhesion_error_before, run.adhesion_error_after, strict=True))
        if before is not None and after is not None
    ]
    for index, (_, colour) in enumerate(_SIDES.values(), start=1):
        axis.plot([100.0 * row[index] for row in rows], range(len(rows)), "o", color=colour, markersize=5)
    axis.set_yticks(range(len(rows)), [row[0] for row in rows], fontsize=7)
    axis.invert_yaxis()
    axis.set_xlim(left=0.0)
    axis.set_xlabel("error $e_j$ of the adhesion [%]")
    axis.set_title("Every axle that slides", fontsize=10)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/picture.png")
    draw(diagnose(read_campaign(concealed_campaign()), lambda step: None, os.cpu_count() or 1)).savefig(target)
    print(target)
