"""The facts on the first page of a diagnosis: verdict, worth, confidence, place, removed share and next test."""

import math
from collections.abc import Sequence

from wsp_env.diagnosis.answer import Diagnosis, Discovered, FitQuality, Location, Named, Verdict, Worth
from wsp_env.diagnosis.interest import DISTANCE
from wsp_env.diagnosis.stops import SLIP_MPS
from wsp_env.diagnosis.words import BALANCES, capital
from wsp_env.plant.mechanisms import ALL
from wsp_env.report import Facts

#: The meaning of each verdict.
MEANINGS: dict[Verdict, str] = {
    "adequate": "the tuned simulation explains these recordings, up to what noise, normal variation and small change can do",
    "named": "what is missing has a name in the library, and these recordings tell which",
    "ambiguous": "what is missing has a name in the library, but these recordings leave several names open",
    "discovered": "something is missing that has no name in the library; its equation also holds in runs it was not taken from",
    "unknown": "something is missing, and neither a mechanism of the library nor an equation found explains it",
    "insufficient": "these recordings cannot show whether something is missing",
    "data": "channels contradict each other: the recordings must be mended before anything can be said on physics",
}

LEAST_SHARE = 0.005  # of the removed squares; less is printed as 0 %
_PLACES = 2  # on the first page


def facts(found: Diagnosis) -> Facts:
    """Return the rows of the first page; rows that do not apply are omitted."""
    rows = [("Verdict", f"{found.verdict}: {_meaning(found)}")]
    if found.mechanisms or found.discovered:
        rows.append(("Worth in a stop", worth_said(found)))
        rows.append(("Confidence", confidence_said(found)))
    if place := where_said(found):
        rows.append(("Where", place))
    if found.mechanisms or found.discovered:
        rows.append(("Removed", removed_said(found.fit.removed_validate)))
    elif found.fit.baseline:
        rows.append(("Misfit", misfit_said(found.fit)))
    if alike := [text for one in found.discovered if (text := _open(one))]:
        rows.append(("Left open", "; ".join(alike)))
    rows.append(("Next test", capital(found.next_test)))
    return Facts(rows)


def _meaning(found: Diagnosis) -> str:
    """Return the meaning of the verdict; `named` may leave one other name open."""
    if found.verdict == "named" and any(len(one.alternatives) > 1 for one in found.mechanisms):
        return "what is missing has a name in the library; these recordings leave one other name open"
    return MEANINGS[found.verdict]


def lead(found: Diagnosis) -> str:
    """Return the sentence of the answer, with the corresponding change of the stopping distance."""
    nothing = not found.mechanisms and not found.discovered
    if nothing or found.worth is None or abs(found.worth.distance_share) < 0.0005:  # printed as 0.0 %
        return found.sentence
    sides = "longer" if found.worth.distance_share > 0.0 else "shorter"
    share = 100.0 * abs(found.worth.distance_share)
    if found.worth.stop_m is None:
        return f"{found.sentence} By this, real stops are {share:.1f} % {sides} than simulated ones."
    return (
        f"{found.sentence} By this, real stops are on average {_metres(found.worth)} {sides} than simulated ones: "
        f"{share:.1f} % of {found.worth.stop_m:.0f} m."
    )


def _metres(worth: Worth, share: float | None = None) -> str:
    """Return a share of the stopping distance in metres; default: the share of `worth`."""
    metres = abs(worth.distance_share if share is None else share) * (worth.stop_m or 0.0)
    return f"{metres:.1f} m" if metres < 10.0 else f"{metres:.0f} m"


def worth_said(found: Diagnosis) -> str:
    """Return the change of a stop by the findings, in words."""
    if found.worth is not None:
        return _changes(found.worth)
    multiples = [one.multiple for one in found.mechanisms] + [one.multiple for one in found.discovered]
    sizes = _and([f"{multiple:.1f}" for multiple in multiples])
    return f"{sizes} times what matters in a stop: {100.0 * DISTANCE:.0f} % of its distance or {SLIP_MPS} m/s of slip"


def _changes(worth: Worth) -> str:
    share, parts = worth.distance_share, []
    if abs(share) < 0.0005:
        parts.append("no change of the stopping distance")
    else:
        metres = "" if worth.stop_m is None else f"{_metres(worth)}, "
        parts.append(f"{metres}{100.0 * abs(share):.1f} % {'more' if share > 0.0 else 'less'} stopping distance than simulated")
    if worth.interval90:
        low, high = (100.0 * bound for bound in worth.interval90)
        ends = [bound * (worth.stop_m or 0.0) / 100.0 for bound in (low, high)]
        metres = "" if worth.stop_m is None else f"{ends[0]:+.2g} to {ends[1]:+.2g} m, "
        parts[0] += f" (change {metres}{low:+.2g} to {high:+.2g} %, 90 %)"
    if len(worth.stops_m) > 1 and abs(share) >= 0.0005:
        by_size = sorted(worth.stops_m, key=lambda run: worth.stops_m[run])
        parts.append("from " + " to ".join(f"{worth.stops_m[run]:+.2g} m in {run}" for run in (by_size[0], by_size[-1])))
    if worth.slip_mps >= 0.005 or share == 0.0:  # less is printed as 0.00
        parts.append(f"a change of slip of {worth.slip_mps:.2f} m/s")
    return "; ".join(parts)


def confidence_said(found: Diagnosis) -> str:
    """Return the confidence of every name, in words, with failed held-out tests."""
    parts = [f"{one.name.replace('_', ' ')}: {_percent(one.confidence)}{_others(one)}{doubt(one)}" for one in found.mechanisms]
    parts += [f"{one.equation}: accepted on held-out runs{doubt(one)}" for one in found.discovered]
    return "; ".join(parts)


def _percent(confidence: float) -> str:
    return "above 99 %" if confidence > 0.99 else f"{100.0 * confidence:.0f} %"


def _others(one: Named) -> str:
    others = [name.replace("_", " ") for name in one.alternatives[1:]]
    return f", else {' or '.join(others)}" if others else ""


def doubt(one: Named | Discovered) -> str:
    """Return a remark if the held-out runs contradict a finding, else ""."""
    if one.held_out_gain >= 0.0:
        return ""
    return f", but its held-out test failed: chi-square rises by {-one.held_out_gain:.0f} there"


def removed_said(share: float | None) -> str:
    """Return the removed share of the held-out residual, in words."""
    whole = "what the baseline leaves beyond noise and normal variation in held-out runs"
    if share is None or math.isnan(share):
        return f"not measurable: there is too little of {whole}"
    if share < 0.005:
        return "none: the held-out runs fit no better"
    if share >= 0.995:
        return f"all of {whole}"
    rest = "; most of it is still there" if share < 0.5 else ""
    return f"{100.0 * share:.0f} % of {whole}{rest}"


def misfit_said(fit: FitQuality) -> str:
    """Return the misfit of the tuned law, in words, and that beside what was seen but is too small to matter."""
    held_out = "validate" in fit.baseline
    group = "validate" if held_out else max(fit.baseline, key=fit.baseline.__getitem__)
    runs = "held-out runs" if held_out else "the runs"
    law, beside = f"{fit.baseline[group]:.1f}", f"{fit.extended[group]:.1f}"
    told = f"mean squares in {runs} are {law} times what noise and normal variation leave"
    return told if beside == law else f"{told}, and {beside} times with what was seen but is too small to matter"


def where_said(found: Diagnosis) -> str:
    """Return the axles, runs and ranges of the findings, in words."""
    runs = [one.run for one in found.runs]
    axles = {cell["axle"] for cell in found.residuals.get("cells", ()) if cell["axle"]}
    own = named_axles(found)
    places = [one for one in found.location if one.share >= LEAST_SHARE]
    told = [place_said(one, runs, len(axles), own if i == 0 else ()) for i, one in enumerate(places[:_PLACES])]
    if not told and own:
        return axles_said(own, len(axles))
    return "; ".join(told)


def named_axles(found: Diagnosis) -> tuple[int, ...]:
    """Return the axles, from 1, that the first finding names itself; empty if it names none."""
    for one in found.mechanisms[:1]:
        whole = [parameter.name for parameter in ALL[one.name].parameters if parameter.kind == "axle"]
        return tuple(
            round(one.parameters[name].value) for name in whole if name in one.parameters and one.parameters[name].value
        )
    return next((one.axles for one in found.discovered), ())


def place_said(one: Location, runs: Sequence[str], axles: int, named: tuple[int, ...] = ()) -> str:
    """Return a location in words: axles (`named` ones take precedence), balance, runs and range."""
    parts = [] if one.equation == "vehicle" and not named else [axles_said(named or one.axles, axles)]
    parts.append(f"in the balance of {BALANCES.get(one.equation, one.equation)}")
    if one.runs:
        some = f"in run{'s' if len(one.runs) > 1 else ''} {_and(one.runs)}"
        parts.append("in every run" if set(runs) <= set(one.runs) else some)
    parts.append(one.where)
    return ", ".join(part for part in parts if part)


def axles_said(axles: Sequence[int], of: int) -> str:
    """Return axles in words."""
    if not axles:
        return ""
    if 1 < of <= len(axles):
        return "every axle"
    return f"axle{'s' if len(axles) > 1 else ''} {_and([str(axle) for axle in axles])}"


def _open(one: Discovered) -> str:
    """Return the known physics that a discovered term resembles, and the other slots in which it may act."""
    like = f"looks like {' or '.join(one.looks_like)}" if one.looks_like else ""
    slots = f"may as well act on {' or '.join(one.slots_not_separable)} as on {one.slot}" if one.slots_not_separable else ""
    text = " and ".join(filter(None, (like, slots)))
    return f"{one.equation} {text}" if text else ""


def _and(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else "".join(words)
