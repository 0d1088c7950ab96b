"""A policy as a unit of C: the observer with its own estimates, and the network."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wsp_env.evaluation.policy import NETWORK, Policy, load_policy
from wsp_env.export import kinds
from wsp_env.export.controller import measured, random_drive
from wsp_env.export.network import network_source
from wsp_env.export.plant import assigned
from wsp_env.export.translator import Direct, Translator
from wsp_env.export.unit import Unit, Variable, flat
from wsp_env.observer import observation
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.port import Measurement

#: By how much the observer's estimates may differ (they are bit-identical), and the network's commands of a pressure.
TOLERANCE = 1e-4
WHY = "the network sums floats in another order than onnxruntime; valve commands and the observer's estimates are equal"


def policy_unit(folder: Path) -> Unit:
    """Return the unit of a policy's folder."""
    policy = load_policy(folder, guarded=False)
    contract = policy.contract
    vehicle, axles = VEHICLES[contract.vehicle], contract.axles
    size, sensors = Observer.size_for(axles), contract.pressure_sensors
    same = Direct(lambda given, body: given[0])
    t = Translator("wsp_policy", {observation.memory_of: same, observation.constants_of: same})
    given = observation._constants_of(vehicle, contract.control_interval_s, contract.action == "pressure")
    remembered = observation._allocate(kinds.SENTINEL, vehicle, contract.control_interval_s)
    constants, memory = t.type_of(given), t.type_of(remembered)
    assert isinstance(constants, kinds.Record)
    assert isinstance(memory, kinds.Record)
    table, n = kinds.Array(kinds.REAL, (kinds.BATCH, axles), const=True), (kinds.BATCH,)
    state, own = kinds.variable(memory, "self->memory"), kinds.variable(constants, "self->constants")
    seen = kinds.variable(kinds.Array(kinds.SINGLE, (kinds.BATCH, size)), "self->observation")
    wheel, demand = kinds.variable(table, "u->wheel_speed"), kinds.variable(kinds.Array(kinds.REAL, n), "u->demand")
    pressure = kinds.variable(table if sensors else kinds.Array(kinds.REAL, (0, 0)), "u->pressure")
    begin = t.call(
        observation._begin, [kinds.variable(kinds.Array(kinds.BOOL, n), "true"), wheel, demand, state, own, seen], None
    )
    last = kinds.variable(table, "self->command")
    observe = t.call(observation._observe, [wheel, last, demand, pressure, state, own, seen], None)
    tables, network = network_source((folder / NETWORK).read_bytes(), "network", size)
    t.functions.append(network)
    estimate = "self->memory.estimate"
    return Unit(
        name="wsp_policy",
        title=f"Policy {folder.name} for the {axles} axles of a {contract.vehicle}, every {contract.control_interval_s:g} s",
        translator=t,
        parameters=(),
        inputs=measured(axles, sensors),
        outputs=(
            Variable("command", "1", "-1 vents, 0 holds, +1 applies" if contract.action == "valve" else
                     "pressure: -1 none to +1 the demanded one", (1.0,), axles),
            Variable("running_speed", "m/s", "estimated"),
            Variable("uncertainty", "m/s", "standard deviation of the estimated running speed"),
            Variable("used_adhesion", "1", "estimated", size=axles),
        ),
        state=(
            f"{memory.name} memory;", f"{constants.name} constants;", f"float observation[{size}];",
            f"double command[{axles}];", "bool begun;",
        ),
        start=("memset(self, 0, sizeof *self);", *assigned("self->constants", given, constants)),
        step=(
            f"float decided[{axles}];",
            "if (self->begun) {", f"    {observe.code};", "} else {", f"    {begin.code};", "    self->begun = true;", "}",
            "network(self->observation, decided);",
            f"for (int k = 0; k < {axles}; k++) {{",
            "    self->command[k] = (double)decided[k];",
            "    y->command[k] = self->command[k];",
            f"    y->used_adhesion[k] = {estimate}.adhesion[k];",
            "}",
            f"y->running_speed = {estimate}.speed;", f"y->uncertainty = {estimate}.uncertainty;",
        ),
        reference=lambda: _reference(folder),
        interval_s=contract.control_interval_s,
        tolerance=TOLERANCE if contract.action == "pressure" else 0.0,
        why_tolerance=WHY,
        tables=tables,
        controller=True,
        axles=axles,
    )  # fmt: skip


def _reference(folder: Path, drives: int = 3, steps: int = 400) -> Iterator[tuple[str, list[float], list[float]]]:
    rng = np.random.default_rng(1)
    policy = load_policy(folder, guarded=False)
    vehicle = VEHICLES[policy.contract.vehicle]
    for _ in range(drives):
        policy.reset(1, vehicle)
        yield "start", [], []
        for seen in random_drive(vehicle, policy.contract.control_interval_s, steps, rng):
            full = seen._replace(
                wheel_speed=np.nan_to_num(seen.wheel_speed),
                pressure=rng.uniform(0.0, 3.8, (1, vehicle.axles)) if policy.contract.pressure_sensors else None,
            )
            yield "step", flat([one for one in full if one is not None]), outputs(policy, full)


def outputs(policy: Policy, seen: Measurement) -> list[float]:
    """Return what the C gives for a measurement, by the Python."""
    command = policy.act(seen)
    estimate = policy._observer.estimate
    return flat((command, estimate.speed, estimate.uncertainty, estimate.adhesion))
