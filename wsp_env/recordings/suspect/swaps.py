"""Wheels exchanged between axles: each one's balance holds with the other's torque."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.own_balance import OwnBalance
from wsp_env.recordings.suspect.search import Search, with_column

_BETTER = 0.1  # of the correlations' sum that exchanging two axles must gain for each


def find(search: Search) -> None:
    """Find wheels whose own balance holds with another axle's torque, and these the other way round."""
    everywhere: dict[tuple[int, int], list[str]] = {}
    balances = search.own_balances()
    for name, several in balances.items():
        for pair in _swapped([several]):
            everywhere.setdefault(pair, []).append(name)
    for pair in _swapped(list(balances.values())):
        lively = [name for name, several in balances.items() if all(several[k] is not None for k in pair)]
        if len(everywhere.get(pair, [])) > 0.5 * len(lively):
            everywhere[pair] = list(search.runs)
    for (a, b), names in sorted(everywhere.items()):
        search.report(
            SuspectChannel(
                f"axle{a + 1}_wheel_speed",
                f"goes with the torque of axle {b + 1}, and that axle's wheel with the torque of axle {a + 1}"
                f"{where(names, search.runs)}: exchanged",
                f"exchange the columns of axle{a + 1}_wheel_speed and axle{b + 1}_wheel_speed, or of the torques",
                "swap", a + 1, float(b + 1), tuple(names),
            )
        )  # fmt: skip
        for name in names:
            wheel = search.runs[name].wheel_speed_radps
            search.mend(name, wheel_speed_radps=with_column(with_column(wheel, a, wheel[:, b]), b, wheel[:, a]))


def _swapped(runs: Sequence[list[OwnBalance | None]]) -> list[tuple[int, int]]:
    """Return the pairs of axles (from 0) whose torques fit each other's wheels better, over some runs."""
    if not runs:
        return []
    axles = len(runs[0])
    fit, weight = np.zeros((axles, axles)), np.zeros(axles)
    for several in runs:
        for k, one in enumerate(several):
            if one is not None:
                fit[k] += one.samples * one.others
                weight[k] += one.samples
    seen = np.flatnonzero(weight)
    if len(seen) < 2:
        return []
    part = (fit[seen] / weight[seen, None])[:, seen]
    _, torque = linear_sum_assignment(-part)
    pairs = [(i, int(j)) for i, j in enumerate(torque) if i < j and torque[j] == i]
    gain = [(part[i, j] - part[i, i], part[j, i] - part[j, j]) for i, j in pairs]
    return [(int(seen[i]), int(seen[j])) for (i, j), both in zip(pairs, gain, strict=True) if min(both) > _BETTER]
