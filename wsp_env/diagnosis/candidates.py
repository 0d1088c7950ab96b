"""What is searched: every mechanism of the library in its variants.

A candidate is a set of columns, the change of the residuals per unit of its amplitudes. A mechanism with an axle, or a place
or band of speed, has a variant for each; where several fit, the search takes the best, in the null recordings as well.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, Balances
from wsp_env.diagnosis.evaluate import Choice, Model
from wsp_env.plant.card import Card
from wsp_env.plant.mechanisms import ALL

#: Lengths of a patch that are tried [m]; half of one apart along the track.
_PATCH_LENGTHS_M = (30.0, 60.0, 120.0)
#: Bands of speed that a track brake is tried in [m/s].
_BANDS_MPS = ((-10.0, 200.0), (8.0, 200.0), (15.0, 200.0), (22.0, 200.0))
#: Finite-difference steps as share of the typical change.
_STEP = 0.05
_BRAKES = ("pad_friction", "brake_gain_imbalance")
#: Sizes left to another mechanism that has the same trace, or a smaller one of the same mechanism.
_LEFT_OUT = {
    ("aerodynamic_drag", "a_n"),  # the gradient's
    ("aerodynamic_drag", "b_ns_per_m"),
    ("pad_friction", "per_pressure_1_per_bar"),
}
_NEED_AXLES = {"leading_axle_cleaning": 2, "load_transfer": 2}


@dataclasses.dataclass(frozen=True)
class Variant:
    """A mechanism with its axle, place or band fixed."""

    name: str
    sizes: tuple[str, ...]  # the parameters to fit
    fixed: dict[str, float]  # the others


@dataclasses.dataclass(frozen=True)
class Candidate:
    """Columns of one variant or closure."""

    name: str
    columns: np.ndarray  # (n, k) raw change of the residuals per step
    variant: Variant | None = None  # None: a closure
    steps: tuple[float, ...] = ()  # of each size parameter
    nodes: tuple[float, ...] = ()  # of a closure: what its columns are at
    over: str = ""  # of a closure: what its nodes are, with its unit
    unit: str = ""  # of a closure: of its amplitudes


def unavailable(balances: Balances) -> dict[str, str]:
    """Return the mechanisms that such recordings can say nothing on, and why."""
    reasons: dict[str, str] = {}
    if balances.campaign.vehicle.torque_is_measured and not (balances.rows.balance == ACTUATOR).any():
        reasons |= dict.fromkeys(_BRAKES, "the torque itself is measured, and no cylinder pressure beside it")
    for name, axles in _NEED_AXLES.items():
        if balances.axles < axles:
            reasons[name] = f"needs {axles} axles"
    if not (balances.rows.balance == ADHESION).any():
        reasons |= {
            name: "no wheel slides" for name, one in ALL.items() if "adhesion" in one.signature.balances and name not in reasons
        }
    return reasons


def variants(balances: Balances) -> Iterator[Variant]:
    """Every mechanism that these recordings can show, in all its variants."""
    closed = unavailable(balances)
    for name, mechanism in ALL.items():
        if name in closed:
            continue
        sizes = tuple(parameter.name for parameter in mechanism.sizes if _separate(name, parameter.name))
        for fixed in _fixed(mechanism, balances):
            yield Variant(name, sizes, fixed)


def _separate(mechanism: str, parameter: str) -> bool:
    """Whether a size is fitted: those that another mechanism has exactly are left to it."""
    return (mechanism, parameter) not in _LEFT_OUT


def _fixed(mechanism: Card, balances: Balances) -> list[dict[str, float]]:
    if any(parameter.kind == "axle" for parameter in mechanism.parameters):
        return [{"axle": float(k + 1)} for k in range(balances.axles)]
    if mechanism.name == "adhesion_patch":
        rows = balances.rows
        place = rows.place[(rows.balance == ADHESION) & (rows.slip > 0.005 * rows.speed)]
        if not len(place):
            return []
        first, last = np.quantile(place, [0.01, 0.99])
        return [
            {"start_m": float(start), "length_m": length}
            for length in _PATCH_LENGTHS_M
            for start in np.arange(first - length / 2, last - length / 4, length / 2)
        ]
    if mechanism.name == "non_adhesive_brake":
        return [{"lowest_mps": low, "highest_mps": high} for low, high in _BANDS_MPS]
    return [{}]


#: Steps of parameters that say where, which the refit moves too.
_SHAPE_STEPS = {
    ("adhesion_patch", "start_m"): 2.0,
    ("adhesion_patch", "length_m"): 2.0,
    ("non_adhesive_brake", "lowest_mps"): 0.5,
}


def step(mechanism: str, parameter: str) -> tuple[float, float]:
    """Return null value and finite-difference step of a parameter."""
    if (mechanism, parameter) in _SHAPE_STEPS:
        return 0.0, _SHAPE_STEPS[mechanism, parameter]
    one = next(p for p in ALL[mechanism].parameters if p.name == parameter)
    change = _STEP * (one.typical - one.null)
    if change == 0.0:  # typical is the null: a small share of the way to the upper bound
        change = 1e-3 * (one.high - one.null) or 1e-3 * (one.low - one.null)
    return one.null, change


def refined(variant: Variant) -> tuple[Variant, dict[str, float]]:
    """Return the variant with the parameters free that say where, and their present values."""
    free = {name: value for name, value in variant.fixed.items() if (variant.name, name) in _SHAPE_STEPS}
    fixed = {name: value for name, value in variant.fixed.items() if name not in free}
    return Variant(variant.name, (*variant.sizes, *free), fixed), free


def choice_of(variant: Variant, values: np.ndarray) -> Choice:
    """Return a variant with values of its sizes, clipped into their bounds, all others at their null."""
    mechanism = ALL[variant.name]
    given = dict(zip(variant.sizes, values, strict=True)) | variant.fixed
    return {variant.name: {p.name: float(np.clip(given.get(p.name, p.null), p.low, p.high)) for p in mechanism.parameters}}


def columns(balances: Balances, model: Model, base: np.ndarray, variant: Variant) -> tuple[np.ndarray, tuple[float, ...]]:
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


def library(
    balances: Balances, model: Model, base: np.ndarray, friction: np.ndarray, tried: Sequence[Variant]
) -> list[Candidate]:
    """Return those variants that are off, with their columns about a model whose residuals are `base` (n,).

    Parameters
    ----------
    friction : (n,) derivative of the residuals by log mu_cd, of which a patch is a stretch

    """
    found = []
    for variant in tried:
        if variant.name in model.choice:
            continue
        if variant.name == "adhesion_patch":
            inside = _inside(balances.rows.place, variant.fixed["start_m"], variant.fixed["length_m"])
            _, change = step(variant.name, "change")
            column = change * friction * inside * balances.rows.wheels
            found.append(Candidate(variant.name, column[:, None], variant, (change,)))
        else:
            found.append(Candidate(variant.name, *_swapped(columns(balances, model, base, variant), variant)))
    return found


def _swapped(found: tuple[np.ndarray, tuple[float, ...]], variant: Variant) -> tuple[np.ndarray, Variant, tuple[float, ...]]:
    return found[0], variant, found[1]


def _inside(place: np.ndarray, start: float, length: float) -> np.ndarray:
    edge = 2.0
    result: np.ndarray = 0.5 * (np.tanh((place - start) / edge) - np.tanh((place - start - length) / edge))
    return result
