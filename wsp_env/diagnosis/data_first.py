"""Suspect channels before suspect physics: a faulty channel is told and the diagnosis ends, before it is named a mechanism."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from wsp_env.diagnosis.answer import Diagnosis, FitQuality
from wsp_env.recordings import Campaign
from wsp_env.recordings.suspect import SuspectChannel, suspects

#: Faults that need no answer: the reader leaves such axles out, and the rest is diagnosed.
_LEFT_OUT = ("dead",)
_TOLD = 3  # suspicions in the sentence


class DataFirst(NamedTuple):
    """What the channels say before any physics is looked at."""

    suspects: tuple[SuspectChannel, ...]
    answer: Diagnosis | None  # the whole of it, where the recordings must be mended first


def data_first(campaign: Campaign) -> DataFirst:
    """Look for suspect channels; with an answer where physics would be named from faults."""
    found = suspects(campaign)
    if all(one.kind in _LEFT_OUT for one in found):
        return DataFirst(found, None)
    return DataFirst(found, _answer(campaign, found))


def data_sentence(found: Sequence[SuspectChannel]) -> str:
    """Return the verdict `data` in one sentence."""
    told = "; ".join(f"{one.channel}: {one.suspicion}" for one in found[:_TOLD])
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return f"The recordings contradict themselves as no physics does, so nothing is said on physics: {told}{more}."


def data_test(found: Sequence[SuspectChannel]) -> str:
    """Return what to do next: mend the channels."""
    return "; ".join(dict.fromkeys(one.remedy for one in found)) + "; then diagnose again"


def _answer(campaign: Campaign, found: tuple[SuspectChannel, ...]) -> Diagnosis:
    told = tuple(one for one in found if one.kind not in _LEFT_OUT)
    return Diagnosis(
        campaign=campaign.name,
        verdict="data",
        sentence=data_sentence(told),
        mechanisms=(),
        location=(),
        fit=FitQuality(1.0, {}, {}, None),
        detectable={},
        next_test=data_test(told),
        evidence=(),
        model=_believed(campaign),
        residuals={"cells": [], "places": []},
        runs=(),
        notes=tuple(sentence for run in campaign.runs.values() for sentence in run.warnings),
        suspect_channels=found,
    )


def _believed(campaign: Campaign) -> dict[str, object]:
    """Return what was believed before, for model.json: nothing is tuned on recordings that contradict themselves."""
    vehicle = dataclasses.asdict(campaign.vehicle)
    return {
        "mu_cd": {name: run.kinetic_friction_d for name, run in campaign.runs.items()},
        "mechanisms": {},
        "contact": dataclasses.asdict(campaign.contact),
        "vehicle": {key: list(value) if isinstance(value, tuple) else value for key, value in vehicle.items()},
    }
