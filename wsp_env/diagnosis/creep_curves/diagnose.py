"""The diagnosis of creep curves: which physics the believed creep curve lacks, from measured points."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import Estimate, Evidence, FitQuality, Location, Verdict
from wsp_env.diagnosis.creep_curves.answer import Closure, CreepDiagnosis, CrossValidation, NamedOnCurve, ShownCurve
from wsp_env.diagnosis.creep_curves.model import CreepModel, CurveFit
from wsp_env.diagnosis.creep_curves.search import CLOSURE, FOLDS, NULLS, RARE, CreepSearch, Reductions
from wsp_env.diagnosis.creep_curves.separation import Spread, correlations, estimates, inseparable
from wsp_env.diagnosis.creep_curves.words import next_test, notes, sentence
from wsp_env.recordings.creep_curves import CreepCurves

#: Limits within which a rival name is not distinguished: difference of chi-square reduction, absolute and as a share.
_INDISTINCT, _SHARE_OF_REDUCTION = 9.0, 0.1
_FORM = 0.03  # possible error of a mechanism's form, as share of its reduction of chi-square; as for stops
_PLACES = 12  # parts of a curve in which baseline and points are compared
_SEEN = 3.0  # standard deviations from which on a part counts as missed
_GRID = 120  # number of points of a drawn curve


def diagnose_creep_curves(
    data: CreepCurves, effort: float = 1.0, seed: int = 0, progress: Callable[[str], None] = lambda step: None
) -> CreepDiagnosis:
    """Find where a law with Kalker's slope and the believed friction misses the points, and which mechanisms it lacks.

    Parameters
    ----------
    data : see `wsp_env.recordings.creep_curves.read_creep_curves`
    effort : factor on the number of null recordings
    seed : of the null recordings
    progress : called with the name of each step

    """
    model = CreepModel(data)
    search = CreepSearch(model, max(NULLS, round(NULLS * effort)), seed, progress)
    fit, first, last = search.forward()
    fit, against, last = _accepted(search, fit, last)
    closure = _closure(search, fit, last)
    explained = (search.baseline.cost - fit.cost) / search.variance
    unknown = closure is not None and closure.gain > explained and closure.held_out_gain > 0.0
    if unknown:  # a smooth curve explains more than all names together: report no name
        fit, against, last, closure = search.baseline, {}, first, _closure(search, search.baseline, first)
    spread = Spread(search, fit, last)
    parameters, law = estimates(spread)
    every = [_named(search, fit, name, reductions, parameters[name]) for name, reductions in against.items()]
    named = tuple(sorted(every, key=lambda one: -one.gain))
    seen = _detectable(search, fit, last)
    verdict: Verdict = "named" if all(len(one.alternatives) <= 2 for one in named) else "ambiguous"
    if not named:
        verdict = "unknown" if unknown else "adequate" if _shows_typical(model, seen) else "insufficient"
    bound = inseparable(spread)
    where = _location(search, fit, list(data.curves))
    return CreepDiagnosis(
        data.name, verdict, sentence(verdict, named), named, where, _quality(search, fit), seen,
        next_test(verdict, named, bound, model), closure, _evidence(search, first), _confounding(search),
        _model_json(search, fit), notes(search, fit, closure, seen), _cross_validation(search, fit), law, correlations(spread),
        bound, _curves(search, fit, spread, data),
    )  # fmt: skip


def _accepted(search: CreepSearch, fit: CurveFit, last: Reductions) -> tuple[CurveFit, dict[str, Reductions], Reductions]:
    """Drop mechanisms that the others make unnecessary; return the fit, the reductions without each name, and the last."""
    against: dict[str, Reductions] = {}
    for name in fit.names:
        others = tuple(one for one in fit.names if one != name)
        without = search.model.fit(others, search.measured)
        rest = [(one,) for one in search.candidates if one not in others]
        against[name] = search.reductions(without, rest, f"without {name}")
    weak = [name for name, g in against.items() if len(fit.names) > 1 and g.probability(_index(g, name)) > RARE]
    if weak:
        weakest = min(weak, key=lambda name: against[name].data[_index(against[name], name)])
        fit = search.model.fit(tuple(name for name in fit.names if name != weakest), search.measured)
        rest = [(name,) for name in search.candidates if name not in fit.names]
        return _accepted(search, fit, search.reductions(fit, rest, f"after dropping {weakest}"))
    return fit, against, last


def _index(reductions: Reductions, name: str) -> int:
    return reductions.names.index((name,))


def _named(
    search: CreepSearch, fit: CurveFit, name: str, reductions: Reductions, parameters: dict[str, Estimate]
) -> NamedOnCurve:
    mine = _index(reductions, name)
    top = float(reductions.data[mine])
    rivals = {names[0]: float(g) for names, g in zip(reductions.names[:-1], reductions.data[:-1], strict=True)}
    free = {one: min(its, top) for one, its in rivals.items() if one != name and one not in fit.names}
    near = sorted(
        (one for one in free if free[one] >= top - max(_INDISTINCT, _SHARE_OF_REDUCTION * top)), key=lambda one: -free[one]
    )
    scale = max(2.0, _FORM * top)
    belief = 1.0 / (1.0 + sum(float(np.exp((its - top) / (2.0 * scale))) for its in free.values()))
    held_out = float(np.sum(search.held_out(reductions.current) ** 2) - np.sum(search.held_out(fit) ** 2)) / search.variance
    return NamedOnCurve(
        name,
        belief * (1.0 - reductions.probability(mine)),
        (name, *near),
        parameters,
        search.multiple(fit, reductions.current),
        top,
        float(reductions.null[:, mine].max()),
        held_out,
    )


def _closure(search: CreepSearch, fit: CurveFit, last: Reductions) -> Closure | None:
    """Return the closure (smooth function of creepage) if it reduces chi-square more than in any null recording."""
    if last.probability(len(last.names) - 1) > RARE:
        return None
    return Closure(CLOSURE, float(last.data[-1]), search.closure_held_out(fit))


def _location(search: CreepSearch, fit: CurveFit, runs: Sequence[str]) -> tuple[Location, ...]:
    """Return where the points deviate from the baseline and from the model without each of the mechanisms found."""
    found = [*_missed(search, search.baseline, runs, "the baseline")]
    if len(fit.names) > 1:
        for name in fit.names:
            without = search.model.fit([one for one in fit.names if one != name], search.measured)
            found += _missed(search, without, runs, f"the law that lacks {name.replace('_', ' ')} alone")
    return tuple(found)


def _missed(search: CreepSearch, model: CurveFit, runs: Sequence[str], called: str) -> list[Location]:
    """Return the significant deviations from a model, largest first; neighbouring parts with equal sign are joined."""
    found, total = [], 0.0
    for k, run in enumerate(runs):
        here = np.flatnonzero(search.model.curve == k)
        parts = np.array_split(here, min(_PLACES, max(len(here) // 5, 1)))
        above = [float(np.sum(model.residual[part])) < 0.0 for part in parts]
        for side, group in itertools.groupby(zip(above, parts, strict=True), key=lambda one: one[0]):
            rows = np.concatenate([part for _, part in group])
            mean = abs(float(np.mean(model.residual[rows])))
            deviation = float(np.sqrt(np.mean(search.scatter[rows] ** 2) / len(rows)))
            size = len(rows) * max(mean**2 - deviation**2, 0.0)
            total += size
            if mean > _SEEN * deviation:
                low, high = search.model.creepage[rows[[0, -1]]]
                lies = f"{mean:.3f} {'above' if side else 'below'} {called} on average"
                found.append(
                    (size, Location("adhesion", (), (run,), f"creepage {low:.2%} to {high:.2%}: adhesion {lies}", size))
                )
    found.sort(key=lambda one: -one[0])
    return [dataclasses.replace(place, share=size / total) for size, place in found]


def _quality(search: CreepSearch, fit: CurveFit) -> FitQuality:
    def squares(one: CurveFit) -> dict[str, float]:
        freedom = len(search.measured) - len(one.values)
        held_out = float(np.mean(search.held_out(one) ** 2))
        return {"tune": one.cost / freedom / search.variance, "validate": held_out / search.variance}

    base, extended = squares(search.baseline), squares(fit)
    removable = base["validate"] - 1.0
    removed = (base["validate"] - extended["validate"]) / removable if fit.names and removable > 0.0 else None
    return FitQuality(1.0, base, extended, removed)


def _cross_validation(search: CreepSearch, fit: CurveFit) -> CrossValidation:
    models = {"baseline": search.baseline, "extended": fit}
    errors = {key: search.held_out(one) for key, one in models.items()}
    blocks = [search.folds == k for k in range(FOLDS) if (search.folds == k).any()]
    order = [search.model.creepage[block] for block in blocks]
    return CrossValidation(
        len(blocks),
        float(np.sqrt(search.variance)),
        {key: _rms(one.residual) for key, one in models.items()},
        {key: _rms(one) for key, one in errors.items()},
        [(float(one.min()), float(one.max())) for one in order],
        {key: [_rms(one[block]) for block in blocks] for key, one in errors.items()},
    )


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _detectable(search: CreepSearch, fit: CurveFit, last: Reductions) -> dict[str, dict[str, float]]:
    """Smallest change of the last size, others typical, whose chi-square reduction exceeds that of all null recordings."""
    needed = float(last.null[:, :-1].max()) if last.null.shape[1] > 1 else 0.0
    found = {}
    for name in (one for one in search.candidates if one not in fit.names):
        size = search.model.sizes(name)[-1]
        bound = size.high if size.typical >= size.null else size.low
        start = search.model.choice(fit.names, fit.values)

        def reduction(share: float, name: str = name, size: Any = size, bound: float = bound, start: Any = start) -> float:
            sizes = {p.name: p.typical for p in search.model.sizes(name)} | {size.name: size.null + share * (bound - size.null)}
            made = search.model.adhesion(float(fit.values[0]), start | {name: sizes})
            return search.model.fit(fit.names, made, fit).cost / search.variance

        low, high = 1e-4, 1.0
        if reduction(high) < needed:
            continue
        while high / low > 1.05:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if reduction(middle) >= needed else (middle, high)
        found[name] = {size.name: abs(high * (bound - size.null))}
    return found


def _shows_typical(model: CreepModel, seen: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether a mechanism would have been detected at its typical size in the literature."""
    sizes = {name: model.sizes(name)[-1] for name in seen}
    return any(seen[name][size.name] <= abs(size.typical - size.null) for name, size in sizes.items())


def _evidence(search: CreepSearch, first: Reductions) -> tuple[Evidence, ...]:
    base = float(np.sum(search.held_out(search.baseline) ** 2))
    listed = []
    for i, names in enumerate(first.names):
        neg_log10_p = float(-np.log10((1 + np.sum(first.null[:, i] >= first.data[i])) / (1 + len(first.null))))
        if names == (CLOSURE,):
            held_out, multiple = search.closure_held_out(search.baseline), 0.0
        else:
            one = first.fits[i]
            held_out = (base - float(np.sum(search.held_out(one) ** 2))) / search.variance
            multiple = search.multiple(one, search.baseline)
        listed.append(
            Evidence(names[0], float(first.data[i]), tuple(map(float, first.null[:, i])), neg_log10_p, held_out, multiple)
        )
    return tuple(listed)


def _confounding(search: CreepSearch) -> dict[str, dict[str, float]]:
    """Cosines between the changes by mechanisms of typical size, with the part along the friction level removed."""
    model, level = search.model, float(search.baseline.values[0])
    plain = search.measured + search.baseline.residual
    by_level = search.sensitivities(search.baseline)[:, 0]
    changes = {}
    for name in search.candidates:
        sizes = {p.name: p.typical for p in model.sizes(name)}
        change = model.adhesion(level, model.choice((), search.baseline.values) | {name: sizes}) - plain
        changes[name] = change - by_level * float(by_level @ change) / float(by_level @ by_level)
    lengths = {name: float(np.linalg.norm(change)) or 1.0 for name, change in changes.items()}
    return {
        a: {b: abs(float(changes[a] @ changes[b])) / lengths[a] / lengths[b] for b in changes} for a in changes
    }  # fmt: skip


def _curves(search: CreepSearch, fit: CurveFit, spread: Spread, data: CreepCurves) -> tuple[ShownCurve, ...]:
    shown = []
    for name, one in data.curves.items():
        grid = np.geomspace(min(1e-4, float(one.creepage[0])), float(one.creepage[-1]), _GRID)
        at = (grid, np.full(_GRID, one.speed_mps))

        def line(what: CurveFit, at: tuple[np.ndarray, np.ndarray] = at) -> np.ndarray:
            return search.model.adhesion(float(what.values[0]), search.model.choice(what.names, what.values), at)

        low, high = spread.interval(line)
        lines = (one.creepage, one.adhesion, grid, line(search.baseline), line(fit), low, high)
        shown.append(ShownCurve(name, one.speed_mps, *(values.tolist() for values in lines)))
    return tuple(shown)


def _model_json(search: CreepSearch, fit: CurveFit) -> dict[str, Any]:
    """Return the content of model.json: the law of this curve with mechanisms, no contaminant and hence no recovery."""
    model = search.model
    choice = model.choice(fit.names, fit.values)
    mu = model.kinetic_friction(float(fit.values[0]), model.law(choice))
    patch, law = model.contact.patch(), model.believed
    contact = {
        "semi_axis_a_m": patch.semi_axis_a, "semi_axis_b_m": patch.semi_axis_b, "kalker_c11": patch.c11,
        "shear_modulus_pa": patch.shear_modulus, "polach_k_ad": law.k_ad, "polach_k_sd": law.k_sd, "polach_k_ar": law.k_ar,
        "polach_k_sr": law.k_sr, "friction_ratio_d": law.ratio_d, "friction_ratio_r": law.ratio_r,
        "friction_decrease_d_spm": law.gamma_d, "friction_decrease_r_spm": law.gamma_r, "kinetic_friction_r": mu,
        "kinetic_friction_d": mu,
    }  # fmt: skip
    return {"tau_m_per_J": 0.0, "mu_cd": {"creep curves": mu}, "mechanisms": choice, "contact": contact}
