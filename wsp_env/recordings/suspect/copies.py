"""One axle's channel in the place of another's: identical or proportional, down to the noise."""

import numpy as np

from wsp_env.recordings.quality import describe
from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.search import Search
from wsp_env.recordings.suspect.traces import LEAST_SPEED_MPS

#: Correlation of third differences: a copy has no noise of its own. Brakes vented together reach 0.96 at 25 samples a second.
_COPIED = 0.99
_NOISY = 5e-5  # noise below this share of the range is that of a simulation: wheels alike then are truly alike
_CONTRADICTS = 0.15  # by which a balance's correlation is worse: simulated sound stops differ by 0.05 between axles
_CHANNELS = {"wheel_speed": "wheel_speed_radps", "brake_torque": "brake_torque_nm"}


def find(search: Search) -> None:
    """Find copies; the axles concerned are looked at no more."""
    for channel, field in _CHANNELS.items():
        seen: dict[tuple[int, int], list[str]] = {}
        for name in search.runs:
            for pair in _pairs(search, name, field):
                seen.setdefault(pair, []).append(name)
        if channel == "brake_torque" and _by_bogie(search, seen):
            continue  # one pressure sensor of a bogie stands for both its axles
        for pair, names in seen.items():
            _tell(search, channel, pair, names)


def _pairs(search: Search, name: str, field: str) -> list[tuple[int, int]]:
    run = search.runs[name]
    values = getattr(run, field)
    moving = np.abs(run.vehicle_speed_mps) > LEAST_SPEED_MPS
    here = [k for k in search.sound(name) if describe(values[:, k]).noise > _NOISY * max(float(np.ptp(values[:, k])), 1e-12)]
    rough = np.diff(values[moving], n=3, axis=0)
    if len(rough) < 100:
        return []
    found = []
    for i, a in enumerate(here):
        for b in here[i + 1 :]:
            x, y = _clipped(rough[:, a]), _clipped(rough[:, b])
            if x @ y > _COPIED * np.sqrt((x @ x) * (y @ y)):
                found.append((a, b))
    return found


def _clipped(values: np.ndarray) -> np.ndarray:
    """Return values within five times their usual size: single spikes that two channels share are no copy."""
    size = 5.0 * max(float(np.median(np.abs(values))), 1e-12)
    return np.clip(values, -size, size)


def _by_bogie(search: Search, seen: dict[tuple[int, int], list[str]]) -> bool:
    """Whether identical channels are those of neighbours, every axle has one, and in every run: one sensor a bogie."""
    bogies = {(k, k + 1) for k in range(0, search.axles - 1, 2)}
    return (
        search.axles > 2
        and search.axles % 2 == 0
        and set(seen) == bogies
        and all(len(names) == len(search.runs) for names in seen.values())
    )


def _tell(search: Search, channel: str, pair: tuple[int, int], names: list[str]) -> None:
    copy, source = pair[::-1] if _fit(search, pair[0], names) >= _fit(search, pair[1], names) else pair
    sure = abs(_fit(search, copy, names) - _fit(search, source, names)) > _CONTRADICTS
    name = f"axle{copy + 1}_{channel}"
    doubt = "" if sure else " (or the other way round)"
    search.report(
        SuspectChannel(
            name,
            f"the same signal as axle{source + 1}_{channel} down to the noise{where(names, search.runs)}{doubt}",
            f"map {name} to that axle's own column in [channels]; without one, give missing_axles = [{copy + 1}] in [vehicle]",
            "copy", copy + 1, float(source + 1), tuple(names),
        )
    )  # fmt: skip
    for run in names:
        search.blind(run, copy)


def _fit(search: Search, axle: int, names: list[str]) -> float:
    """How well an axle's torque goes with its wheel: correlation in the wheel's own balance, 1 where nothing is seen."""
    balances = search.own_balances()
    known = [one.at_rest for name in names if name in balances and (one := balances[name][axle]) is not None]
    return float(np.mean(known)) if known else 1.0
