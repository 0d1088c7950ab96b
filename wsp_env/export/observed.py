"""A controller on the guarded observer as a unit of C: its kernel decides, on what the observer estimates.

It is written as the adaptive one is (`baselines.adaptive`): `parameters`, of which a NamedTuple `Settings` lists those that the
kernel takes; `_control(settings, plan, state, given)`, which writes commands into its plan, a NamedTuple of arrays.
"""

import inspect
from typing import Any

from wsp_env.evaluation.controller import load
from wsp_env.export import kinds
from wsp_env.export.guarded import found, guarded_observer, kernels_names, rebuilders
from wsp_env.export.inputs import commanded, driven, measured, parameter
from wsp_env.export.translator import Translator
from wsp_env.export.unit import Unit, assigned, flat
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

#: The kernel and the record of its settings, as such a controller's file names them.
KERNEL, SETTINGS = "_control", "Settings"

#: Those of the parameters that the guard takes, and what it calls them.
_TIMERS = {"safety_timer_s": "timer", "safety_rest_s": "timer_rest"}


def is_observed(controller: Any) -> bool:
    """Whether a controller is one of these."""
    return {KERNEL, SETTINGS} <= set(vars(inspect.getmodule(type(controller))))


def observed_unit(name: str, title: str, prefix: str, vehicle: Vehicle, interval_s: float) -> Unit:
    """Return the unit of such a controller for one vehicle and one interval between its decisions."""
    controller: Any = load(name)
    names = vars(inspect.getmodule(type(controller)))
    controller.reset(kinds.SENTINEL, vehicle)
    axles = vehicle.axles
    t = Translator(prefix, rebuilders(*kernels_names(), names))
    settings, p = names[SETTINGS]._fields, controller.parameters
    plan = kinds.variable(t.type_of(controller._plan), "self->plan")
    timers = tuple(float(getattr(p, one)) for one in _TIMERS)
    seen = guarded_observer(t, vehicle, interval_s, "self->plan.command", timers)  # type: ignore[arg-type]  # as many as _TIMERS
    table = kinds.Array(kinds.REAL, (kinds.BATCH, len(settings)), const=True)
    control = t.call(names[KERNEL], [kinds.variable(table, "self->settings"), plan, seen.memory, seen.constants], None)
    parameters = [parameter(p, one) for one in (*settings, *_TIMERS)]
    return Unit(
        name=prefix,
        title=f"{title}, every {interval_s:g} s",
        translator=t,
        parameters=tuple(parameters),
        inputs=measured(axles),
        outputs=(commanded(axles), *seen.outputs),
        state=(*seen.state, f"{t.c_type(plan.type)} plan;", f"double settings[{len(settings)}];"),
        start=(
            "memset(self, 0, sizeof *self);",
            *seen.start,
            *assigned("self->plan", controller._plan, plan.type),
            *(f"self->settings[{n}] = p->{one};" for n, one in enumerate(settings)),
            *(f"self->guard.{own} = p->{one};" for one, own in _TIMERS.items()),
        ),
        step=(
            "if (self->begun) {",
            *(f"    {line}" for line in (*seen.observe, f"{control.code};", seen.overrule)),
            "} else { /* one measurement alone does not tell how often they come */",
            *(f"    {line}" for line in seen.begin),
            "}",
            f"memcpy(y->command, self->plan.command, {axles} * sizeof(double));",
            *seen.tell,
        ),
        reference=lambda times: driven(
            name,
            vehicle,
            interval_s,
            [*settings, *_TIMERS],
            lambda own, now: _outputs(own, now, interval_s),
            drives=4 * times,
            seed=2,
        ),
        interval_s=interval_s,
        controller=True,
        axles=axles,
    )


def _outputs(controller: Any, seen: Measurement, interval_s: float) -> list[float]:
    """Return what the C gives for a measurement, by the Python."""
    command = controller.act(seen)
    if not controller._begun:  # the C knows the interval from the start, and begins with the first measurement
        controller._begin(controller._first, interval_s)
    return flat((command, *found(controller._observer, controller.wheels)))
