"""Shares with their bounds, spreads of values, and how both are written down and read again."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

#: What stands for a figure where nothing was measured.
NO_CASE = "no such case"


class Rate(NamedTuple):
    """How often something happened, with the 95 % bounds of Clopper and Pearson, each one-sided."""

    events: int
    of: int
    share: float | None
    lower95: float
    upper95: float


def rate(happened: Iterable[bool]) -> Rate:
    """Count."""
    events = [bool(event) for event in happened]
    k, n = sum(events), len(events)
    lower = float(beta.ppf(0.05, k, n - k + 1)) if k > 0 else 0.0
    upper = float(beta.ppf(0.95, k + 1, n - k)) if k < n else 1.0
    return Rate(k, n, k / n if n else None, lower, upper)


def spread(values: Sequence[float]) -> dict[str, Any]:
    """Return number, mean, median and ends of some values; None where there is none."""
    if not values:
        return {"count": 0, "mean": None, "median": None, "lowest": None, "highest": None}
    return {"count": len(values), "mean": float(np.mean(values)), "median": float(np.median(values)),
            "lowest": float(min(values)), "highest": float(max(values))}  # fmt: skip


def percent(share: float | None) -> str:
    """Put a share in words."""
    return "none" if share is None else f"{share:.1%}".replace("%", " %")


def put(one: Rate) -> str:
    """Put a rate with its bounds in words."""
    if one.share is None:
        return NO_CASE
    return f"{percent(one.share)} ({one.events} of {one.of}; {percent(one.lower95)} to {percent(one.upper95)})"


def plain(value: Any) -> Any:
    """Return figures as JSON takes them: rates with their fields' names."""
    if isinstance(value, Rate):
        return value._asdict()
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list) else value


def restored(value: Any) -> Any:
    """Return figures with their rates, from what `plain` made of them."""
    if isinstance(value, dict):
        if set(value) == set(Rate._fields):
            return Rate(**value)
        return {key: restored(one) for key, one in value.items()}
    return [restored(one) for one in value] if isinstance(value, list) else value
