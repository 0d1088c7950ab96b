"""The page of an evaluation: distance against slip, where distance is lost, the course of any stop, all figures."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars

from wsp_env.evaluation.evaluate import BOUND, ProgrammeResult
from wsp_env.evaluation.figures import CAUSES, FIGURES
from wsp_env.evaluation.programme_viewer import Viewer
from wsp_env.evaluation.results import TRACE_SAMPLES
from wsp_env.evaluation.summary import Verdict, decided
from wsp_env.report import COLOURS, Facts, Figure, Origin, PageOptions, Section, Table, axes, plotly, write_page

#: What the mark beside a ratio to the bound says.
LEFT_LIMIT = (
    "* at least one draw left the slide limit: it violates it, the bound does not hold for it, and the recovery there is "
    "beyond what the law was fitted on (see --cap-recovery)"
)

#: Where cases are named beside their last mark, in turn: names of neighbours stay apart.
_NAMED_AT = ("top left", "bottom left", "middle left")

_DIGITS = {"m": 0, "m/s": 2, "s": 1, "Nl": 0, "MJ": 3, "bar": 2, "-": 3}
_SLIP_TICKS = [digit * 10.0**power for power in range(-4, 3) for digit in (1, 2, 5)]
_CAUSE_COLOURS = dict(zip(CAUSES, ("#bbbbbb", COLOURS[0], COLOURS[4], COLOURS[1]), strict=True))


def write_report(
    path: Path, result: ProgrammeResult, summary: polars.DataFrame, verdicts: Sequence[Verdict], title: str,
    made_from: Origin = Origin("wsp evaluate"), options: PageOptions = PageOptions(),
) -> None:  # fmt: skip
    """Write the page; `ModuleNotFoundError` names the extra where plotly is missing."""
    plotly()
    contaminated = _contaminated(summary)
    rows = [(head, rest) for head, _, rest in (line.partition(": ") for line in decided(verdicts))]
    sections = [Section("", (), [Facts(rows)])] if rows else []
    sections += [_front(contaminated)] if contaminated.height else []
    sections.append(Section("Requirements", _complaints(result), [_verdicts(verdicts)] if verdicts else [], fold=True))
    sections += [_overall(contaminated), _lost(contaminated)] if contaminated.height else []
    sections += [_courses(result), _all_figures(summary)]
    lead = " ".join([*_headline(contaminated), *_failed(result)])
    write_page(path, f"Wheel slide protection: {title}", lead, sections, made_from, options)


def _headline(contaminated: polars.DataFrame) -> list[str]:
    """Say in a sentence how the controllers stop on contaminated rail, all cases and laws together."""
    parts = [f"{row['controller']} {row['ratio_bound']:.2f} at {row['mean_slip_mps']:.2f} m/s" for row in _means(contaminated)]
    if not parts:
        return ["No stop on contaminated rail was braked to its end."]
    said = f"Stopping distance over the shortest possible one, and mean slip, on contaminated rail: {'; '.join(parts)}."
    return [f"{said} A distance counts only beside its slide."]


def _means(contaminated: polars.DataFrame) -> list[dict[str, Any]]:
    """Return each controller's means over the cases and laws that every controller stopped in."""
    rows = contaminated.filter(polars.col("controller") != BOUND)
    ended = rows.filter(polars.col("ratio_bound").is_finite())
    count = rows["controller"].n_unique()
    common = ended.group_by("case", "law").agg(polars.col("controller").n_unique().alias("n")).filter(polars.col("n") == count)
    figures = ("ratio_bound", "ratio_dry", "mean_slip_mps", "beyond_limit_s", "locked_s", "air_nl", "contact_energy_mj")
    kept = ended.join(common, on=["case", "law"], how="semi")
    means = kept.group_by("controller", maintain_order=True).agg(*(polars.col(name).mean() for name in figures), polars.len())
    return means.to_dicts()


def _failed(result: ProgrammeResult) -> list[str]:
    names = list(dict.fromkeys(failure.controller for failure in result.failures))
    return [f"{', '.join(names)} failed in some case: see the requirements."] if names else []


def _overall(contaminated: polars.DataFrame) -> Section:
    """Return the line that says it all: every controller over all cases."""
    header = ("Controller", "Cases", "Distance / bound", "Distance / dry rail", "Mean slip [m/s]", "Beyond the limit [s]",
              "Locked [s]", "Air [Nl]", "Heat, worst wheel [MJ]")  # fmt: skip
    digits = {"ratio_bound": 3, "ratio_dry": 2, "mean_slip_mps": 2, "beyond_limit_s": 1, "locked_s": 1, "air_nl": 0,
              "contact_energy_mj": 2}  # fmt: skip
    rows = [
        (row["controller"], str(row["len"]), *(f"{row[name]:.{places}f}" for name, places in digits.items()))
        for row in _means(contaminated)
    ]
    caption = "Means over the cases and laws on contaminated rail in which every controller came to rest."
    return Section("All cases together", (), [Table(header, rows, caption)], fold=True)


def _complaints(result: ProgrammeResult) -> list[str]:
    return [f"{failure.controller} failed in {failure.case}: {failure.message}" for failure in result.failures]


def _ran_on(summary: polars.DataFrame) -> list[str]:
    """Return a sentence on the stops that never ended, which have no distance to draw."""
    rows = summary.filter(polars.col("stopped") < polars.col("draws")).to_dicts()
    named = [f"{row['controller']} in {row['case']}, {row['law']} law ({row['draws'] - row['stopped']})" for row in rows]
    return [f"Not shown, as they never stopped: {'; '.join(named)}."] if named else []


def _contaminated(summary: polars.DataFrame) -> polars.DataFrame:
    """Return the rows of contaminated rail: where there are both laws."""
    both = summary.group_by("case").agg(polars.col("law").n_unique()).filter(polars.col("law") > 1)["case"]
    return summary.filter(polars.col("case").is_in(both.to_list()))


def _names(summary: polars.DataFrame) -> list[str]:
    return [name for name in summary["controller"].unique(maintain_order=True) if name != BOUND]


def _verdicts(verdicts: Sequence[Verdict]) -> Table:
    names = list(dict.fromkeys(verdict.controller for verdict in verdicts))
    rows = []
    for requirement in dict.fromkeys(verdict.requirement for verdict in verdicts):
        own = {verdict.controller: verdict for verdict in verdicts if verdict.requirement == requirement}
        first = next(iter(own.values()))
        cells = [_verdict(own[name]) if name in own else "" for name in names]
        rows.append((requirement, f"{first.at_most:g} {first.unit}".rstrip(), *cells, first.source))
    return Table(
        ("requirement", "at most", *names, "source of the limit"),
        rows,
        "The worst stop counts, and the mean of the stops where it says so.",
    )


def _verdict(verdict: Verdict) -> str:
    mean = f"; mean {verdict.mean:.4g} of {verdict.mean_at_most:.4g}" if math.isfinite(verdict.mean_at_most) else ""
    if verdict.passed:
        return f"pass ({verdict.worst:.4g}{mean})"
    return f"FAIL ({verdict.worst:.4g}: {verdict.where}{mean})" if math.isfinite(verdict.worst) else f"FAIL ({verdict.where})"


def _front(summary: polars.DataFrame) -> Section:
    _, subplots = plotly()
    laws = summary["law"].unique(maintain_order=True).to_list()
    figure = subplots.make_subplots(
        rows=1, cols=len(laws), subplot_titles=[f"{law} law" for law in laws], horizontal_spacing=0.09
    )
    for column, law in enumerate(laws, start=1):
        drawn = summary.filter((polars.col("law") == law) & (polars.col("controller") != BOUND))
        drawn = drawn.filter(polars.col("ratio_bound").is_finite())
        _name_cases(figure, drawn, column)
        for index, name in enumerate(_names(summary)):
            rows = drawn.filter(polars.col("controller") == name)
            colour = COLOURS[index % len(COLOURS)]
            figure.add_scatter(
                x=rows["mean_slip_mps"].to_list(), y=rows["ratio_bound"].to_list(),
                error_y={"array": rows["ratio_bound_ci"].fill_nan(0.0).to_list(), "thickness": 1, "width": 2},
                mode="markers", name=name, legendgroup=name, showlegend=column == 1, marker=_marker(colour, rows),
                text=rows["case"].to_list(), customdata=[_limit_kept(row) for row in rows.to_dicts()],
                hovertemplate="%{text}<br>mean slip %{x:.2f} m/s<br>distance / bound %{y:.3f}<br>%{customdata}",
                row=1, col=column,
            )  # fmt: skip
            if rows.height > 1:
                figure.add_scatter(
                    x=[rows["mean_slip_mps"].mean()], y=[rows["ratio_bound"].mean()], mode="markers+text",
                    text=["all cases"], textposition="middle right", name=f"{name}, all cases", legendgroup=name,
                    showlegend=False, marker={"symbol": "diamond", "size": 15, "color": colour, "opacity": 0.7}, row=1,
                    col=column,
                )  # fmt: skip
        figure.add_hline(y=1.0, line={"color": "#777", "dash": "dot", "width": 1}, row=1, col=column)
    axes(figure, "mean slip speed [m/s]", "stopping distance / bound [-]", height=480)
    figure.update_layout(legend={"orientation": "h", "x": 0.0, "y": 1.12, "yanchor": "bottom"}, margin={"t": 90})
    figure.update_xaxes(type="log", tickvals=_SLIP_TICKS, ticktext=[f"{tick:g}" for tick in _SLIP_TICKS])
    text = (
        "One mark per case on contaminated rail, mean of the draws with its 95 % confidence interval; a line joins a case; a "
        "diamond is the mean of all. The bound (1) is the shortest stop within the slide limit. A hollow mark left the limit "
        "in at least one draw: it violates it, and may lie below 1.",
        *_ran_on(summary),
    )
    return Section("", text, [figure])


def _name_cases(figure: Any, rows: polars.DataFrame, column: int) -> None:
    """Join the marks of each case by a thin line, and name it at the end with the larger slip."""
    for index, case in enumerate(rows["case"].unique(maintain_order=True)):
        own = rows.filter(polars.col("case") == case).sort("mean_slip_mps")
        figure.add_scatter(
            x=own["mean_slip_mps"].to_list(), y=own["ratio_bound"].to_list(), mode="lines+text", showlegend=False,
            line={"color": "#bbb", "width": 0.8}, text=[*[""] * (own.height - 1), case],
            textposition=_NAMED_AT[index % len(_NAMED_AT)],
            textfont={"size": 10, "color": "#555"}, hoverinfo="skip", row=1, col=column,
        )  # fmt: skip


def _marker(colour: str, rows: polars.DataFrame) -> dict[str, object]:
    """Return filled points, hollow where a stop left the slide limit."""
    symbols = ["circle" if row["within_limit"] == row["draws"] else "circle-open" for row in rows.to_dicts()]
    return {"color": colour, "size": 9, "symbol": symbols, "line": {"width": 2, "color": colour}}


def _limit_kept(row: Mapping[str, Any]) -> str:
    left = row["draws"] - row["within_limit"]
    return f"{left} of {row['draws']} left the slide limit" if left else "within the slide limit"


def _lost(summary: polars.DataFrame) -> Section:
    figures = []
    for law in summary["law"].unique(maintain_order=True):
        figures.append(_lost_under(summary.filter(polars.col("law") == law), str(law)))
    text = (
        "Metres beyond the bound, by cause: the brake still filling; too little brake for the adhesion there is; slip beyond "
        "the best one; slip beyond the limit. Negative: gained, where a slide beyond the limit dries the rail or a wheelset "
        "spinning up gives momentum back. The scales differ between controllers.",
    )
    return Section("Where each controller loses distance", text, figures, fold=True)


def _lost_under(summary: polars.DataFrame, law: str) -> Figure:
    _, subplots = plotly()
    names = _names(summary)
    cases = summary["case"].unique(maintain_order=True).to_list()
    figure = subplots.make_subplots(rows=1, cols=len(names), shared_yaxes=True, subplot_titles=names, horizontal_spacing=0.03)
    for column, name in enumerate(names, start=1):
        rows = summary.filter(polars.col("controller") == name)
        for cause, meaning in CAUSES.items():
            figure.add_bar(
                y=rows["case"],
                x=rows[f"lost_{cause}_m"],
                name=meaning,
                legendgroup=cause,
                showlegend=column == 1,
                orientation="h",
                marker={"color": _CAUSE_COLOURS[cause]},
                row=1,
                col=column,
            )
    axes(figure, "", "", height=180 + 26 * len(cases), barmode="relative", title=f"{law} law: metres beyond the bound [m]")
    figure.update_layout(margin={"l": 160, "t": 90, "b": 70}, legend={"orientation": "h", "yref": "container", "y": 0.01})
    figure.update_xaxes(nticks=5)
    figure.update_yaxes(categoryorder="array", categoryarray=cases[::-1])
    return figure


def _all_figures(summary: polars.DataFrame) -> Section:
    header = ["case", "law", "controller", *(f"{_words(name)} [{unit}]" for name, (unit, _) in FIGURES.items())]
    rows = []
    stops = list(summary.select("case", "law").unique(maintain_order=True).iter_rows())
    for row in sorted(summary.to_dicts(), key=lambda row: stops.index((row["case"], row["law"]))):
        cells = [_cell(row[name], row[f"{name}_ci"], _DIGITS[unit]) for name, (unit, _) in FIGURES.items()]
        cells[list(FIGURES).index("ratio_bound")] += "*" * (row["within_limit"] < row["draws"])
        ran_on = row["draws"] - row["stopped"]
        rows.append([row["case"], row["law"], row["controller"] + (f" ({ran_on} ran on)" if ran_on else ""), *cells])
    meanings = "; ".join(f"{_words(name)}: {meaning}" for name, (_, meaning) in FIGURES.items())
    caption = f"Means of the draws with 95 % confidence intervals. {LEFT_LIMIT}. {meanings}."
    return Section("All figures", (), [Table(header, rows, caption)], fold=True)


def _words(name: str) -> str:
    """Return the name of a figure in words, without its unit."""
    if name.startswith("ratio_"):
        return f"distance / {name.removeprefix('ratio_')}"
    return re.sub(r"_(m|mps|s|nl|mj)$", "", name).replace("_", " ")


def _cell(value: float | None, half: float | None, digits: int) -> str:
    if value is None or not math.isfinite(value):
        return "" if value is None else "never stopped"
    spread = f" ± {half:.{digits}f}" if half is not None and math.isfinite(half) and half >= 0.5 * 10.0**-digits else ""
    return f"{value:.{digits}f}{spread}"


def _courses(result: ProgrammeResult) -> Section:
    text = (
        f"Any stop, thinned out to {TRACE_SAMPLES} samples: vehicle and wheels, slip speeds, cylinder pressures. On clean rail "
        "both laws are one.",
    )
    return Section("The course of a stop", text, [Viewer(result)], fold=True)
