"""From a campaign to a diagnosis: the steps in their order."""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from wsp_env.diagnosis.accepted import Accepted
from wsp_env.diagnosis.answer import Diagnosis, Discovered, Estimate, Evidence, FitQuality, Named, Verdict
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.candidates import unavailable, variants, without
from wsp_env.diagnosis.convergence import converge_law
from wsp_env.diagnosis.data_first import data_first
from wsp_env.diagnosis.decide import Outcome, nothing, select
from wsp_env.diagnosis.discovered import OF_WHEELS, Words, axles_on, equation, looks_like, slot_of, slot_of_title, unit_in
from wsp_env.diagnosis.effects import course, curve, held_out
from wsp_env.diagnosis.estimates import estimates, undetermined
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.locate import locate, residual_map
from wsp_env.diagnosis.quality import Quality, quality
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Found, detectable
from wsp_env.diagnosis.side_by_side import on_threads
from wsp_env.diagnosis.stops import PreparedStop, prepare
from wsp_env.diagnosis.structure import structured
from wsp_env.diagnosis.timing import aligned, times
from wsp_env.diagnosis.trials import Trial
from wsp_env.diagnosis.verdict import describes_a_part, has_another_form, improves_nothing, leaves_something, verdict_of
from wsp_env.diagnosis.wander import NOTES, Wandering, wandering
from wsp_env.diagnosis.weights import sliding
from wsp_env.diagnosis.words import BALANCES, mechanism_words, next_test, sentence
from wsp_env.diagnosis.worth import worth_of
from wsp_env.plant.mechanisms import misread_speed
from wsp_env.recordings import Campaign, CampaignError

#: A run is left out as damaged if its root mean square residual exceeds that of the others by this factor.
_DAMAGED = 5.0
_LOG10 = float(np.log(10.0))
_EVIDENCE_REPORTED = 30

Progress = Callable[[str], None]


def diagnose(campaign: Campaign, progress: Progress = lambda step: None, workers: int = 2) -> Diagnosis:
    """Find which physics the simulation of a campaign lacks.

    Parameters
    ----------
    progress : called with the name of the next step
    workers : threads that evaluate candidates in parallel; the answer does not depend on them

    Raises
    ------
    CampaignError
        if no run can be used

    """
    # The matrices are small: BLAS threads would only compete with the workers.
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(workers) as pool, on_threads(pool):
        return _diagnose(campaign, progress)


def _diagnose(campaign: Campaign, progress: Progress) -> Diagnosis:
    progress("checking the data")
    first = data_first(campaign)
    if first.answer is not None:
        return first.answer
    stops, notes = prepare(campaign)
    if not stops:
        raise CampaignError(f"campaign {campaign.name}: no run can be diagnosed: {'; '.join(notes)}")
    progress("fitting the baseline")
    replica, damaged = _sound(campaign, stops)
    read = times(replica)
    if read.matters:
        sound = {stop.name for stop in replica.stops}
        stops = [stop for stop in prepare(aligned(campaign, read))[0] if stop.name in sound]
        replica = Replica(Balances(campaign, stops), replica.baseline)
    notes += damaged
    replica, noise_parameters = converge_law(replica, read.sizes)
    progress("searching")
    tried, wanders = list(variants(replica)), wandering(replica)
    if wanders is None:
        outcome = select(replica, tried, progress, noise_parameters)
    else:
        outcome = nothing(replica, tried, noise_parameters)
    progress("judging")
    answer = dataclasses.replace(_answer(replica, outcome, notes), suspect_channels=first.suspects)
    return answer if wanders is None else _of_the_speed_alone(answer, wanders)


def _of_the_speed_alone(answer: Diagnosis, found: Wandering) -> Diagnosis:
    """Return an answer with one finding, that the recorded speed wanders: slips computed from it tell no other physics."""
    terms, where = (found.term,), (found.location,)
    return dataclasses.replace(
        answer, verdict="discovered", sentence=sentence("discovered", (), where, terms), location=where, discovered=terms,
        fit=dataclasses.replace(answer.fit, removed_validate=found.term.removed_validate),
        next_test=misread_speed.CARD.signature.next_test,
        course=found.course,
        notes=(*answer.notes, *NOTES),
    )  # fmt: skip


def _sound(campaign: Campaign, stops: list[PreparedStop]) -> tuple[Replica, list[str]]:
    """Fit the baseline; leave out runs that fit far worse than the others."""
    notes: list[str] = []
    while True:
        balances = Balances(campaign, stops)
        if not len(balances.rows):
            raise CampaignError(f"campaign {campaign.name}: no run has usable samples above walking pace")
        replica = baseline(balances)
        z = replica.whitening(replica.about)(replica.raw(replica.baseline)) ** 2
        counts = np.bincount(balances.rows.run, minlength=len(stops))
        mean = np.bincount(balances.rows.run, weights=np.minimum(z, 1e4), minlength=len(stops)) / np.maximum(counts, 1)
        worse = _beside_their_kind(mean, sliding(replica))
        worst = int(np.argmax(worse))
        if worse[worst] < _DAMAGED**2:
            return replica, notes
        notes.append(
            f"run {stops[worst].name} fits far worse than all others of its kind (sliding or not) and was left out as damaged"
        )
        stops = [stop for i, stop in enumerate(stops) if i != worst]


def _beside_their_kind(mean: np.ndarray, slides: np.ndarray) -> np.ndarray:
    """Return each run's mean square (R,) over the median of the others of its kind (R,) bool, sliding or not.

    They show different physics: what is missing in all runs of a kind is no damage of each. Beside fewer than two it is 0.
    """
    worse = np.zeros(len(mean))
    for i in range(len(mean)):
        others = np.delete(mean, i)[np.delete(slides, i) == slides[i]]
        if len(others) >= 2:
            worse[i] = mean[i] / max(float(np.median(others)), np.finfo(float).tiny)
    return worse


def _answer(replica: Replica, outcome: Outcome, notes: list[str]) -> Diagnosis:
    found = quality(replica, outcome)
    # A finding must be confirmed: at the size fitted to the tuning runs, the held-out runs alone must make it as sure. This is
    # a single question, so the prior odds do not count again. Its intervals, beside all others, must determine it.
    repeated = [
        one
        for one, sure in zip(outcome.accepted, found.repeated, strict=True)
        if sure and not undetermined(_estimates(outcome, one), one.trial.variant)
    ]
    missing = [one for one in outcome.missing if one in repeated]
    left = structured(outcome.replica, outcome.last, outcome.weights)
    failed = bool(outcome.missing or outcome.rejected)
    worthless, part = improves_nothing(missing, found), describes_a_part(missing, left, found.removed_of)
    unexplained = worthless or part or leaves_something(missing, failed, left, found)
    holds = not unexplained
    names = [one for one in missing if holds and not one.trial.listed.family and not has_another_form(one, missing)]
    named = tuple(_named(replica, outcome, one, found) for one in names)
    terms = tuple(_discovered(replica, outcome, one, found) for one in missing if holds and one not in names)
    verdict = verdict_of(named, terms, bool(named or terms) or unexplained, bool(sliding(replica).any()))
    nearest = [] if holds else [one.words for one in missing] or [_title(one) for one in outcome.rejected]
    extended = outcome.fitted.model if holds else replica.baseline
    for one in outcome.missing:
        if holds and one not in repeated:
            extended = without(extended, one.trial.variant)
    where = locate(replica, replica.baseline, extended, found.weights if holds else found.expected)
    reasons = unavailable(replica)
    small = [
        f"seen, but {'too small to matter in a stop' if one.trial.resolved else 'perhaps within a sample'}: {one.words} "
        f"({one.trial.size.multiple:.2f} of the smallest effect of interest)"
        for one in outcome.accepted
        if one not in outcome.missing
    ]
    small += [
        f"seen, but not confirmed by the held-out runs, or at a size that cannot be or may be none: {one.words}"
        for one in outcome.missing
        if one not in repeated
    ]
    if worthless:
        small += [f"seen in the runs to tune on, but worth nothing on those held out: {one.words}" for one in missing]
    small += [f"seen, but in no form that holds: {_title(one)}" for one in outcome.rejected]
    if part and not worthless:
        small += [
            f"seen, but most of what goes on in the balance of {BALANCES[left.balance]} is left by it: {one.words}"
            for one in missing
        ]
    if holds and missing and left.unexplained:
        small.append(f"what is left still goes on from row to row, {left.size:.1f} times as large as the channels' noise")
    return Diagnosis(
        campaign=replica.campaign.name,
        verdict=verdict,
        sentence=sentence(verdict, named, where, terms, nearest),
        mechanisms=named,
        location=() if verdict in ("adequate", "insufficient") else where,
        fit=_fit(found.fit, verdict, holds),
        detectable=detectable(outcome.first),
        next_test=next_test(verdict, named, reasons, where, terms),
        evidence=_evidence(outcome.first.found),
        model=model_json(replica, extended),
        residuals=residual_map(replica, found.squares),
        runs=held_out(replica.recorded, found.before, found.after),
        notes=(*notes, *small, *(f"{name.replace('_', ' ')}: {why}" for name, why in reasons.items())),
        course=course(replica.recorded, found.before, found.after, where),
        discovered=terms,
        worth=worth_of(outcome, extended, missing) if named or terms else None,
    )


def _title(trial: Trial) -> str:
    return trial.listed.title.replace("_", " ")


def _fit(fit: FitQuality, verdict: Verdict, holds: bool) -> FitQuality:
    """Return the quality of the fit that an answer claims: no extension where none holds, and no removal without a finding.

    The extension of an adequate model is what was seen, but is too small to matter.
    """
    if not holds:
        return dataclasses.replace(fit, extended=fit.baseline, removed_validate=None)
    return dataclasses.replace(fit, removed_validate=None) if verdict == "adequate" else fit


def _evidence(found: Sequence[Found]) -> tuple[Evidence, ...]:
    """Return the evidence of the most promising candidates; impossible ones are left out."""
    possible = [one for one in found if np.isfinite(one.evidence)]
    return tuple(
        Evidence(one.name, one.reduction, (), one.evidence / _LOG10, 0.0, float(np.abs(one.multiple).max()))
        for one in possible[:_EVIDENCE_REPORTED]
    )


def _estimates(outcome: Outcome, one: Accepted) -> dict[str, Estimate]:
    return estimates(outcome.replica, outcome.fitted, one.trial.variant, outcome.weights, one.trial.reduction)


def _named(replica: Replica, outcome: Outcome, one: Accepted, found: Quality) -> Named:
    estimates, at = _estimates(outcome, one), outcome.accepted.index(one)
    return Named(
        one.name, one.confidence, one.alternatives, estimates, one.trial.size.multiple, one.trial.reduction,
        float(len(one.trial.variant.sizes)), found.held_out[at],
        curve(replica, outcome.fitted.model, found.weights, one.name, estimates),
    )  # fmt: skip


def _discovered(replica: Replica, outcome: Outcome, one: Accepted, found: Quality) -> Discovered:
    """Return a term, or a name in another form than the library's, as something without a name."""
    at, variant, found_values = outcome.accepted.index(one), one.trial.variant, _estimates(outcome, one)
    if variant.family:
        words, slot, like = equation(variant, outcome.fitted.model.choice[variant.name]), slot_of(variant), looks_like(variant)
        found_values = {name: dataclasses.replace(value, unit=unit_in(variant, name)) for name, value in found_values.items()}
    else:
        said = f"as if {mechanism_words(variant.name, found_values)}, but in another form"
        words, slot, like = Words(said, axles_on(variant), ()), slot_of_title(variant.name), (one.words,)
    others = one.alternatives[1:]
    slots = tuple(other for other in dict.fromkeys(map(slot_of_title, others)) if other != slot)
    axles = words.axles or (tuple(range(1, replica.axles + 1)) if slot in OF_WHEELS else ())
    return Discovered(
        slot, slots, tuple(name.replace("_", " ") for name in others), axles, words.equation, words.features,
        found_values, like, found.fit.removed_validate, one.trial.size.multiple,
        one.trial.reduction, found.held_out[at],
    )  # fmt: skip


def model_json(replica: Replica, model: Model) -> dict[str, Any]:
    """Return the content of model.json, from which an environment takes the tuned law and the mechanisms found."""
    vehicle = dataclasses.asdict(replica.campaign.vehicle)
    believed = [stop.name for stop, slides in zip(replica.stops, sliding(replica), strict=True) if not slides]
    return {
        "tau_m_per_J": model.tau,
        "mu_cd": {stop.name: mu for stop, mu in zip(replica.stops, model.mu_cd, strict=True)},
        **({"note_mu_cd": f"believed, not fitted, because hardly any wheel slides: {', '.join(believed)}"} if believed else {}),
        "mechanisms": {name: dict(values) for name, values in model.choice.items()},
        "contact": dataclasses.asdict(replica.campaign.contact),
        "vehicle": {key: list(value) if isinstance(value, tuple) else value for key, value in vehicle.items()},
    }
