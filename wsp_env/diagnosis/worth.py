"""What the findings are worth in the recorded stops: the change of their stopping distances."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.accepted import Accepted
from wsp_env.diagnosis.answer import Worth
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.net import net_change
from wsp_env.diagnosis.trials import FORM, form_of
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import Campaign
from wsp_env.recordings.derive import braking

_Z90 = 1.645  # two-sided 90 % quantile of the normal distribution


def worth_of(outcome: Outcome, extended: Model, missing: Sequence[Accepted]) -> Worth:
    """Return the change of the recorded stops by all findings, against the law tuned without them.

    The share is that of all stops' braking distance together, so that times their mean distance it is the mean change.
    """
    off = dataclasses.replace(extended, choice={})
    size = net_change(outcome.replica, extended, off, outcome.last.whitening)
    ways = braked_m(outcome.replica.campaign)
    shares = dict(zip([stop.name for stop in outcome.replica.stops], size.stops, strict=True))
    known = {name: share for name, share in shares.items() if np.isfinite(share) and name in ways}
    run_m = sum(ways[name] for name in known)
    share = sum(ways[name] * one for name, one in known.items()) / run_m if run_m else size.distance
    deviations = [one.trial.found.deviation / np.maximum(np.abs(one.trial.found.multiple), 1e-9) for one in missing]
    forms = [0.0 if ALL[one.trial.variant.name].signature.exact else form_of(one.trial.variant) for one in missing]
    half = _Z90 * float(np.hypot(max(forms, default=FORM), max((one.max() for one in deviations), default=0.0))) * abs(share)
    stops_m = {name: ways[name] * one for name, one in known.items()}
    return Worth(share, (share - half, share + half), size.slip, run_m / len(known) if known else None, stops_m)


def braked_m(campaign: Campaign) -> dict[str, float]:
    """Return the recorded distance while braking [m] of each run that brakes."""
    ways = {}
    for name, run in campaign.runs.items():
        start, end = braking(run, campaign.sample_time_s)
        way = float(np.trapezoid(run.vehicle_speed_mps[start:end], run.time_s[start:end])) if end > start + 1 else np.nan
        if np.isfinite(way) and way > 0.0:
            ways[name] = way
    return ways
