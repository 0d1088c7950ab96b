"""The model of a steady creep curve with mechanisms of the library, and its fit to points.

Baseline: Polach's law with Kalker's slope (Hertz, Kalker's c11; both reduction factors 1) and the believed friction. Only the
friction level is fitted. The mechanisms act in the plant's own slots. If friction is believed constant, mechanisms whose card
says so have another null value: falling friction then starts from no fall, and its sizes refer to A and gamma of the seed
paper's Table 2.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from wsp_env.compiled import loop
from wsp_env.contact.degraded import DegradedLaw
from wsp_env.contact.polach import contact_stiffness, falling_friction
from wsp_env.contact.traction import Surface
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.uic_z1 import WHEELSET
from wsp_env.plant.card import OnCreepCurve, Parameter
from wsp_env.plant.mechanisms import (
    ALL,
    NULL,
    Active,
    Derived,
    Mechanisms,
    Memory,
    believed_to_true,
    derive,
    mechanisms_at,
    remember,
    row,
)
from wsp_env.plant.slots import contact
from wsp_env.recordings.creep_curves import CreepContact, CreepCurves

#: Slots of the plant that act on a steady creep curve, in the order of the search.
_SLOTS = ("law", "contact", "friction")
_LEVELS = (0.003, 1.0)  # bounds of the friction coefficient [-]: assumption
_ITERATIONS = 60
_STEP = 1e-5  # finite-difference step, in units of the parameter's typical size
_CONVERGED = 2e-4  # relative decrease of the sum of squares that ends a fit: about 0.04 of chi-square for 200 points
_DAMPINGS = 8

Choice = dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True)
class CurveFit:
    """A model fitted to points."""

    names: tuple[str, ...]  # mechanisms that are on
    values: np.ndarray  # (p,) friction level, then the sizes of each mechanism in the order of its card
    residual: np.ndarray  # (n,) model - measured
    cost: float  # sum of squares of `residual`


class CreepModel:
    """Adhesion coefficient at the points (n,) of creep curves, as a function of speed and creepage."""

    def __init__(self, data: CreepCurves) -> None:
        curves = data.curves.values()
        self.creepage = np.concatenate([one.creepage for one in curves])
        self.speed = np.concatenate([np.full(len(one.creepage), one.speed_mps) for one in curves])
        self.measured = np.concatenate([one.adhesion for one in curves])
        self.curve = np.repeat(np.arange(len(data.curves)), [len(one.creepage) for one in curves])
        self.contact = data.contact
        self.believed = _believed(data.contact)
        patch = data.contact.patch()
        ellipse = ContactParameters(patch.semi_axis_a, patch.semi_axis_b, patch.c11, patch.shear_modulus)
        radius = data.contact.wheel_radius_m
        self._derived = derive(dataclasses.replace(WHEELSET, wheel_radius_m=radius, contact=ellipse))
        self._memory = remember(1, WHEELSET.axle_positions_m)
        #: Slip speed [m/s] at which the friction level is defined: the points' mean, where falling friction changes the level
        #: least.
        self.reference_mps = float(np.mean(self.creepage * self.speed))

    @property
    def searched(self) -> list[str]:
        """Mechanisms that these points may show, in the order of the search."""
        speeds = len(np.unique(self.speed))
        known = [name for slot in _SLOTS for name in creep_mechanisms() if slot in ALL[name].acts]
        return [name for name in dict.fromkeys(known) if creep_mechanisms()[name].least_speeds <= speeds]

    def sizes(self, name: str) -> tuple[Parameter, ...]:
        """Return a mechanism's sizes, with the null values that belong to the believed friction."""
        constant = self.contact.friction_ratio == 1.0
        nulls = creep_mechanisms()[name].null_at_constant_friction if constant else {}
        return tuple(size._replace(null=nulls.get(size.name, size.null)) for size in ALL[name].sizes)

    def choice(self, names: Iterable[str], values: np.ndarray) -> Choice:
        """Return the `choice` for `mechanisms.make` from values (p,), whose first element is the friction level."""
        believed = [name for name, shows in creep_mechanisms().items() if shows.null_at_constant_friction]
        found: Choice = {name: {p.name: p.null for p in self.sizes(name)} for name in believed}
        rest = iter(values[1:])
        for name in names:
            found[name] = {p.name: float(next(rest)) for p in self.sizes(name)}
        return found

    def law(self, choice: Choice) -> DegradedLaw:
        """Return the traction law with the mechanisms that act on it."""
        return self._law(_records(choice))

    def _law(self, records: Mechanisms) -> DegradedLaw:
        law: DegradedLaw = believed_to_true("law", records, self.believed)
        return law

    def kinetic_friction(self, level: float, law: DegradedLaw) -> float:
        """Return the kinetic friction mu_c [-] for a friction coefficient `level` at the reference slip."""
        return level / float(falling_friction(self.reference_mps, 1.0, law.ratio_d, law.gamma_d))

    def adhesion(self, level: float, choice: Choice, at: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """Return f [-] at the points (n,), or `at` other creepages [-] and speeds [m/s], both (m,)."""
        records = _records(choice)
        law = self._law(records)
        creepage, speed = at or (self.creepage, self.speed)
        result: np.ndarray = np.empty(len(creepage))
        on = Surface(self.kinetic_friction(level, law), law.mu_cr, 1.0, 0.0)
        _evaluate(
            creepage, speed, self.contact.wheel_load_n, on, law, (row(records)[None], self._derived, self._memory), result
        )
        return result

    def fit(
        self,
        names: Sequence[str],
        measured: np.ndarray,
        start: CurveFit | None = None,
        keep: np.ndarray | None = None,
        held: Mapping[str, float] | None = None,
    ) -> CurveFit:
        """Fit the friction level and the sizes to adhesion coefficients (n,) by least squares; the best of several starts.

        Parameters
        ----------
        start : a fit with some of the mechanisms on, used as start
        keep : (n,) bool, points to fit to
        held : sizes "mechanism.parameter" that are fixed at a value

        """
        parameters = [(name, p) for name in names for p in self.sizes(name)]
        box = np.array([_LEVELS, *((p.low, p.high) for _, p in parameters)])
        unit = np.array([0.1, *(abs(p.typical - p.null) or 0.2 for _, p in parameters)])
        for i, (name, p) in enumerate(parameters, start=1):
            if held and f"{name}.{p.name}" in held:
                box[i] = held[f"{name}.{p.name}"]
        known = {} if start is None else _by_name(self, start)
        level = float(np.median(measured)) if start is None else float(start.values[0])
        starts = [
            np.array([level, *(known.get((name, p.name), p.null + share * (p.typical - p.null)) for name, p in parameters)])
            for share in (0.2, 1.0)
        ]

        def residual(values: np.ndarray) -> np.ndarray:
            return self.adhesion(float(values[0]), self.choice(names, values)) - measured

        unknown = any((name, p.name) not in known for name, p in parameters)
        fits = [_least_squares(residual, one, box, unit, keep) for one in starts[: 1 + unknown]]
        return CurveFit(tuple(names), *min(fits, key=lambda one: one[2]))


@functools.cache
def creep_mechanisms() -> dict[str, OnCreepCurve]:
    """Return the mechanisms that show in a steady creep curve, with their `OnCreepCurve` data."""
    return {name: card.signature.creep_curve for name, card in ALL.items() if card.signature.creep_curve is not None}


def _records(choice: Choice) -> Mechanisms:
    """Return the records of `mechanisms.make` without its checks; the values are within their bounds here."""
    typical = {name: {p.name: p.typical for p in ALL[name].parameters} for name in choice}
    return NULL._replace(**{name: ALL[name].record(**typical[name] | values) for name, values in choice.items()})


def _by_name(model: CreepModel, fit: CurveFit) -> dict[tuple[str, str], float]:
    keys = [(name, p.name) for name in fit.names for p in model.sizes(name)]
    return dict(zip(keys, map(float, fit.values[1:]), strict=True))


def _least_squares(
    function: Callable[[np.ndarray], np.ndarray], start: np.ndarray, box: np.ndarray, unit: np.ndarray, keep: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Minimise a sum of squares in a box (Levenberg and Marquardt); return values, residuals and the sum of squares.

    scipy's `least_squares` solves the same problem about ten times more slowly at this size; hundreds of null recordings need
    it.
    """
    weight = np.ones(1) if keep is None else keep.astype(float)
    low, high = box.T
    x = np.clip(start, low, high)
    residual = function(x)
    cost, damping = float(np.sum(weight * residual**2)), 1e-2
    for _ in range(_ITERATIONS):
        jacobian = np.empty((len(residual), len(x)))
        for i in range(len(x)):
            moved = x.copy()
            moved[i] += _STEP * unit[i] if x[i] + _STEP * unit[i] <= high[i] else -_STEP * unit[i]
            moved[i] = np.clip(moved[i], low[i], high[i])
            jacobian[:, i] = (function(moved) - residual) / ((moved[i] - x[i]) / unit[i] or 1.0)
        gradient = jacobian.T @ (weight * residual)
        free = ~(((x <= low) & (gradient >= 0.0)) | ((x >= high) & (gradient <= 0.0)))
        before = cost
        normal = (jacobian.T * weight) @ jacobian
        for _ in range(_DAMPINGS):
            step = np.zeros(len(x))
            part = normal[np.ix_(free, free)]
            step[free] = -np.linalg.solve(part + np.diag(damping * np.diag(part) + 1e-12), gradient[free])
            tried = np.clip(x + step * unit, low, high)
            moved_residual = function(tried)
            moved_cost = float(np.sum(weight * moved_residual**2))
            if moved_cost < cost:
                x, residual, cost, damping = tried, moved_residual, moved_cost, max(damping / 6.0, 1e-7)
                break
            damping *= 6.0
        if before - cost <= _CONVERGED * before:
            break
    return x, residual, cost


def _believed(contact: CreepContact) -> DegradedLaw:
    patch = contact.patch()
    stiffness = float(contact_stiffness(patch.semi_axis_a, patch.semi_axis_b, patch.shear_modulus, patch.c11))
    ratio = ContactParameters.friction_ratio_r if contact.friction_ratio == 1.0 else contact.friction_ratio
    gamma = contact.friction_decrease_spm
    return DegradedLaw(stiffness, 1.0, 1.0, 1.0, 1.0, _LEVELS[1], ratio, ratio, gamma, gamma)


@loop
def _evaluate(
    creepage: np.ndarray,
    speed: np.ndarray,
    load: float,
    on: Surface,
    law: DegradedLaw,
    on_it: tuple[np.ndarray, Derived, Memory],
    out: np.ndarray,
) -> None:
    active = Active(mechanisms_at(on_it[0], 0), on_it[1], on_it[2])
    for i in range(creepage.size):
        out[i] = contact(creepage[i] * speed[i], speed[i], load, on, 0.0, law, active).f  # tau = 0: the limit without recovery
