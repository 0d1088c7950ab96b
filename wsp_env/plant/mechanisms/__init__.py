"""Physics beyond the seed paper's model, one small file each.

A mechanism names its parameters (unit, bounds, null value, source), acts in one slot of the plant and says what it would
leave in which residual of a recording. At its null value it vanishes exactly. To add one: write its file, then name it in
`Mechanisms` and `ALL` below and call it in its slot of `plant/step.py`.
"""

from collections.abc import Mapping
from typing import NamedTuple

from wsp_env.parameters.quantity import ParameterError, check
from wsp_env.plant.mechanisms import leading_axle_cleaning, load_transfer
from wsp_env.plant.mechanisms.mechanism import Mechanism


class Mechanisms(NamedTuple):
    """The parameters of all mechanisms, as the compiled step takes them."""

    leading_axle_cleaning: leading_axle_cleaning.Parameters
    load_transfer: load_transfer.Parameters


ALL: dict[str, Mechanism] = {module.MECHANISM.name: module.MECHANISM for module in (leading_axle_cleaning, load_transfer)}


def make(choice: Mapping[str, Mapping[str, float]] | None = None) -> Mechanisms:
    """Return the parameter record with the mechanisms of `choice` switched on and all others at their null value.

    `choice` maps a mechanism to its parameters; those left out take their typical value, so `{"load_transfer": {}}` switches
    it on as in the literature. `ParameterError` names an unknown mechanism or parameter and lists the valid ones.
    """
    choice = dict(choice or {})
    unknown = sorted(set(choice) - set(ALL))
    if unknown:
        raise ParameterError(f"unknown mechanism {', '.join(unknown)}; valid: {', '.join(ALL)}")
    records = []
    for name, mechanism in ALL.items():
        given = choice.get(name)
        if given is None:
            records.append(mechanism.record(*(parameter.null for parameter in mechanism.parameters)))
            continue
        names = [parameter.name for parameter in mechanism.parameters]
        wrong = sorted(set(given) - set(names))
        if wrong:
            raise ParameterError(f"mechanism {name} has no parameter {', '.join(wrong)}; valid: {', '.join(names)}")
        values = []
        for parameter in mechanism.parameters:
            value = given.get(parameter.name, parameter.typical)
            metadata = {"low": parameter.low, "high": parameter.high, "unit": parameter.unit, "open_low": False}
            check(f"mechanism {name}: {parameter.name}", value, metadata)
            values.append(float(value))
        records.append(mechanism.record(*values))
    return Mechanisms(*records)
