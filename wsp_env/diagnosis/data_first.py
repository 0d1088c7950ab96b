"""Suspect channels before physics: a faulty channel ends the diagnosis, before its fault is taken for a mechanism."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from wsp_env.diagnosis.answer import Diagnosis, FitQuality
from wsp_env.recordings import Campaign
from wsp_env.recordings.errors import ContradictionError
from wsp_env.recordings.suspect import SuspectChannel, suspects
from wsp_env.recordings.suspect.channel import where

#: Faults that do not end the diagnosis: the reader leaves these axles out, and the others are diagnosed.
_LEFT_OUT = ("dead",)
_TOLD = 3  # largest number of suspicions in the sentence


class DataFirst(NamedTuple):
    """Result of the channel check."""

    suspects: tuple[SuspectChannel, ...]
    answer: Diagnosis | None  # the complete answer if the recordings must be repaired first, else None


def data_first(campaign: Campaign) -> DataFirst:
    """Check for suspect channels; add an answer if their faults would be taken for physics."""
    refused = contradictions(campaign)
    # Channels of the wrong sign cannot be compared with others.
    found = () if any(one.value < 0.0 for one in refused) else suspects(campaign)
    told = {(one.channel, run) for one in found for run in one.runs}
    found += tuple(one for one in refused if any((one.channel, run) not in told for run in one.runs))
    if all(one.kind in _LEFT_OUT for one in found):
        return DataFirst(found, None)
    return DataFirst(found, _answer(campaign, found))


def contradictions(campaign: Campaign) -> tuple[SuspectChannel, ...]:
    """Return what would have been refused when the campaign was read: channels in another unit or of the wrong sign."""
    told: dict[tuple[str, str], tuple[ContradictionError, list[str]]] = {}
    for name, run in campaign.runs.items():
        if (error := run.contradiction) is not None:
            told.setdefault((error.channel, error.remedy), (error, []))[1].append(name)
    return tuple(
        SuspectChannel(
            error.channel, error.suspicion.removeprefix("is ").removesuffix("?") + where(names, campaign.runs), error.remedy,
            "unit", _axle_of(error.channel), error.factor, tuple(names),
        )
        for error, names in told.values()
    )  # fmt: skip


def _axle_of(channel: str) -> int:
    """Return the axle of a channel, from 1; 0: the vehicle, or every axle."""
    first = channel.partition("_")[0].removeprefix("axle")
    return int(first) if first.isdigit() else 0


def data_sentence(found: Sequence[SuspectChannel]) -> str:
    """Return the verdict `data` in one sentence."""
    told = "; ".join(f"{one.channel}: {one.suspicion}" for one in found[:_TOLD])
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return f"The recordings contradict themselves as no physics does, so nothing is said on physics: {told}{more}."


def data_test(found: Sequence[SuspectChannel]) -> str:
    """Return the next step: repair the channels."""
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
    """Return the believed values for model.json; contradictory recordings are not used for tuning."""
    vehicle = dataclasses.asdict(campaign.vehicle)
    return {
        "mu_cd": {name: run.kinetic_friction_d for name, run in campaign.runs.items()},
        "mechanisms": {},
        "contact": dataclasses.asdict(campaign.contact),
        "vehicle": {key: list(value) if isinstance(value, tuple) else value for key, value in vehicle.items()},
    }
