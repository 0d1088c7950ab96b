"""What is searched: every mechanism of the library in its variants.

A candidate is a set of columns, the change of the residuals per unit of its amplitudes. A mechanism with an axle, or a place
or band of speed, has a variant for each; where several fit, the search takes the best, in the null recordings as well.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from wsp_env.diagnosis.answer import ClosureKind
from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, Balances
from wsp_env.diagnosis.evaluate import Choice, Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.plant.card import Parameter, Recorded
from wsp_env.plant.mechanisms import ALL, LIBRARY

#: Finite-difference steps as share of the typical change.
_STEP = 0.25


@dataclasses.dataclass(frozen=True)
class Variant:
    """A mechanism with its axle, place or band fixed."""

    name: str
    sizes: tuple[str, ...]  # the parameters to fit
    fixed: dict[str, float]  # the others


@dataclasses.dataclass(frozen=True)
class Candidate:
    """Columns of one variant or closure."""

    name: str  # of the mechanism, or of the closure in words
    columns: np.ndarray  # (n, k) raw change of the residuals per step
    variant: Variant | None = None  # None: a closure
    steps: tuple[float, ...] = ()  # of each size parameter
    scale: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(1))  # (k,) smallest effects of interest a step
    closure: ClosureKind | None = None  # None: a mechanism
    nodes: tuple[float, ...] = ()  # of a closure: what its columns are at


def unavailable(balances: Balances | Replica) -> dict[str, str]:
    """Return the mechanisms that such recordings can say nothing on, and why."""
    rows, measured = balances.rows, balances.campaign.vehicle.torque_is_measured
    blind = measured and not (rows.balance == ACTUATOR).any()
    slides = bool((rows.balance == ADHESION).any())
    stops: dict[str, str] = {}
    brakes: dict[str, str] = {}
    axles: dict[str, str] = {}
    contacts: dict[str, str] = {}
    for name, card in LIBRARY.items():
        signature = card.signature
        if blind and signature.acts_on == "brake":
            brakes[name] = "the torque itself is measured, and no cylinder pressure beside it"
        elif balances.axles < signature.least_axles:
            axles[name] = f"needs {signature.least_axles} axles"
        elif len(balances.stops) < signature.least_stops:
            stops[name] = f"needs {signature.least_stops} stops"
        elif not slides and "adhesion" in signature.balances:
            contacts[name] = "no wheel slides"
    return brakes | axles | stops | contacts


def variants(balances: Balances | Replica) -> Iterator[Variant]:
    """Every mechanism that these recordings can show, in all its variants."""
    closed, rows = unavailable(balances), balances.rows
    slides = (rows.balance == ADHESION) & (rows.slip > 0.005 * rows.speed)
    recorded = Recorded(balances.axles, rows.place[slides])
    for name, card in LIBRARY.items():
        if name not in closed:
            sizes = tuple(size.name for size in card.sizes if size.fitted)
            for fixed in card.signature.variants(recorded):
                yield Variant(name, sizes, fixed)


def parameter_of(mechanism: str, name: str) -> Parameter:
    """Return one parameter of a mechanism."""
    return next(one for one in ALL[mechanism].parameters if one.name == name)


def step(mechanism: str, parameter: str) -> tuple[float, float]:
    """Return null value and finite-difference step of a parameter."""
    one = parameter_of(mechanism, parameter)
    change = one.refit_step or _STEP * (one.typical - one.null)
    if change == 0.0:  # typical is the null: a small share of the way to the upper bound
        change = 1e-3 * (one.high - one.null) or 1e-3 * (one.low - one.null)
    return one.null, change


def refined(variant: Variant) -> tuple[Variant, dict[str, float]]:
    """Return the variant with the parameters free that say where, and their present values."""
    free = {name: value for name, value in variant.fixed.items() if parameter_of(variant.name, name).refit_step}
    fixed = {name: value for name, value in variant.fixed.items() if name not in free}
    return Variant(variant.name, (*variant.sizes, *free), fixed), free


def choice_of(variant: Variant, values: np.ndarray) -> Choice:
    """Return a variant with values of its sizes, clipped into their bounds, all others at their null."""
    mechanism = ALL[variant.name]
    given = dict(zip(variant.sizes, values, strict=True)) | variant.fixed
    return {variant.name: {p.name: float(np.clip(given.get(p.name, p.null), p.low, p.high)) for p in mechanism.parameters}}


def columns(balances: Balances | Replica, model: Model, base: np.ndarray, variant: Variant) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return the change of the residuals (n, k) by a step of each free parameter, and the steps.

    About `model`: about the variant's values there if it is on, else about its null. `base` are the model's residuals.
    """
    steps = [step(variant.name, name) for name in variant.sizes]
    present = model.choice.get(variant.name, {})
    start = np.array([present.get(name, null) for name, (null, _) in zip(variant.sizes, steps, strict=True)])
    found = []
    for i, (_, change) in enumerate(steps):
        values = start.copy()
        values[i] += change
        moved = dataclasses.replace(model, choice={**model.choice, **choice_of(variant, values)})
        found.append(balances.raw(moved) - base)
    return np.column_stack(found), tuple(change for _, change in steps)
