"""What is true of a campaign, whoever made it: labels of this bank and of other people's campaigns become one record.

A label of other people's campaigns is a `label.json` beside `campaign.toml`:

- `effects`: names of what is concealed, none where nothing is. Names of the library are expected as answers, all others lie
  outside it. `mechanisms` says otherwise: the library's names that are true, where the label calls its effects otherwise.
- `params`: by effect, its parameters by the library's names for them, as far as they mean the same; others are not compared.
- `slot`, or a list where more are right, and `axle`, or a list, from 1: where an effect outside the library acts.
- `fault`: the kind of a faulty channel.
- `matters`: false for an effect too small to matter. `kind`: one of `KINDS` where it does not follow from the rest. `group`, or
  `plus`: true: cases that are also reported by themselves.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from experiments.concealed.errors import BankError
from wsp_env.plant.mechanisms import LIBRARY

Label = Mapping[str, Any]

#: What may be true of a campaign.
KINDS = {
    "null": "nothing is missing",
    "single": "one effect of the library",
    "pair": "two or more effects of the library",
    "mixed": "an effect of the library and one outside it",
    "outside": "an effect outside the library",
    "confounded": "an effect that these stops cannot show",
    "fault": "a faulty channel",
}
#: Where a discovered term may act, as answers say it.
SLOTS = ("brake torque", "friction", "recovery", "vehicle force", "sensor")
#: Singles of this bank count as separable from this multiple of the smallest effect of interest on: nobody looks at answers.
SEPARABLE = 2.0 * (1.0 - 1e-9)
#: Effects whose parameter means the same in any form: the library's name for it, and its value over the effect's size.
COMPARABLE = {
    "track_gradient": ("rise", 1.0), "aerodynamic_drag": ("c_ns2_per_m2", 1.0), "vehicle_mass": ("extra", 1.0),
    "wheel_radius": ("change", 1.0), "brake_gain_imbalance": ("gain", 1.0), "wheel_speed_lag": ("lag_s", 1.0),
    "clock_offset": ("offset_s", -1.0),  # a vehicle's speed sampled later than stamped is one that is late by less than 0
    "dragging_brake": ("torque_nm", 1.0),
}  # fmt: skip
#: Drag that comes with rolling terms, (100 N, 5 N s/m, 1 N s2/m2) times its size, is compared by its force at 30 m/s.
DRAG_WITH_ROLLING = 1.0 + 5.0 / 30.0 + 100.0 / 30.0**2


class Truth(NamedTuple):
    """What is true of one campaign, as the figures need it."""

    kind: str  # of KINDS
    names: tuple[str, ...] = ()  # of the library, that are there
    matters: bool = True  # a single effect that has to be found
    slots: tuple[str, ...] = ()  # any of which is right for what is outside the library; none: not known
    axles: tuple[int, ...] = ()  # from 1, that it acts on; none: all, the vehicle, or not known
    fault: str = ""  # kind of the faulty channel
    parameters: Mapping[str, Mapping[str, float]] = {}  # comparable ones, by name of the library
    group: str = ""


def true_value(effect: Mapping[str, Any]) -> float:
    """Return a comparable effect's parameter as the library has it."""
    factor = COMPARABLE[effect["name"]][1]
    if effect["name"] == "aerodynamic_drag" and effect["variant"] % 2:
        factor = DRAG_WITH_ROLLING
    return float(effect["size"] * factor)


def of_bank(label: Label) -> Truth:
    """Return what a label of this bank says."""
    effects, parameters = label["effects"], {}
    for one in effects:
        if one["name"] in COMPARABLE:
            name = COMPARABLE[one["name"]][0]
            parameters[one["name"]] = {name: true_value(one), "axle": float(one["axle"] % label["axles"] + 1)}
    kind = "outside" if label["class"] == "foreign" else label["class"]
    known = label.get("start_positions", True)
    return Truth(
        kind=kind,
        names=tuple(label["mechanisms"]),
        matters=kind != "single" or label["net"] >= 1.0,
        slots=tuple(label.get("slots", ())),
        axles=tuple(label.get("slot_axles", ())),
        fault=label.get("fault", ""),
        parameters=parameters,
        group="start positions known" if known else "start positions unknown",
    )


def of_label(name: str, label: Label) -> Truth:
    """Return what a `label.json` says.

    Parameters
    ----------
    name : of the campaign; the part before its last "/" is its group where the label has none

    Raises
    ------
    BankError
        where the label cannot be understood

    """
    effects = label.get("effects")
    if not isinstance(effects, list) or not all(isinstance(one, str) for one in effects):
        raise BankError(f'label of {name}: "effects" must be a list of names, [] where nothing is concealed')
    names = tuple(label.get("mechanisms", [one for one in effects if one in LIBRARY]))
    if wrong := sorted(set(names) - set(LIBRARY)):
        raise BankError(f'label of {name}: "mechanisms" has no names of the library: {", ".join(wrong)}')
    kind = label.get("kind", _kind(effects, names, label.get("fault", "")))
    if kind not in KINDS:
        raise BankError(f'label of {name}: "kind" is {kind!r}; valid: {", ".join(KINDS)}')
    slots = _listed(label.get("slot"))
    if wrong := sorted(set(slots) - set(SLOTS)):
        raise BankError(f'label of {name}: "slot" has {", ".join(wrong)}; valid: {", ".join(SLOTS)}')
    return Truth(
        kind=kind,
        names=names,
        matters=bool(label.get("matters", True)),
        slots=slots,
        axles=tuple(sorted(int(one) for one in _listed(label.get("axle")))),
        fault=str(label.get("fault", "")),
        parameters=_parameters(names, label.get("params") or {}),
        group=str(label.get("group") or ("plus" if label.get("plus") else name.rpartition("/")[0])),
    )


def _kind(effects: list[str], names: tuple[str, ...], fault: str) -> str:
    if fault:
        return "fault"
    if not effects:
        return "null"
    if not names:
        return "outside"
    if len(names) < len(effects):
        return "mixed"
    return "single" if len(names) == 1 else "pair"


def _listed(value: Any) -> tuple[Any, ...]:
    if value is None:
        return ()
    return tuple(value) if isinstance(value, list) else (value,)


def _parameters(names: tuple[str, ...], given: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return the parameters that are the library's by name, of those effects that are."""
    found = {}
    for name in names:
        values = given.get(name)
        known = {parameter.name for parameter in LIBRARY[name].parameters}
        if isinstance(values, Mapping) and (kept := {key: float(values[key]) for key in values if key in known}):
            found[name] = kept
    return found
