"""What the mechanisms of an answer do to the stopping distances: comparable whatever the form of an effect."""

from typing import Any

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.evaluate import Choice, Model
from wsp_env.diagnosis.interest import effect
from wsp_env.diagnosis.stops import prepare
from wsp_env.recordings import Campaign


def distance_change(campaign: Campaign, answer: dict[str, Any]) -> dict[str, Any]:
    """Return the mean relative change of the stops' distances by all mechanisms found, with its interval of 90 %.

    At the slip that was recorded: what a WSP makes of the change is not in it. The interval is that of the parameters, each
    moved alone between its ends, their shares added as squares.
    """
    told = answer["model"]
    stops = [
        (Balances(campaign, [stop]), told["mu_cd"][stop.name]) for stop in prepare(campaign)[0] if stop.name in told["mu_cd"]
    ]

    def change(choice: Choice) -> float:
        changes = [effect(balances, Model(told["tau_m_per_J"], (mu,)), choice).distance for balances, mu in stops]
        return float(np.mean(changes))

    chosen = {one["name"]: told["mechanisms"][one["name"]] for one in answer["mechanisms"]}
    value, squares = change(chosen), 0.0
    for one in answer["mechanisms"]:
        for name, parameter in one["parameters"].items():
            low, high = parameter["interval90"]
            if high > low:
                ends = [change(chosen | {one["name"]: chosen[one["name"]] | {name: end}}) for end in (low, high)]
                squares += ((ends[1] - ends[0]) / 2.0) ** 2
    half = float(np.sqrt(squares))
    return {"value": value, "interval90": [value - half, value + half]}
