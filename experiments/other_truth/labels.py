"""What is true of a campaign, as `python -m experiments.concealed outside` reads it, and all else that was drawn."""

from typing import Any

from experiments.other_truth.brakes import CHARACTERS, PROTECTIONS
from experiments.other_truth.campaign import Campaign
from experiments.other_truth.effects import EFFECTS, SLOTS
from experiments.other_truth.record import Recorders
from experiments.other_truth.sizes import Concealed
from experiments.other_truth.sound import SOUND


def label(
    campaign: Campaign, kind: str, concealed: list[Concealed], recorders: Recorders, mu_cd: dict[str, float]
) -> dict[str, Any]:
    """Return the label; `mu_cd` is the true one by run."""
    content: dict[str, Any] = {"effects": [one.effect for one in concealed], "kind": kind}
    for one in concealed:
        effect = EFFECTS[one.effect]
        if not effect.library:
            content["slot"] = SLOTS[effect.slot]
            if content["slot"] in ("brake torque", "friction"):
                content["axle"] = [axle + 1 for axle in one.axles]
        if effect.parameter:
            axle = {"axle": one.axles[0] + 1} if effect.axle else {}
            content.setdefault("params", {})[one.effect] = {effect.parameter: one.size} | axle
    if any(one.too_small for one in concealed):
        content["matters"] = False
    return content | {
        "details": [_details(campaign, one) for one in concealed],
        "sound": {kind: {"size": SOUND[kind].size, "of": SOUND[kind].of} for kind in campaign.sound},
        "seed": campaign.seed,
        "axles": campaign.axles,
        "sample_rate_hz": recorders.rate_hz,
        "torque": recorders.torque,
        "starts_known": recorders.starts_known,
        "noise": recorders.noise,
        "protection": PROTECTIONS[campaign.protection.kind],
        "brake": CHARACTERS[campaign.brake.character],
        "tau_m_per_j": campaign.runs[0].tau_m_per_j,
        "mu_cd": mu_cd,
    }


def _details(campaign: Campaign, one: Concealed) -> dict[str, Any]:
    effect = EFFECTS[one.effect]
    return {
        "effect": one.effect,
        "size": one.size,
        "unit": effect.unit,
        "axles": [axle + 1 for axle in one.axles],
        "others": {name: getattr(campaign.places, name) for name in effect.others},
        "aimed": one.aimed,
        "reached": one.reached,
        "length_changes": one.length_changes,
        "slip_changes_mps": one.slip_changes_mps,
    }
