"""What the mechanisms of an answer do to the stopping distances: comparable whatever the form of an effect."""

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import t as student

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.evaluate import Choice, Model
from wsp_env.diagnosis.interest import Compared, only_sensors
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.replay import braked
from wsp_env.evaluation.runner import Conduct, run
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Stop
from wsp_env.recordings import Campaign, Smoothing, conditions, derive, rolling_radii
from wsp_env.recordings.derive import braking
from wsp_env.recordings.tuning import RunScore, Tuning

#: Protections under which the stops are driven: it is not known which one the vehicle has.
PROTECTIONS = ("rule-based", "slip", "extremum")
_LEVEL = 0.95  # one-sided, of an interval of 90 %
_LEAST = 1e-4  # change at the recorded slip [-] that a share of can be taken


def distance_change(campaign: Campaign, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mean relative change of the stops' distances by all mechanisms found, with its interval of 90 %.

    The stops are driven with and without the mechanisms under several protections: a WSP moves the slip until the wheels find
    about the same adhesion again. The interval is that of one more protection (Student's, from how these differ), and of the
    parameters, whose share is taken from the change at the recorded slip.
    """
    chosen = {one["name"]: answer["model"]["mechanisms"][one["name"]] for one in answer["mechanisms"]}
    vehicle, stops, names = _stops(campaign, answer["model"])
    other = [_met(chosen, campaign, name) for name in names]
    changes = np.array([_driven(load(name), vehicle, stops, other) for name in PROTECTIONS])
    value, count = float(changes.mean()), len(changes)
    another = float(changes.std(ddof=1) * np.sqrt(1.0 + 1.0 / count) * student.ppf(_LEVEL, count - 1))
    half = float(np.hypot(another, abs(value) * _parameter_share(campaign, answer, chosen)))
    return {"value": value, "interval90": [value - half, value + half]}


def _stops(campaign: Campaign, model: Mapping[str, Any]) -> tuple[Vehicle, list[Stop], list[str]]:
    """Return the vehicle, the stops under the diagnosed law, from the call of the brake on, and their names."""
    runs = {name: RunScore("tune", mu_cd, True, ()) for name, mu_cd in model["mu_cd"].items()}
    tuned = Tuning(model["tau_m_per_J"], (0.0, math.inf), runs)  # the diagnosed law; its interval and errors play no part
    return braked(campaign, conditions(campaign, tuned))


def _driven(protection: Controller, vehicle: Vehicle, stops: Sequence[Stop], chosen: Sequence[Choice]) -> float:
    """Return the mean relative change of the distances [-] to standstill by the mechanisms that each stop meets."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        without = run(protection, vehicle, stops).position[-1]
        if all(one == chosen[0] for one in chosen):  # all side by side
            found = list(run(protection, vehicle, stops, Conduct(mechanisms=chosen[0])).position[-1])
        else:
            found = [_distance(protection, vehicle, stop, one) for stop, one in zip(stops, chosen, strict=True)]
    return float(np.mean(np.array(found) / without - 1.0))


def _distance(protection: Controller, vehicle: Vehicle, stop: Stop, chosen: Choice) -> float:
    return float(run(protection, vehicle, [stop], Conduct(mechanisms=chosen)).position[-1, 0])


def _met(chosen: Choice, campaign: Campaign, name: str) -> Choice:
    """Return the mechanisms as a stop meets them: a patch lies where it lies behind the call of the brake."""
    if "adhesion_patch" not in chosen:
        return chosen
    patch = chosen["adhesion_patch"]
    return {**chosen, "adhesion_patch": {**patch, "start_m": patch["start_m"] - _begin(campaign, name)}}


def _begin(campaign: Campaign, name: str) -> float:
    """Place [m] of the leading axle at the call of the brake."""
    recording, smoothing = campaign.runs[name], Smoothing()
    derived = derive(campaign, recording, rolling_radii(campaign, smoothing), smoothing)
    start, _ = braking(recording, campaign.sample_time_s, smoothing)
    return recording.start_position_m + float(np.trapezoid(derived.speed_mps[: start + 1], derived.time_s[: start + 1]))


def _parameter_share(campaign: Campaign, answer: Mapping[str, Any], chosen: Choice) -> float:
    """Half the interval of the change at the recorded slip by the parameters', over that change [-].

    Each parameter is moved alone between the ends of its interval, their shares are added as squares.
    """
    reported = answer["model"]
    replicas = [
        Replica(Balances(campaign, [stop]), Model(reported["tau_m_per_J"], (reported["mu_cd"][stop.name],), chosen))
        for stop in prepare(campaign)[0]
        if stop.name in reported["mu_cd"]
    ]

    def at(choice: Choice) -> float:
        return float(np.mean([_recorded(one, choice) for one in replicas]))

    value, squares = at(chosen), 0.0
    for one in answer["mechanisms"]:
        for name, parameter in one["parameters"].items():
            low, high = parameter["interval90"]
            if high > low:
                ends = [at({**chosen, one["name"]: {**chosen[one["name"]], name: end}}) for end in (low, high)]
                squares += ((ends[1] - ends[0]) / 2.0) ** 2
    return float(np.sqrt(squares)) / max(abs(value), _LEAST)


def _recorded(replica: Replica, choice: Choice) -> float:
    """Return the relative change of one stop's distance [-] at the recorded slip, by mechanisms beside the same law."""
    before, after = (replica.evaluate(dataclasses.replace(replica.baseline, choice=one)) for one in ({}, choice))
    return Compared(replica, before).change(after, only_sensors(choice)).distance
