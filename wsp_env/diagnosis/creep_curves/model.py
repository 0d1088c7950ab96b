"""The model of a steady creep curve with mechanisms of the library, and its fit to points.

Baseline: Polach's law with Kalker's slope (Hertz, Kalker's c11; both reduction factors 1) and the believed friction,
whose level alone is fitted. Where friction is believed constant, `falling_friction` is at excess 0 there, and its sizes refer
to A and gamma of the seed paper's Table 2.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from wsp_env.compiled import loop
from wsp_env.contact.degraded import DegradedLaw, adhesion
from wsp_env.contact.polach import contact_stiffness, falling_friction
from wsp_env.contact.traction import Surface
from wsp_env.parameters.contact import ContactParameters
from wsp_env.plant.card import Parameter
from wsp_env.plant.mechanisms import (
    ALL,
    NULL,
    Mechanisms,
    flash_temperature,
    initial_slope,
    speed_dependent_friction,
)
from wsp_env.plant.mechanisms import falling_friction as fall
from wsp_env.recordings.creep_curves import CreepContact, CreepCurves

_LEVELS = (0.003, 1.0)  # bounds of the friction coefficient [-]: assumption
_ITERATIONS = 60
_STEP = 1e-5  # of a finite difference, in units of the parameter's typical size
_CONVERGED = 2e-4  # relative fall of the sum of squares that ends a fit: some 0.04 of a gain for 200 points
_DAMPINGS = 8

Choice = dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True)
class CurveFit:
    """A model fitted to points."""

    names: tuple[str, ...]  # mechanisms that are on
    values: np.ndarray  # (p,) friction level, then the sizes of each mechanism in its order
    residual: np.ndarray  # (n,) model - measured
    cost: float  # sum of its squares


class CreepModel:
    """Adhesion coefficient at the points (n,) of creep curves, by speed and then creepage."""

    def __init__(self, data: CreepCurves) -> None:
        curves = data.curves.values()
        self.creepage = np.concatenate([one.creepage for one in curves])
        self.speed = np.concatenate([np.full(len(one.creepage), one.speed_mps) for one in curves])
        self.measured = np.concatenate([one.adhesion for one in curves])
        self.curve = np.repeat(np.arange(len(data.curves)), [len(one.creepage) for one in curves])
        self.contact = data.contact
        self.believed = _believed(data.contact)
        patch = data.contact.patch()
        self._heating = flash_temperature.heating(patch.semi_axis_a, patch.semi_axis_b)
        #: Slip speed [m/s] at which the friction level is defined: amid the points, so that the fall hardly moves it.
        self.reference_mps = float(np.mean(self.creepage * self.speed))

    def sizes(self, name: str) -> tuple[Parameter, ...]:
        """Return a mechanism's sizes, with the null that the believed friction gives them."""
        constant = name == "falling_friction" and self.contact.friction_ratio == 1.0
        return tuple(p._replace(null=0.0) if constant and p.name == "excess" else p for p in ALL[name].sizes)

    def choice(self, names: Iterable[str], values: np.ndarray) -> Choice:
        """Return what `mechanisms.make` takes; the values begin with the level."""
        found: Choice = {"falling_friction": {p.name: p.null for p in self.sizes("falling_friction")}}
        rest = iter(values[1:])
        for name in names:
            found[name] = {p.name: float(next(rest)) for p in self.sizes(name)}
        return found

    def law(self, choice: Choice) -> DegradedLaw:
        """Return the law with the mechanisms that act on it."""
        return _law(self.believed, _records(choice))

    def kinetic_friction(self, level: float, law: DegradedLaw) -> float:
        """Return mu_c [-] from the friction coefficient at the reference slip."""
        return level / float(falling_friction(self.reference_mps, 1.0, law.ratio_d, law.gamma_d))

    def adhesion(self, level: float, choice: Choice, at: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """Return f [-] at the points (n,), or `at` other creepages [-] and speeds [m/s], both (m,)."""
        records = _records(choice)
        law = _law(self.believed, records)
        creepage, speed = at or (self.creepage, self.speed)
        result: np.ndarray = np.empty(len(creepage))
        mu = self.kinetic_friction(level, law)
        options = (records.speed_dependent_friction, records.flash_temperature, self._heating)
        _evaluate(creepage, speed, self.contact.wheel_load_n, mu, law, *options, result)
        return result

    def fit(
        self,
        names: Sequence[str],
        measured: np.ndarray,
        start: CurveFit | None = None,
        keep: np.ndarray | None = None,
        held: Mapping[str, float] | None = None,
    ) -> CurveFit:
        """CurveFit level and sizes to adhesion coefficients (n,) by least squares, the best of several starts.

        Parameters
        ----------
        start : a fit with some of the mechanisms on, to begin at
        keep : (n,) bool, points to fit to
        held : sizes "mechanism.parameter" kept at a value

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


def _records(choice: Choice) -> Mechanisms:
    """Return what `mechanisms.make` does, without its checks: the values are inside their bounds here."""
    return NULL._replace(**{name: ALL[name].record(**values) for name, values in choice.items()})


def _law(believed: DegradedLaw, m: Mechanisms) -> DegradedLaw:
    return fall.law(m.falling_friction, initial_slope.law(m.initial_slope, believed))


def _by_name(model: CreepModel, fit: CurveFit) -> dict[tuple[str, str], float]:
    keys = [(name, p.name) for name in fit.names for p in model.sizes(name)]
    return dict(zip(keys, map(float, fit.values[1:]), strict=True))


def _least_squares(
    function: Callable[[np.ndarray], np.ndarray], start: np.ndarray, box: np.ndarray, unit: np.ndarray, keep: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Levenberg's and Marquardt's method in a box: values, residuals and their sum of squares.

    scipy's `least_squares` does the same in bounds, some ten times slower at this size, and hundreds of null recordings wait.
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
    mu: float,
    law: DegradedLaw,
    by_speed: speed_dependent_friction.Parameters,
    flash: flash_temperature.Parameters,
    heating: flash_temperature.Heating,
    out: np.ndarray,
) -> None:
    for i in range(creepage.size):
        slip = creepage[i] * speed[i]
        here = mu * speed_dependent_friction.friction_factor(by_speed, speed[i])
        on = Surface(here, law.mu_cr, 1.0, 0.0)
        cold = adhesion(slip, speed[i], load, on, 0.0, law)  # tau = 0: the limit without recovery
        out[i] = flash_temperature.heated(flash, heating, cold, slip, speed[i], load).f
