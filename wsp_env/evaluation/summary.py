"""Means over draws with their confidence intervals, and the verdicts on the requirements."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import polars
from scipy.special import stdtrit

from wsp_env.evaluation.evaluate import BOUND, Failure
from wsp_env.evaluation.figures import CAUSES, FIGURES
from wsp_env.evaluation.programme import Requirement

#: Confidence of the intervals.
CONFIDENCE = 0.95


@dataclasses.dataclass(frozen=True)
class Verdict:
    """A requirement applied to one controller: the worst of its stops, and their mean."""

    requirement: str
    controller: str
    passed: bool
    worst: float  # inf for a stop that ran on, and where the controller failed
    at_most: float
    where: str  # case, law and draw of the worst stop, and whether it ran on
    source: str
    mean: float = math.nan  # of the stops; nan where none is asked for
    mean_at_most: float = math.inf
    unit: str = ""  # of all these numbers; empty for a ratio

    @property
    def share(self) -> float:
        """How much of what is granted is used, worst stop or mean [-]; above 1 it is missed, inf where nothing is granted."""
        uses = [(self.worst, self.at_most)]
        if math.isfinite(self.mean_at_most):
            uses.append((self.mean, self.mean_at_most))
        return max(used / granted if granted > 0.0 else (0.0 if used <= granted else math.inf) for used, granted in uses)


def decided(verdicts: Sequence[Verdict]) -> list[str]:
    """Return a line for each controller: PASS or FAIL, of how many requirements, and the one that decides."""
    lines = []
    for name in dict.fromkeys(verdict.controller for verdict in verdicts):
        own = [verdict for verdict in verdicts if verdict.controller == name]
        missed = [verdict for verdict in own if not verdict.passed]
        one = max(missed or own, key=lambda verdict: verdict.share)
        used, granted, where = one.worst, one.at_most, one.where
        if math.isfinite(one.mean_at_most) and not one.mean / one.mean_at_most < one.worst / one.at_most:
            used, granted, where = one.mean, one.mean_at_most, "mean"
        limit = f"{granted:.4g} {one.unit}".rstrip()
        what = f"{one.requirement} {used:.4g} of {limit} ({where})" if math.isfinite(used) else where
        if missed:
            others = f", and {len(missed) - 1} more of {len(own)}" if len(missed) > 1 else f", the other {len(own) - 1} met"
            lines.append(f"FAIL {name}: {what}{others}")
        else:
            lines.append(f"PASS {name}: all {len(own)} requirements; nearest: {what}")
    return lines


def summarise(stops: polars.DataFrame) -> polars.DataFrame:
    """Return a row per controller, case and law: every figure's mean over the draws and `_ci`, half its interval's width.

    `stopped` and `within_limit` count the draws that ended at rest and that were never beyond the slide limit.

    The interval is Student's at `CONFIDENCE`, without meaning (nan) for one draw; figures that a row has not are null.
    """
    rows = []
    for (controller, case, law), group in stops.group_by(["controller", "case", "law"], maintain_order=True):
        row: dict[str, object] = {"controller": controller, "case": case, "law": law, "draws": group.height}
        row |= {what: int(group[what].sum()) for what in ("stopped", "within_limit")}
        for figure in [*FIGURES, *(f"lost_{cause}_m" for cause in CAUSES)]:
            mean, half = interval(group[figure].to_numpy()) if group[figure].null_count() == 0 else (None, None)
            row |= {figure: mean, f"{figure}_ci": half}
        rows.append(row)
    return polars.DataFrame(rows, infer_schema_length=None)


def interval(values: np.ndarray) -> tuple[float, float]:
    """Return the mean of independent draws and half the width of its confidence interval."""
    count = len(values)
    mean = float(np.mean(values))
    if count < 2 or not math.isfinite(mean):
        return mean, math.nan
    return mean, float(stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE) * np.std(values, ddof=1) / math.sqrt(count))


def judge(
    stops: polars.DataFrame, requirements: Sequence[Requirement], failures: Sequence[Failure] = ()
) -> tuple[Verdict, ...]:
    """Apply every requirement to every controller; one whose cases were not run is left out.

    A stop that ran on and a case in which the controller failed meet no requirement.
    """
    names = [*stops["controller"].unique(maintain_order=True), *(failure.controller for failure in failures)]
    verdicts = []
    for requirement in requirements:
        for name in dict.fromkeys(name for name in names if name != BOUND):
            found = _worst(stops.filter(polars.col("controller") == name), requirement)
            failed = [
                f.case for f in failures if f.controller == name and (not requirement.cases or f.case in requirement.cases)
            ]
            if failed:
                found = math.inf, f"{failed[0]}: failed", math.inf
            if found:
                worst, where, mean = found
                passed = worst <= requirement.at_most and mean <= requirement.mean_at_most
                source, means = requirement.source, (mean, requirement.mean_at_most)
                unit = FIGURES[requirement.figure][0].removeprefix("-")
                verdicts.append(
                    Verdict(requirement.name, name, passed, worst, requirement.at_most, where, source, *means, unit)
                )
    return tuple(verdicts)


def _worst(stops: polars.DataFrame, requirement: Requirement) -> tuple[float, str, float] | None:
    """Return the largest figure among the stops that the requirement concerns, which stop it was, and their mean; or None."""
    if requirement.cases:
        stops = stops.filter(polars.col("case").is_in(list(requirement.cases)))
    if requirement.laws:
        stops = stops.filter(polars.col("law").is_in(list(requirement.laws)))
    if stops.height == 0:
        return None
    values = np.where(stops["stopped"].to_numpy(), stops[requirement.figure].to_numpy(), np.inf)
    worst = int(np.argmax(values))
    row = stops.row(worst, named=True)
    ran_on = "" if row["stopped"] else ": ran on"
    return float(values[worst]), f"{row['case']}, {row['law']}, draw {row['draw'] + 1}{ran_on}", float(values.mean())
