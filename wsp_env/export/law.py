"""A contact law as a unit of C: adhesion, limits and derivatives of one wheel."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsp_env.compiled import loop
from wsp_env.contact.port import LAWS, traction
from wsp_env.contact.traction import Adhesion, Surface
from wsp_env.export import kinds
from wsp_env.export.source import members
from wsp_env.export.translator import Translator
from wsp_env.export.unit import Unit, Variable, flat

#: What a law takes beside its record.
INPUTS = (
    Variable("slip_speed", "m/s", "s = v - r w; the law takes |s|, the caller puts the sign of s back"),
    Variable("speed", "m/s", "running speed v"),
    Variable("normal_load", "N", "load of one wheel", (50e3,)),
    Variable("mu_cd", "1", "kinetic friction coefficient of the contaminated rail", (0.06,)),
    Variable("mu_cr_here", "1", "the same of the clean rail; the law's mu_cr, unless something changes it here", (0.28,)),
    Variable("layer", "1", "share of the contaminant layer that earlier wheels left", (1.0,)),
    Variable("held", "1", "share that this wheel's work does not act on"),
    Variable("tau", "m/J", "recovery rate; 0 is the classic law"),
)


def said(text: str) -> tuple[str, str]:
    """Return the meaning and the unit of "meaning [unit], more"."""
    meaning, _, rest = text.partition("[")
    unit, closed, more = rest.partition("]")
    return f"{meaning.strip()}{more}".strip(" ,;"), {"-": "1", "": "1"}.get(unit, unit) if closed else "1"


@loop
def evaluate_many(states: np.ndarray, law: Any, result: np.ndarray) -> None:
    """Evaluate a law at states (n, 8), columns as `INPUTS`, as the plant does; into result (n, 6)."""
    for i in range(states.shape[0]):
        on = Surface(states[i, 3], states[i, 4], states[i, 5], states[i, 6])
        a = traction(states[i, 0], states[i, 1], states[i, 2], on, states[i, 7], law)
        result[i, 0], result[i, 1], result[i, 2], result[i, 3], result[i, 4], result[i, 5] = (
            a.f, a.f_d, a.f_r, a.df_ds, a.df_dv, a.kept,
        )  # fmt: skip


def random_states(n: int, seed: int = 0) -> np.ndarray:
    """Return states (n, 8) over the whole range of use, columns as `INPUTS`; some at rest, some without slip."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0.0, 90.0, n) * (rng.random(n) > 0.02)
    slip = speed * rng.uniform(-0.1, 1.0, n) ** 3 * (rng.random(n) > 0.02)
    clean = rng.uniform(0.1, 0.4, n)
    columns = (
        slip, speed, rng.uniform(1e3, 120e3, n), clean * rng.uniform(0.02, 1.0, n), clean, rng.uniform(0.0, 1.0, n),
        rng.uniform(0.0, 0.3, n) * (rng.random(n) > 0.5), rng.uniform(0.0, 1e-3, n) * (rng.random(n) > 0.2),
    )  # fmt: skip
    return np.stack(columns, axis=1)


#: Laws that floats are too coarse for; over 100,000 states slopes of FASTSIM were off by up to 0.1.
_WHY_DOUBLE = {"fastsim": "its slopes are differences over 1e-4 of the creepage, which floats round away"}


def law_unit(record: Any) -> Unit:
    """Return the unit of a law's record (see `wsp_env.contact.port`)."""
    law = next(one for one in LAWS.values() if one.record is type(record))
    t = Translator("wsp_law")
    real = kinds.REAL
    own, on = t.type_of(record), t.type_of(Surface(0.1, 0.3))
    slip, speed, load, tau = (kinds.variable(real, f"u->{name}") for name in ("slip_speed", "speed", "normal_load", "tau"))
    call = t.call(
        law.evaluate,
        [slip, speed, load, kinds.variable(on, "on"), tau, kinds.variable(own, "self->law")],
        None,
    )
    assert isinstance(own, kinds.Record)
    assert isinstance(on, kinds.Record)
    about, made = members(type(record)), members(Adhesion)
    parameters = tuple(
        Variable(name, *said(about.get(name, ""))[::-1], (value,)) for name, value in zip(record._fields, record, strict=True)
    )
    outputs = tuple(Variable(name, *said(made[name])[::-1]) for name in Adhesion._fields)

    def reference(times: int) -> Iterator[tuple[str, list[float], list[float]]]:
        states = random_states(500 * times)
        result = np.empty((len(states), len(outputs)))
        evaluate_many(states, record, result)
        yield "start", flat(record), []
        for state, row in zip(states, result, strict=True):
            yield "step", flat(state), flat(row)

    adhesion = f"{t.prefix}_adhesion"
    return Unit(
        name="wsp_law",
        title=f"Contact law {law.name!r}: {law.summary}",
        translator=t,
        parameters=parameters,
        inputs=INPUTS,
        outputs=outputs,
        state=(f"{own.name} law;",),
        start=tuple(f"self->law.{kinds.safe(name)} = p->{name};" for name in record._fields),
        step=(
            f"const {on.name} on = {{u->mu_cd, u->mu_cr_here, u->layer, u->held}};",
            f"const {adhesion} found = {call.code};",
            *(f"y->{name} = found.{kinds.safe(name)};" for name in Adhesion._fields),
        ),
        reference=reference,
        why_double=_WHY_DOUBLE.get(law.name, ""),
    )
