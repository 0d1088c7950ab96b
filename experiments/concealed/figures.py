"""The pictures of the page, drawn from the figures in score.json."""

import itertools
import textwrap
from pathlib import Path
from typing import Any

from experiments.concealed.effects import FOREIGN, NAMED
from experiments.concealed.rates import Rate
from experiments.concealed.score import SIZES
from wsp_env.plant.mechanisms import LIBRARY
from wsp_env.report import COLOURS

Figures = dict[str, Any]
_TITLES = {"right_name_first": "right name first", "in_set": "truth in a reported set"}
_NOISES = {"0.5": "half the noise", "1.0": "noise as estimated", "2.0": "twice the noise"}


def _pyplot() -> Any:
    try:
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError:
        raise ModuleNotFoundError('the pictures need matplotlib: pip install "wsp-env[report]"') from None
    return plt


def draw(figures: Figures, rivals: dict[str, Figures], folder: Path) -> None:
    """Draw all pictures into a folder.

    Parameters
    ----------
    rivals : the same figures of every rival, by its name in words

    """
    plt = _pyplot()
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {"power": _power, "confusion": _confusion, "calibration": _calibration}
    for name, picture in pictures.items():
        _save(plt, picture(plt, figures), folder / f"{name}.png")
    _save(plt, _comparison(plt, {"wsp diagnose": figures} | rivals), folder / "rivals.png")


def _save(plt: Any, figure: Any, file: Path) -> None:
    figure.savefig(file, dpi=110, bbox_inches="tight", metadata={"Software": None})  # the same bytes from the same figures
    plt.close(figure)


def _bars(axes: Any, x: list[float], rates: list[Rate], **style: Any) -> None:
    """Draw shares with the bounds of Clopper and Pearson."""
    share = [rate.events / rate.of for rate in rates]
    below = [middle - rate.lower95 for middle, rate in zip(share, rates, strict=True)]
    above = [rate.upper95 - middle for middle, rate in zip(share, rates, strict=True)]
    axes.errorbar(x, share, yerr=[below, above], capsize=3, **style)


def _power(plt: Any, figures: Figures) -> Any:
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 3.8), sharey=True)
    ticks = [f"{low:g} to {high:g}" for low, high in itertools.pairwise(SIZES)]
    for axes, what in zip(panels, ("right_name_first", "in_set"), strict=True):
        for i, (noise, by_size) in enumerate(figures["power"].items()):
            known = [(ticks.index(size), rates[what]) for size, rates in by_size.items() if rates[what].of]
            if known:
                x = [place + 0.12 * (i - 1) for place, _ in known]
                _bars(axes, x, [r for _, r in known], label=_NOISES.get(noise, f"noise {noise}"), color=COLOURS[i], marker="o")
        axes.set(
            title=_TITLES[what],
            xlabel="size over the smallest effect of interest",
            ylim=(-0.03, 1.03),
            xlim=(-0.5, len(ticks) - 0.5),
        )
        axes.set_xticks(range(len(ticks)), [*(size.replace(" to ", "–") for size in ticks[:-1]), f"over {SIZES[-2]:g}"])
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share of single effects")
    panels[1].legend(loc="lower right")
    return figure


def _confusion(plt: Any, figures: Figures) -> Any:
    table = figures["confusion"]
    rows = [name for name in (*NAMED, "nothing", *FOREIGN) if name in table]
    columns = [*LIBRARY, "discovered", "unknown", "data", "adequate", "insufficient"]
    figure, axes = plt.subplots(figsize=(9.5, 9.5))
    shares = [[table[row].get(column, 0) / sum(table[row].values()) for column in columns] for row in rows]
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            if count := table[row].get(column, 0):
                axes.text(j, i, count, ha="center", va="center", color="white" if shares[i][j] > 0.6 else "black", fontsize=8)
    axes.set_xticks(range(len(columns)), [name.replace("_", " ") for name in columns], rotation=60, ha="right")
    axes.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
    named = sum(name in NAMED for name in rows)
    for edge in (named, named + ("nothing" in rows)):
        axes.axhline(edge - 0.5, color="grey", lw=0.8)
    axes.axvline(len(LIBRARY) - 0.5, color="grey", lw=0.8)
    axes.set(xlabel="first name answered, or the verdict", ylabel="what is true")
    return figure


def _calibration(plt: Any, figures: Figures) -> Any:
    figure, axes = plt.subplots(figsize=(4.6, 4.2))
    axes.plot([0, 1], [0, 1], color="grey", lw=0.8)
    bins = figures["promised"]["calibration"]["bins"]
    if bins:
        right = [one["rate"] for one in bins]
        _bars(axes, [one["confidence"] for one in bins], right, fmt="o", color=COLOURS[0])
        for one in bins:
            place = (one["confidence"], one["rate"].share)
            axes.annotate(str(one["rate"].of), place, xytext=(5, -10), textcoords="offset points", fontsize=8)
    axes.set(xlabel="stated confidence", ylabel="share that is true", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
    axes.grid(alpha=0.3)
    return figure


#: Figures that are compared, and where they stand.
COMPARED = {
    "false alarms on nulls": ("promised", "false_alarms"),
    "right name first, separable": ("separable", "right_name_first"),
    "truth in a reported set": ("separable", "in_set"),
    "a name that is not there": ("promised", "not_there"),
    "both of a pair": ("promised", "pairs_both"),
    "outside the library: named": ("promised", "outside_named"),
}


def of(figures: Figures, path: tuple[str, ...]) -> Any:
    """Return a figure by its path."""
    for key in path:
        figures = figures[key]
    return figures


def _comparison(plt: Any, contestants: dict[str, Figures]) -> Any:
    figure, axes = plt.subplots(figsize=(9.5, 3.8))
    width = 0.8 / len(contestants)
    for i, (name, figures) in enumerate(contestants.items()):
        rates = [of(figures, path) for path in COMPARED.values()]
        known = [(j, rate) for j, rate in enumerate(rates) if rate.of]
        x = [j + (i - (len(contestants) - 1) / 2) * width for j, _ in known]
        axes.bar(x, [rate.share for _, rate in known], width, color=COLOURS[i], label=name, alpha=0.85)
        _bars(axes, x, [rate for _, rate in known], fmt="none", ecolor="black", elinewidth=0.8)
    axes.set_xticks(range(len(COMPARED)), [textwrap.fill(name, 16) for name in COMPARED])
    axes.set(ylabel="share of cases", ylim=(0, 1.03))
    axes.legend(fontsize=8, ncol=len(contestants), loc="upper center", bbox_to_anchor=(0.5, 1.14), frameon=False)
    axes.grid(axis="y", alpha=0.3)
    return figure
