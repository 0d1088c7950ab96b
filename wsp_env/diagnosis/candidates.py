"""The candidates of the search: every mechanism of the library in all its variants.

A candidate is a set of columns: the change of the residuals per unit of its amplitudes. A mechanism with an axle, a place or a
band of speed has one variant for each; the search uses the best variant.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np

from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, Balances
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.swings import swings
from wsp_env.plant.card import Parameter, Recorded
from wsp_env.plant.mechanisms import ALL, LIBRARY

#: Finite-difference step, as a share of typical value less null value.
_STEP = 0.25
#: Share of that step over which a derivative is taken (assumption: between nonlinearity and rounding; half and twice as much
#: give like fits). Over the whole step, a nonlinear effect has another slope than at its value, and a fit ends elsewhere.
_DERIVATIVE = 0.02
#: Further steps of a rolled distance (a memory) that are searched, as multiples of the first: the effect is nonlinear, and a
#: step of one metre does not show the effect of ten metres.
_FADING = (4.0, 16.0)
#: The same for the only size of a mechanism of the contact without shapes: it is also searched at its typical value. Half the
#: stiffness of the contact has another effect than a tenth less, five times.
_BENDING = (1.0 / _STEP,)


@dataclasses.dataclass(frozen=True)
class Variant:
    """A mechanism with its axle, place or band fixed, or a term without a name."""

    name: str
    sizes: tuple[str, ...]  # names of the parameters to fit
    fixed: dict[str, float]  # values of the other parameters
    steps: tuple[float, ...] = ()  # finite-difference steps of the sizes; empty: the parameters' default steps
    family: str = ""  # of a term without a name: its description; terms that differ only in scale share it
    above: bool = False  # whether its only size must be above its null; below it, the size looks like noise
    shapes: dict[str, float] = dataclasses.field(default_factory=dict)  # of a term: fixed parameters that a refit moves, steps

    @property
    def title(self) -> str:
        """The name that competes for one place in the answer: the mechanism's name, or the family of a term."""
        return self.family or self.name

    def null(self) -> np.ndarray:
        """Return the null values of the sizes."""
        return np.array([parameter_of(self.name, size).null for size in self.sizes])

    def moves(self) -> np.ndarray:
        """Return the finite-difference steps of the sizes."""
        return np.array(self.steps or [step(self.name, size) for size in self.sizes])


@dataclasses.dataclass(frozen=True)
class Candidate:
    """The columns of one variant."""

    variant: Variant
    columns: np.ndarray  # (n, k) raw change of the residuals per step
    scale: np.ndarray  # (k,) size of one step in smallest effects of interest


def unavailable(balances: Balances | Replica) -> dict[str, str]:
    """Return the mechanisms on which such recordings give no information, each with the reason."""
    rows, measured = balances.rows, balances.campaign.vehicle.torque_is_measured
    blind = measured and not (rows.balance == ACTUATOR).any()
    slides = bool((rows.balance == ADHESION).any())
    stops: dict[str, str] = {}
    brakes: dict[str, str] = {}
    axles: dict[str, str] = {}
    contacts: dict[str, str] = {}
    for name, card in LIBRARY.items():
        signature = card.signature
        if blind and signature.acts_on == "brake" and not signature.beside_calipers:
            brakes[name] = "the torque itself is measured, and no cylinder pressure beside it"
        elif balances.axles < signature.least_axles:
            axles[name] = f"needs {signature.least_axles} axles"
        elif len(balances.stops) < signature.least_stops:
            stops[name] = f"needs {signature.least_stops} stops"
        elif not slides and "adhesion" in signature.balances:
            contacts[name] = "no wheel slides"
    return brakes | axles | stops | contacts


def variants(balances: Balances | Replica) -> Iterator[Variant]:
    """Yield every mechanism that these recordings can show, in all its variants."""
    closed, rows = unavailable(balances), balances.rows
    recorded = Recorded(balances.axles, rows.place[rows.slides], swings(balances.sources, balances.radius, balances.inertia))
    for name, card in LIBRARY.items():
        if name not in closed:
            sizes = tuple(size.name for size in card.sizes if size.fitted)
            further: tuple[float, ...] = ()
            if len(sizes) == 1 and parameter_of(name, sizes[0]).rolled:
                further = _FADING
            elif len(sizes) == 1 and card.signature.acts_on == "contact":
                further = _BENDING
            for fixed in card.signature.variants(recorded):
                plain = Variant(name, sizes, fixed)
                yield plain
                for ratio in further if not located(plain) else ():
                    yield Variant(name, sizes, fixed, (ratio * step(name, sizes[0]),))


def parameter_of(mechanism: str, name: str) -> Parameter:
    """Return one parameter of a mechanism."""
    return next(one for one in ALL[mechanism].parameters if one.name == name)


def step(mechanism: str, parameter: str) -> float:
    """Return the finite-difference step of a parameter."""
    one = parameter_of(mechanism, parameter)
    change = one.refit_step or _STEP * (one.typical - one.null)
    if change == 0.0:  # typical equals null: use a small share of the distance to a bound
        change = 1e-3 * (one.high - one.null) or 1e-3 * (one.low - one.null)
    return change


def near(variant: Variant) -> Variant:
    """Return the variant with the default steps of its parameters, in the searched direction, for a local refit."""
    if not variant.steps or variant.family:
        return variant
    own = dataclasses.replace(variant, steps=()).moves()
    return dataclasses.replace(variant, steps=tuple(map(float, np.copysign(own, variant.moves()))))


def refined(variant: Variant) -> Variant:
    """Return the variant with the parameters that locate it (place, band, time) or shape a term free as well."""
    free = located(variant)
    own = variant.shapes if variant.family else {name: step(variant.name, name) for name in free}
    fixed = {name: value for name, value in variant.fixed.items() if name not in free}
    steps = (*variant.moves(), *own.values()) if variant.steps else ()
    return Variant(variant.name, (*variant.sizes, *free), fixed, steps, variant.family)


def located(variant: Variant) -> dict[str, float]:
    """Return those of the fixed parameters that say where a mechanism acts, and that a refit may move."""
    if variant.family:
        return {name: variant.fixed[name] for name in variant.shapes}
    return {name: value for name, value in variant.fixed.items() if parameter_of(variant.name, name).refit_step}


def switched(model: Model, variant: Variant, values: np.ndarray) -> Model:
    """Return a model with a variant switched on at given values of its sizes, clipped to what they can be and a refit tries."""
    parameters = {one.name: one for one in ALL[variant.name].parameters}
    given = dict(zip(variant.sizes, map(float, values), strict=True)) | variant.fixed
    whole = {name: one.null for name, one in parameters.items()} | dict(model.choice.get(variant.name, {})) | given
    low = {name: max(one.low, one.refit_low) for name, one in parameters.items()}
    inside = {name: float(np.clip(value, low[name], parameters[name].high)) for name, value in whole.items()}
    return dataclasses.replace(model, choice={**model.choice, variant.name: inside})


def without(model: Model, variant: Variant) -> Model:
    """Return a model with a variant switched off; other terms of the same card stay on."""
    off = switched(model, variant, variant.null())
    nulls = {one.name: one.null for one in ALL[variant.name].sizes}
    if all(off.choice[variant.name][name] == null for name, null in nulls.items()):
        off = dataclasses.replace(off, choice={name: values for name, values in off.choice.items() if name != variant.name})
    return off


def values_in(model: Model, variant: Variant) -> np.ndarray:
    """Return the values of a variant's sizes in a model; the null values if it is off."""
    present = model.choice.get(variant.name, {})
    return np.array([present.get(name, parameter_of(variant.name, name).null) for name in variant.sizes])


def at_bound(variant: Variant, model: Model) -> bool:
    """Whether a fitted size is at one of its bounds, or a fitted shape at its upper bound.

    The recordings then require another form. A shape at its lower bound is a simpler form: no delay, no lowest speed.
    """
    for name, value in zip(variant.sizes, values_in(model, variant), strict=True):
        parameter = parameter_of(variant.name, name)
        low = parameter.low if parameter.kind == "size" else -np.inf
        if value != parameter.null and not low < value < parameter.high:
            return True
    return False


def columns(balances: Balances | Replica, model: Model, base: np.ndarray, variant: Variant) -> np.ndarray:
    """Return the derivatives of the residuals (n, k) by each free parameter at the variant's values in the model, per step.

    At a bound the derivative is taken on the inner side.
    """
    start, found = values_in(model, variant), []
    for i, change in enumerate(_DERIVATIVE * variant.moves()):
        for step_by in (change, -change):
            values = start.copy()
            values[i] += step_by
            moved = switched(model, variant, values)
            if values_in(moved, variant)[i] != start[i]:
                break
        found.append((balances.raw(moved, model) - base) * np.sign(step_by * change) / _DERIVATIVE)
    return np.column_stack(found)
