"""From a name to a unit of C, and from a unit to files."""

from collections.abc import Sequence
from pathlib import Path

from wsp_env.contact.port import LAWS
from wsp_env.evaluation import native
from wsp_env.export.controller import controller_unit
from wsp_env.export.files import write_unit
from wsp_env.export.kinds import UntranslatableError
from wsp_env.export.law import law_unit
from wsp_env.export.plant import PlantOptions, plant_unit
from wsp_env.export.policy import policy_unit
from wsp_env.export.unit import Unit
from wsp_env.output import ready, write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle

#: The header of one's own WSP, and the template.
TEMPLATES = Path(native.__file__).parent / "c"
HEADER, TEMPLATE = "wsp_controller.h", "my_wsp.c"


def make_unit(
    what: str, vehicle: Vehicle, options: PlantOptions | None = None, mechanisms: Sequence[str] = (), law: str = ""
) -> Unit:
    """Return the unit of "law", "plant", a policy's folder or a controller.

    `ParameterError` for what cannot be found, or cannot be written in C.
    """
    if law and law not in LAWS:
        raise ParameterError(f"unknown law {law!r}; valid: {', '.join(LAWS)}")
    if law and what != "law":
        raise ParameterError(
            f"a law is chosen for `law` alone; a {what}'s is that of the vehicle ({vehicle.contact.traction_law})"
        )
    if mechanisms and what != "plant":
        raise ParameterError("mechanisms act in the plant alone")
    try:
        if what == "law":
            return law_unit(LAWS[law].make(vehicle.contact) if law else vehicle.contact.law)
        if what == "plant":
            return plant_unit(vehicle, options, {name: {} for name in mechanisms})
        if Path(what).is_dir():
            return policy_unit(Path(what))
        return controller_unit(what, vehicle, (options or PlantOptions()).control_interval_s)
    except UntranslatableError as error:
        raise ParameterError(f"{what} cannot be written in C: {error}") from None


def write_c(unit: Unit, folder: Path) -> list[str]:
    """Write a unit as C with its test vectors; a controller also as a library for `wsp evaluate`. Return the files' names."""
    names = write_unit(unit, folder)
    if unit.controller:
        ready(folder / "controller.c", folder / HEADER)
        write_text(folder / "controller.c", library_source(unit))
        write_text(folder / HEADER, (TEMPLATES / HEADER).read_text(encoding="utf-8"))
        names += ["controller.c", HEADER]
    return names


def write_template(folder: Path) -> list[str]:
    """Write the header and the template of one's own WSP; return their names."""
    ready(folder / HEADER, folder / TEMPLATE)
    for name in (HEADER, TEMPLATE):
        write_text(folder / name, (TEMPLATES / name).read_text(encoding="utf-8"))
    return [HEADER, TEMPLATE]


def library_source(unit: Unit) -> str:
    """Return the C that makes a controller a library of `wsp_controller.h`; it alone allocates, once a stop."""
    name = unit.name
    sensors = any(variable.name == "pressure" for variable in unit.inputs)
    pressure = "\n        u.pressure[k] = seen->pressure_bar[k];" if sensors else ""
    needed = (
        "\n    if (seen->pressure_bar == NULL) {\n        return 3; /* needs cylinder pressures */\n    }" if sensors else ""
    )
    return f"""/* {unit.title}, as a library for wsp evaluate. */
#include <stdlib.h>
#include <string.h>

#include "wsp_controller.h"
#include "{name}.h"

WSP_CONTROLLER

enum {{ AXLES = {unit.axles} }};

int32_t wsp_init(const wsp_vehicle *vehicle, void **controller)
{{
    {name}_parameters p;
    {name} *own;
    if (vehicle->interface != WSP_INTERFACE || vehicle->axles != AXLES) {{
        return 1;
    }}
    own = malloc(sizeof *own);
    if (own == NULL) {{
        return 2;
    }}
    {name}_defaults(&p);
    {name}_start(own, &p);
    *controller = own;
    return 0;
}}

int32_t wsp_step(void *controller, const wsp_measurement *seen, double *command)
{{
    {name}_input u;
    {name}_output y;
    int k;{needed}
    memset(&u, 0, sizeof u);
    u.time = seen->time_s;
    u.demand = seen->demand;
    for (k = 0; k < AXLES; k++) {{
        u.wheel_speed[k] = seen->wheel_speed_radps[k];{pressure}
    }}
    {name}_step(controller, &u, &y);
    for (k = 0; k < AXLES; k++) {{
        command[k] = y.command[k];
    }}
    return 0;
}}

void wsp_free(void *controller)
{{
    free(controller);
}}
"""
