"""One control interval of any plant with these arrays: vehicle by vehicle, substep by substep, sensors at the end."""

from typing import Any

import numpy as np

from wsp_env.compiled import inlined, rebuilder
from wsp_env.contact.port import law_at
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.components import brake
from wsp_env.plant.longitudinal.axles import Stepping, read_sensors
from wsp_env.plant.longitudinal.state import batch
from wsp_env.plant.mechanisms import NULL, Active, mechanisms_at
from wsp_env.plant.port import Setup

_batch = rebuilder(batch(1, COACH, Setup(), NULL))


@inlined
def advance_by(
    substep: Any, command: np.ndarray, believed: Any, given: Any, moving: np.ndarray, work: np.ndarray, more: Any
) -> None:  # fmt: skip
    """Advance every vehicle that moves by one control interval.

    Parameters
    ----------
    substep : compiled (vehicle, substep of the interval, `Stepping`, more) -> whether it has stopped, the plant's own equations
    command : (N, A) see `wsp_env.plant.command`
    believed : the vehicle's traction law: the type of what the mechanisms make of it
    given : a `Batch` as `plain` tuples; its state is changed in place
    moving : (N,) bool, changed in place: False once a vehicle stands or was given up; such a vehicle is left as it is
    work : (ROWS, A) scratch
    more : what else the plant's substep works on

    """
    state, c, physics, p = _batch(given)
    for i in range(command.shape[0]):
        if not moving[i]:
            continue
        law = law_at(believed, physics.law, i)
        active = Active(mechanisms_at(physics.mechanisms, i), p.derived, state.memory)
        on_step = Stepping(state, c, p, law, active, work, physics.inertia)
        brake.receive(i, command, state.brake)
        for j in range(p.substeps):
            if substep(i, j, on_step, more):
                moving[i] = False
                break
        read_sensors(i, state, c, p, active)
