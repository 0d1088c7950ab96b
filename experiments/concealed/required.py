"""What the proof has to show, figure by figure, and whether it does."""

from typing import Any, NamedTuple

from experiments.concealed.rates import NO_CASE, Rate, percent, put

#: Cases and nulls that the bank needs for these figures to count.
CASES, NULLS = 200, 60
DISTANCES = "90 % intervals of the change of stopping distance cover (effects whose parameters are not comparable)"
#: In place of a bound, where a figure is told but none is required of it.
TOLD = "none"


class Check(NamedTuple):
    """One figure against what is required of it."""

    what: str
    required: str
    measured: str
    met: bool | None  # None: nothing to measure, or nothing required

    @property
    def mark(self) -> str:
        """Whether it is met, in words."""
        if self.met is None:
            return "" if self.required == TOLD else "nothing to measure"
        return "yes" if self.met else "**no**"


def most(what: str, one: Rate, bound: float) -> Check:
    """Require a share of at most a bound."""
    return Check(what, f"at most {100 * bound:g} %", put(one), None if one.share is None else one.share <= bound)


def least(what: str, one: Rate, bound: float) -> Check:
    """Require a share of at least a bound."""
    return Check(what, f"at least {100 * bound:g} %", put(one), None if one.share is None else one.share >= bound)


def covers(what: str, one: Rate) -> Check:
    """Require of intervals of 90 % what such intervals may be found to cover."""
    return Check(what, "85 to 97 %", put(one), None if one.share is None else 0.85 <= one.share <= 0.97)


def told(what: str, one: Rate | str) -> Check:
    """Require nothing."""
    return Check(what, TOLD, one if isinstance(one, str) else put(one), None)


def common(promised: dict[str, Any]) -> list[Check]:
    """Compare the figures that every set of campaigns has with what is required."""
    removed, sizes = promised["outside_removed"], promised["parameters"]
    median, error = removed["median"], sizes["relative_error"]["median"]
    return [
        told("campaigns", _counted(promised["cases"])),
        most("false alarms on nulls", promised["false_alarms"], 0.05),
        least("library: right name in a set of at most two, singles that matter", promised["singles_in_set_of_two"], 0.9),
        told("library: right name first, the same", promised["singles_first"]),
        told("library: nothing named, the same", promised["singles_missed"]),
        most("a name that is not there, all answers", promised["not_there"], 0.1),
        told("a name that is not there, where all that is missing has a name", promised["not_there_library"]),
        least("library: both of a pair found", promised["pairs_both"], 0.8),
        told("library and outside together: the library's name kept", promised["mixed_kept"]),
        most("outside the library: wrong name", promised["outside_named"], 0.1),
        told("outside the library: seen", promised["outside_seen"]),
        least("outside the library: slot and axles right", promised["outside_placed"], 0.75),
        Check(
            "outside the library: held-out residual removed, median", "at least 70 %", _of(removed, percent(median)),
            None if median is None else median >= 0.7,
        ),
        Check(
            "error of comparable parameters, median", "at most 20 %", _of(sizes["relative_error"], percent(error)),
            None if error is None else error <= 0.2,
        ),
        covers("90 % intervals of comparable parameters cover", sizes["interval90_covers"]),
        told("calibration error of the stated confidence", _calibration(promised["calibration"])),
        *_faults(promised["faults"]),
        told("seconds per campaign, median and largest", _seconds(promised["seconds"])),
    ]  # fmt: skip


def _counted(cases: dict[str, int]) -> str:
    return f"{sum(cases.values())}: " + ", ".join(f"{count} {kind}" for kind, count in cases.items() if count)


def _of(values: dict[str, Any], words: str) -> str:
    return f"{words} (of {values['count']})" if values["count"] else NO_CASE


def _calibration(one: dict[str, Any]) -> str:
    return f"{one['expected_error']:.3f} (of {one['claims']} names)" if one["claims"] else "nothing was named"


def _seconds(values: dict[str, Any]) -> str:
    return f"{values['median']:.0f} s, {values['highest']:.0f} s" if values["count"] else "not measured"


def _faults(faults: dict[str, dict[str, Rate]]) -> list[Check]:
    if not faults["all"]["as_data"].of:
        return []
    ways = (("as_data", "found as data"), ("as_physics", "named as physics"))
    return [told(f"channel faults, {kind}: {words}", one[key]) for kind, one in faults.items() for key, words in ways]


def checks(figures: dict[str, Any]) -> list[Check]:
    """Compare the figures of the bank's `score` with what is required: the common ones, then those that only it has."""
    cases, separable, removed = figures["cases"], figures["separable"], figures["removed_share"]
    abnormal, total = figures["separable_beyond_variation"], sum(figures["cases"].values())
    sums = removed["of_sums"]
    return [
        *common(figures["promised"]),
        Check("cases, nulls among them", f"{CASES}, {NULLS}", f"{total}, {cases['null']}",
              total >= CASES and cases["null"] >= NULLS),
        least("right name first, separable singles from twice the smallest effect", separable["right_name_first"], 0.9),
        least("truth inside a reported set, the same cases", separable["in_set"], 0.95),
        least("right name first, those of them beyond normal variation", abnormal["right_name_first"], 0.9),
        least("truth inside a reported set, beyond normal variation", abnormal["in_set"], 0.95),
        Check("removable held-out residual removed, sum over singles and pairs", "at least 85 %", percent(sums),
              None if sums is None else sums >= 0.85),
        covers(DISTANCES, figures["distance_change"]["interval90_covers"]),
    ]  # fmt: skip
