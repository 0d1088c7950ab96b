"""The search's state: what was found so far, and the recordings with that mended, so that one fault is told once."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.recording import Recording
from wsp_env.recordings.suspect.channel import SuspectChannel
from wsp_env.recordings.suspect.own_balance import OwnBalance, own_balances
from wsp_env.recordings.suspect.traces import Traces, thinned, traces

#: Lost over explained momentum is taken from stops that lose at least so much of their speed [-].
_LEAST_LOST = 0.05


class Search:
    """A campaign while its channels are looked at."""

    def __init__(self, campaign: Campaign) -> None:
        """Take the campaign's runs while the vehicle moves, one sample in every hundredth of a second."""
        self.campaign = campaign
        radius = campaign.vehicle.wheel_radius_m
        self.runs: dict[str, Recording] = {name: thinned(run.under_way(radius)) for name, run in campaign.runs.items()}
        self.found: list[SuspectChannel] = []
        self._traces: dict[str, Traces | None] = {}
        self._own: dict[str, list[OwnBalance | None]] = {}

    @property
    def axles(self) -> int:
        """Number of axles."""
        return self.campaign.vehicle.axles

    def sound(self, name: str) -> list[int]:
        """Return the axles (from 0) of a run whose channels are there."""
        return [k for k in range(self.axles) if k + 1 not in self.runs[name].missing_axles]

    def traces(self) -> dict[str, Traces]:
        """Return what can be looked at of every run, as mended so far."""
        for name, run in self.runs.items():
            if name not in self._traces:
                self._traces[name] = traces(self.campaign, run)
        return {name: one for name, one in self._traces.items() if one is not None}

    def own_balances(self) -> dict[str, list[OwnBalance | None]]:
        """Return what each wheel's own balance says in every run, as mended so far; None for missing axles too."""
        for name, one in self.traces().items():
            if name not in self._own:
                here = self.sound(name)
                self._own[name] = [b if k in here else None for k, b in enumerate(own_balances(self.campaign, one))]
        return {name: self._own[name] for name in self.traces()}

    def report(self, suspect: SuspectChannel) -> None:
        """Keep what was found."""
        self.found.append(suspect)

    def blind(self, name: str, axle: int) -> None:
        """Look at an axle (from 0) of a run no more; it stands in as the others' median does."""
        run = self.runs[name]
        others = [k for k in self.sound(name) if k != axle]
        if not others:
            return
        self.mend(
            name,
            missing_axles=tuple(sorted({*run.missing_axles, axle + 1})),
            wheel_speed_radps=with_column(run.wheel_speed_radps, axle, np.median(run.wheel_speed_radps[:, others], axis=1)),
            brake_torque_nm=with_column(run.brake_torque_nm, axle, np.median(run.brake_torque_nm[:, others], axis=1)),
        )

    def mend(self, name: str, **changes: object) -> None:
        """Go on with a run's channels changed."""
        self.runs[name] = dataclasses.replace(self.runs[name], **changes)  # type: ignore[arg-type]  # fields by name
        self._traces.pop(name, None)
        self._own.pop(name, None)

    def explained(self, name: str, torque: np.ndarray | None = None) -> float:
        """Return what a run's momentum asks of the brakes over what was recorded of them [-]; nan where hardly any is lost."""
        run, vehicle = self.runs[name], self.campaign.vehicle
        torque = run.brake_torque_nm if torque is None else torque
        duration = float(run.time_s[-1] - run.time_s[0])
        ends = max(round(0.2 / (duration / (len(run.time_s) - 1))), 1)  # single samples are noise
        speed, wheel = run.vehicle_speed_mps, run.wheel_speed_radps
        drop = float(speed[:ends].mean() - speed[-ends:].mean())
        if abs(drop) < _LEAST_LOST * float(np.abs(speed).max()):
            return np.nan
        a, b, c = vehicle.resistance_n
        lost = run.mass_kg * drop
        lost -= (run.mass_kg * vehicle.gravity_mps2 * run.gradient + float(np.mean(a + b * speed + c * speed**2))) * duration
        spun = vehicle.wheelset_inertia_kgm2 * float((wheel[-ends:].mean(axis=0) - wheel[:ends].mean(axis=0)).sum())
        braked = float(torque.mean(axis=0).sum()) * duration
        return (lost * vehicle.wheel_radius_m - spun) / braked if braked else np.inf


def with_column(values: np.ndarray, axle: int, column: np.ndarray) -> np.ndarray:
    """Return values (T, A) with the column of one axle (from 0) exchanged."""
    changed = values.copy()
    changed[:, axle] = column
    return changed


def agreed(values: Mapping[str, float]) -> float:
    """Return the median of what several runs say; nan of none."""
    known = [value for value in values.values() if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan


def named(name: str, options: Mapping[float, str], value: float, tolerance: float) -> tuple[float, str]:
    """Return the factor of the options that is nearest to a value, and its name; (nan, "") where none is near."""
    if not value > 0.0 or not options:
        return np.nan, ""
    best = min(options, key=lambda factor: abs(np.log(value / factor)))
    return (best, options[best].format(name=name)) if abs(np.log(value / best)) < np.log1p(tolerance) else (np.nan, "")
