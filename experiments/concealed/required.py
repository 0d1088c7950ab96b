"""What the proof has to show, figure by figure, and whether it does."""

from typing import Any, NamedTuple

from experiments.concealed.score import Rate

#: Cases and nulls that a bank needs for these figures to count.
CASES, NULLS = 200, 60
DISTANCES = "90 % intervals of the change of stopping distance cover (effects whose parameters are not comparable)"


class Check(NamedTuple):
    """One figure against what is required of it."""

    what: str
    required: str
    measured: str
    met: bool | None  # None: nothing to measure


def percent(share: float | None) -> str:
    """Put a share in words."""
    return "none" if share is None else f"{share:.1%}".replace("%", " %")


def put(rate: Rate) -> str:
    """Put a rate with its bounds in words."""
    if rate.share is None:
        return "no such case"
    return f"{percent(rate.share)} ({rate.events} of {rate.of}; {percent(rate.lower95)} to {percent(rate.upper95)})"


def checks(figures: dict[str, Any]) -> list[Check]:
    """Compare the figures of `score` with what is required."""
    cases, separable, removed = figures["cases"], figures["separable"], figures["removed_share"]
    abnormal = figures["separable_beyond_variation"]
    total, parameters = sum(cases.values()), figures["parameters"]
    median = parameters["relative_error"]["median"]

    def most(what: str, rate: Rate, bound: float) -> Check:
        return Check(what, f"at most {100 * bound:g} %", put(rate), None if rate.share is None else rate.share <= bound)

    def least(what: str, rate: Rate, bound: float) -> Check:
        return Check(what, f"at least {100 * bound:g} %", put(rate), None if rate.share is None else rate.share >= bound)

    def least_share(what: str, share: float | None, bound: float) -> Check:
        return Check(what, f"at least {100 * bound:g} %", percent(share), None if share is None else share >= bound)

    def most_share(what: str, share: float | None, bound: float) -> Check:
        return Check(what, f"at most {100 * bound:g} %", percent(share), None if share is None else share <= bound)

    def covers(what: str, rate: Rate) -> Check:
        return Check(what, "85 to 97 %", put(rate), None if rate.share is None else 0.85 <= rate.share <= 0.97)

    enough = total >= CASES and cases["null"] >= NULLS
    return [
        Check("cases, nulls among them", f"{CASES}, {NULLS}", f"{total}, {cases['null']}", enough),
        most("false alarms on nulls", figures["false_alarms"], 0.05),
        least("right name first, separable singles from twice the smallest effect", separable["right_name_first"], 0.9),
        least("truth inside a reported set, the same cases", separable["in_set"], 0.95),
        least("right name first, those of them beyond normal variation", abnormal["right_name_first"], 0.9),
        least("truth inside a reported set, beyond normal variation", abnormal["in_set"], 0.95),
        most("out-of-library effects called by a library name", figures["foreign_named_wrongly"], 0.1),
        least("both of a pair found", figures["pairs_both_found"], 0.8),
        least_share("removable held-out residual removed, mean of those named", removed["named"]["mean"], 0.85),
        least_share("the same, sum over singles and pairs, named or not", removed["of_sums"], 0.85),
        most_share("error of comparable parameters, median", median, 0.2),
        covers("90 % intervals of comparable parameters cover", parameters["interval90_covers"]),
        covers(DISTANCES, figures["distance_change"]["interval90_covers"]),
    ]  # fmt: skip
