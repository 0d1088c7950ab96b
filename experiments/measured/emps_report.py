"""What was found in the drive, in tables and a picture."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.measured import emps
from experiments.measured.files import drives
from experiments.measured.page import pyplot, save, table
from wsp_env.diagnosis.terms import Chosen, Selection
from wsp_env.report import COLOURS


def blocks(folder: Path) -> dict[str, str]:
    """Return the tables of the drive."""
    data = emps.rows(drives(folder))
    swapped = data._replace(held_out=~data.held_out)
    return {
        "emps": _steps(data, emps.find(data)),
        "emps_swapped": _steps(swapped, emps.find(swapped)),
        "emps_values": _values(data, emps.find(data)),
    }


def _steps(data: emps.Rows, found: Selection) -> str:
    rows = []
    accepted: list[Chosen | None] = [None, *found.chosen]
    for step, one in zip(emps.steps(data, found), accepted, strict=True):
        figures = ["", "", "", ""]
        if one is not None:
            error = np.sqrt(np.diag(one.covariance))
            amplitude = ", ".join(f"{a:.2f} ± {e:.2f}" for a, e in zip(one.amplitude, error, strict=True))
            held = one.reduction_held_out
            shown = ", ".join(one.alternatives) or "none"
            figures = [amplitude, f"{held.total:.0f} ± {held.error:.0f}", f"{one.multiple:.1f} %", shown]
        rows.append([step.added, *figures, f"{step.error_tune:.2f} %", f"{step.error_held_out:.2f} %"])
    head = [
        "model, then the term found",
        "amplitude",
        "held-out reduction [N²]",
        "size",
        "cannot be told from",
        "error",
        "held-out error",
    ]
    cycles = len(np.unique(data.cycle[~data.held_out]))
    tried = f"{len(data.terms)} candidates, {cycles} cycles in each file. The search stops: {found.why}"
    refused = f" ({found.refused.term.name})" if found.refused else ""
    return table(head, rows) + f"\n{tried}{refused}.\n"


def _values(data: emps.Rows, found: Selection) -> str:
    dry = next((i for i, one in enumerate(found.chosen) if one.term.name == "sign(v)"), -1) + 1
    values = emps.steps(data, found)[dry].values
    own = emps.fitted(data, ("sign(v)", "offset"))
    asymmetric = emps.fitted(data, ("sign(v)", "offset", "viscous, forward only"))
    names = {
        "M": "mass [kg]",
        "F_v": "viscous friction [N s/m]",
        "F_c": "dry friction [N]",
        "offset": "offset [N]",
        "viscous, forward only": "more viscous friction forward [N s/m]",
    }
    rows = []
    for key, text in names.items():
        name = "sign(v)" if key == "F_c" else key
        shown = [f"{one[name]:.2f}" if name in one else "-" for one in (values, own.values, asymmetric.values)]
        rows.append([text, *shown, f"{emps.LITERATURE[key]:.2f}" if key in emps.LITERATURE else "-"])
    after = emps.steps(data, found)[dry].error_held_out
    errors = [after, own.error_held_out, asymmetric.error_held_out, emps.literature_error(data)]
    rows.append(["held-out error [%]", *(f"{one:.2f}" for one in errors)])
    head = ["", "dry friction, found", "with offset, fitted", "asymmetric friction, fitted", "the literature's values"]
    return table(head, rows)


def draw(folder: Path, docs: Path) -> None:
    """Draw what the models leave over speed, on the held-out file."""
    plt = pyplot()
    data = emps.rows(drives(folder))
    found = emps.find(data)
    count = len(found.chosen) + 1
    figure, panels = plt.subplots(1, count, figsize=(3.4 * count, 2.8), sharey=True, squeeze=False)
    for axes, (step, rest) in zip(panels[0], zip(emps.steps(data, found), emps.remains(data, found), strict=True), strict=True):
        _panel(axes, data, rest, step)
    panels[0, 0].set_ylabel("force that is left [N]")
    save(plt, figure, docs, "emps")


def _panel(axes: Any, data: emps.Rows, rest: np.ndarray, step: emps.Step) -> None:
    held = data.held_out
    axes.plot(data.speed[held], rest[held], ".", markersize=2, color=COLOURS[0])
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set(xlabel="speed [m/s]", title=f"{step.added}\n{step.error_held_out:.1f} % held out")
    axes.title.set_fontsize(9)
