"""A brake beside the discs that the recorded torque does not contain: the electrodynamic brake of motored axles.

Its torque is constant above a blending speed and proportional to the wheel speed below, like the motor's voltage (dynamic
brakes fade below about 5 m/s, where the pneumatic brake takes over: blending). It acts while the disc brake of its axle is
applied. Its share rises to 1 at the torque from which a brake counts as applied. It is off while the WSP vents the axle. Form
and sizes: assumption.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from wsp_env.compiled import inlined
from wsp_env.plant.card import (
    APPLIED_SHARE,
    Card,
    Doing,
    Parameter,
    Recorded,
    Said,
    Signature,
    all_or_each_axle,
    concerns,
    itself,
    never,
    whose,
)

#: Blending speeds that are tried in recordings [m/s] (assumption). The first is tried for all axles together only: on one axle,
#: recordings above walking pace cannot distinguish it from a constant torque.
_BLENDING_MPS = (5.0, 10.0, 20.0)


class Parameters(NamedTuple):
    """Parameters of the brake, see `CARD`."""

    torque_nm: float
    axle: float
    blending_mps: float
    last_axle: float


@inlined
def torque(p: Parameters, i: int, k: int, torque_nm: float, doing: Doing) -> float:
    """Torque of axle k [N m]."""
    if p.torque_nm == 0.0 or not (concerns(p.axle, k) or p.axle < k + 1.0 <= p.last_axle):
        return torque_nm
    applied = min(max(doing.believed_torque / (APPLIED_SHARE * doing.full_torque), 0.0), 1.0)
    return torque_nm + p.torque_nm * applied * min(doing.radius_m * doing.wheel / p.blending_mps, 1.0)


def at_speeds(recorded: Recorded) -> list[dict[str, float]]:
    """Return the axles and blending speeds that are tried: all axles, each, and each bogie of two of several."""
    bogies = [{"axle": k + 1.0, "last_axle": k + 2.0} for k in range(0, recorded.axles - 1, 2)] if recorded.axles > 2 else []
    return [
        {"last_axle": 0.0} | axle | {"blending_mps": speed}
        for axle in [*all_or_each_axle(recorded), *bogies]
        for speed in _BLENDING_MPS[int(axle["axle"] > 0.0) :]
    ]


def whose_torque(values: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the axles in words, for the sentence."""
    last = values.get("last_axle", 0.0)
    return {"whose": f"axles {values['axle']:.0f} and {last:.0f}'s"} if last else whose(values)


CARD = Card(
    name="blended_brake",
    summary="an electrodynamic brake acts beside the discs, above a blending speed in full",
    parameters=(
        Parameter("torque_nm", "N m", 0.0, 1000.0, 0.0, 2e4, "assumption: per axle; a sixth of a coach's full torque"),
        Parameter("axle", "-", 0.0, 0.0, 0.0, 64.0, "assumption: which wheelset, from 1; 0: all", "axle"),
        Parameter("blending_mps", "m/s", 10.0, 10.0, 0.5, 100.0, "assumption: it fades below", "shape", refit_step=0.5),
        Parameter("last_axle", "-", 0.0, 0.0, 0.0, 64.0, "assumption: from `axle` to this one; 0: that one alone", "axle"),
    ),
    record=Parameters,
    acts={"torque": torque},
    recalls=never,
    signature=Signature(
        balances=frozenset({"vehicle", "adhesion"}),
        trace="vehicle with adhesion: a torque while braking that follows no pressure and fades with speed",
        acts_on="brake",
        next_test="the same stop with the electrodynamic brake cut out",
        said=(
            Said(
                "torque_nm",
                "N m",
                itself,
                "{whose} torque holds {size} that is not recorded, fading below {blending_mps:.0f} m/s",
            ),
        ),
        over="speed",
        beside_calipers=True,
        variants=at_speeds,
        words=whose_torque,
    ),
    study={"torque_nm": 1000.0},
)
