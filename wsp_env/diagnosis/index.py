"""One page for many diagnoses: the findings in each campaign, their confidence and worth, and a link to each page."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from wsp_env.diagnosis.answer import Diagnosis
from wsp_env.diagnosis.creep_curves import CreepDiagnosis
from wsp_env.diagnosis.report_facts import MEANINGS
from wsp_env.report import COLOURS, Figure, Links, Origin, PageOptions, Section, Table, axes, plotly, write_page

Found = Diagnosis | CreepDiagnosis


def write_index(
    path: Path, found: Mapping[str, Found], failed: Mapping[str, str], options: PageOptions = PageOptions()
) -> None:
    """Write the page; `found` maps the folder of each report to its diagnosis, `failed` maps names to error messages."""
    sections = [Section("", (), [*_worths(found), Links([(f"{name}/report.html", _line(one)) for name, one in found.items()])])]
    if failed:
        sections.append(Section("Not diagnosed", [f"{name}: {why}." for name, why in failed.items()]))
    sections.append(Section("In a table", (), [_table(found)], fold=True))
    sections.append(Section("What the verdicts mean", [f"{word}: {meaning}." for word, meaning in MEANINGS.items()], fold=True))
    write_page(
        path, f"Diagnoses of {len(found)} campaigns", summary(list(found.values())), sections, Origin("wsp diagnose"), options
    )


def summary(found: Sequence[Found]) -> str:
    """Return one sentence on how often each mechanism was found."""
    names = Counter(one.name.replace("_", " ") for answer in found for one in answer.mechanisms)
    without = sum(not answer.mechanisms and answer.verdict == "adequate" for answer in found)
    other = sum(not answer.mechanisms and answer.verdict != "adequate" for answer in found)
    parts = [f"{name} in {count}" for name, count in names.most_common()]
    parts += [f"nothing missing in {without}"] if without else []
    parts += [f"something without a name, or nothing that can be said, in {other}"] if other else []
    return f"Of {len(found)} campaigns: {'; '.join(parts) or 'none was diagnosed'}."


def _line(one: Found) -> str:
    return f"{one.campaign}: {one.sentence}"


def _sure(one: Found) -> str:
    return "; ".join(f"{named.name.replace('_', ' ')} {named.confidence:.2f}" for named in one.mechanisms)


def _table(found: Mapping[str, Found]) -> Table:
    rows = []
    for one in found.values():
        worth = one.worth if isinstance(one, Diagnosis) else None
        share = "" if worth is None else f"{100.0 * worth.distance_share:+.1f}"
        metres = "" if worth is None or worth.stop_m is None else f"{worth.distance_share * worth.stop_m:+.1f}"
        rows.append((one.campaign, one.verdict, _sure(one), metres, share))
    header = ("Campaign", "Verdict", "Found, with confidence (of 1)", "Stopping distance [m]", "Stopping distance [%]")
    return Table(header, rows, "Stopping distance: by how much real stops are longer (+) or shorter than simulated ones.")


def _worths(found: Mapping[str, Found]) -> list[Figure]:
    """Draw the change of a stop by the findings, by campaign; an empty list if no worth is known."""
    known = [one for one in found.values() if isinstance(one, Diagnosis) and one.worth is not None]
    if not known:
        return []
    objects, _ = plotly()
    shares = [100.0 * one.worth.distance_share for one in known if one.worth is not None]
    reach = [[100.0 * abs(end - one.worth.distance_share) for end in one.worth.interval90]
             if one.worth is not None and one.worth.interval90 else [0.0, 0.0] for one in known]  # fmt: skip
    figure = objects.Figure()
    figure.add_bar(
        x=[one.campaign for one in known], y=shares, marker_color=COLOURS[0], name="stopping distance",
        error_y={"array": [high for _, high in reach], "arrayminus": [low for low, _ in reach]},
    )  # fmt: skip
    return [axes(figure, "campaign [-]", "real stop longer (+) than simulated [%]", height=340)]
