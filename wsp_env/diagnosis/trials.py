"""Tries mechanisms: each is refitted together with the accepted ones, and its evidence is computed again."""

import copy
import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.candidates import Variant, at_bound, near, refined, switched, without
from wsp_env.diagnosis.colour import slide_whitening
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted, cost, refit
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.net import net_effect
from wsp_env.diagnosis.noise import Noise, NoiseParameters, noise_from_parameters, noise_of
from wsp_env.diagnosis.readings import of_noise
from wsp_env.diagnosis.replica import OF_TIME, OF_TORQUE, Replica
from wsp_env.diagnosis.search import Found, Screen
from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import Weights, weigh, weights_from
from wsp_env.plant.mechanisms import ALL

#: Number of terms that are refitted at a time, beside all names; the next ones follow only if none of these holds.
REFITTED = 4
#: Shares of the linear step that are tried as start of a refit.
_SHARES = (2.0, 1.0, 0.5, 0.25, 0.1)
#: Log prior odds that a name of the library is missing in a campaign: one in fifty (assumption).
PRIOR = -float(np.log(50.0))
#: Log prior odds of a term without a name. Three in four of the missing effects have a name (assumption), and there are three
#: times as many terms as names (about eighty on four axles).
PRIOR_TERM = PRIOR - float(np.log(3.0 * 3.0))
#: Log odds from which on a mechanism is accepted: 95 %.
SURE = float(np.log(19.0))
#: Largest difference of evidence at which another name is as good: a factor of e^10. The form error sets a further limit.
INDISTINCT = 10.0
#: Form error: share of a mechanism's effect by which the true form may differ, over slip, speed, work, axles and runs
#: (assumption, one standard deviation).
FORM = 0.2
#: Size, in smallest effects of interest, from which on a mechanism matters: one less the form error at 95 %, 1 / (1 + 1.645
#: FORM), rounded.
MATTERS = 0.75
_Z90 = 1.645  # two-sided 90 % quantile of the normal distribution
#: Form error of a term without a name, which is one of few forms tried (assumption).
FORM_TERM = 0.4


@dataclasses.dataclass(frozen=True)
class Trial:
    """A mechanism refitted together with the accepted ones."""

    found: Found
    listed: Variant  # as it was searched
    variant: Variant  # with the parameters that the refit moves as sizes
    fitted: Fitted
    evidence: float  # including what the refit explains beyond the linear search
    null_model: Model  # model without it, fitted in the same way
    reduction: float  # of the sum of squares
    size: StopChange  # net
    penalty: float  # half of the reduction less the evidence: the cost of its sizes and variants
    resolved: bool = True  # False: a delay that may be within a sample; it stays in the model, and is no finding

    @property
    def matters(self) -> bool:
        """Whether it is large enough to be a finding, and told from what is normal."""
        return self.resolved and self.size.multiple >= MATTERS


def form_of(variant: Variant) -> float:
    """Form error as a share of the effect; 0 if geometry or a clock determines exactly what a sensor shows."""
    if variant.family:
        return FORM_TERM
    return 0.0 if ALL[variant.name].signature.exact and on_a_sensor(variant) else FORM


def on_a_sensor(variant: Variant) -> bool:
    """Whether a mechanism acts on the readings of sensors."""
    return ALL[variant.name].signature.acts_on == "sensor"


def corrects_recordings(variant: Variant) -> bool:
    """Whether a mechanism is compared on recordings corrected for it: it acts on sensors, or is a delay."""
    return on_a_sensor(variant) or variant.name in OF_TIME


def hides_in_noise(one: Found) -> bool:
    """Whether a mechanism changes the wheelsets' inertia, and the 90 % intervals of its search exclude its absence.

    What another inertia leaves of J dw/dt counts as noise, so that the search finds too little evidence of it.
    """
    distinct = np.abs(one.multiple) > _Z90 * one.deviation
    return "inertia" in ALL[one.candidate.variant.name].acts and bool(distinct.any())


def fades(one: Found) -> bool:
    """Whether a mechanism follows over a rolled distance: the search, which is linear, may find nothing of it."""
    return any(size.rolled for size in ALL[one.candidate.variant.name].sizes)


def log_odds(variant: Variant, evidence: float) -> float:
    """Log posterior odds that a mechanism, or a term without a name, is missing."""
    return evidence + (PRIOR_TERM if variant.family else PRIOR)


def _kind(variant: Variant) -> tuple[str | float, ...]:
    """Return what distinguishes candidates: the name of a mechanism; slot and features of a term."""
    codes = [value for name, value in variant.fixed.items() if name.startswith(("slot", "feature"))]
    return (variant.name, *codes) if variant.family else (variant.name,)


def trials_of(
    replica: Replica, seen: Screen, fitted: Fitted, weights: Weights
) -> Iterator[list[Trial]]:  # fmt: skip
    """Refit the promising mechanisms: all names and a few terms, then further terms; yield the trials, best first.

    A name may explain most although others explain more linearly: all are refitted before one is accepted.
    """
    kinds: dict[tuple[str | float, ...], Found] = {}  # of terms that differ only in their axles, the best is tried
    for each in sorted(seen.found, key=lambda one: -log_odds(one.candidate.variant, one.evidence)):
        kinds.setdefault(_kind(each.candidate.variant), each)
    left = [one for one in kinds.values() if log_odds(one.candidate.variant, one.evidence) > 0.0]
    start = refit(replica, fitted.model, fitted.variants, weights) if left else fitted
    missed, late = [one for one in seen.found if one.name in OF_TIME or hides_in_noise(one)], 0.0
    fading = [one for one in seen.found if fades(one)]

    def trial(one: Found) -> Trial:
        tried = _fit_on_replica(replica, start, weights, one)
        penalty = 0.5 * one.reduction - one.evidence
        size = net_effect(replica, tried.fitted.model, tried.variant, seen.whitening)
        return Trial(
            one, one.candidate.variant, tried.variant, tried.fitted, 0.5 * tried.reduction - penalty, tried.null_model,
            tried.reduction, size, penalty,
        )  # fmt: skip

    while left:
        names = [one for one in left if not one.candidate.variant.family]
        promising = names + [one for one in left if one.candidate.variant.family][:REFITTED]
        # Delays are the least linear effects, and another inertia looks like noise: the linear search may miss both. They are
        # tried with whatever is found first. Late wheel speeds are also equivalent to a late brake with an early clock.
        in_time = any(one in missed or _follows_torque(one.candidate.variant) for one in promising)
        if missed and (in_time or not fitted.variants):
            promising = [*[one for one in promising if one not in missed], *missed]
            missed = []
        promising += [one for one in fading if one not in promising]
        fading = []
        left = [one for one in left if one not in promising]
        # A refit moves the location of a mechanism only locally; the second-best place or band may be the better start.
        seconds = [seen.second[one.name] for one in promising if one.name in seen.second]
        promising += [one for one in seconds if len(refined(one.candidate.variant).sizes) > len(one.candidate.variant.sizes)]
        best: dict[str, Trial] = {}
        tried = side_by_side(trial, promising)
        late = _evidence_of_late_brakes(tried, late)
        for one in sorted(_beyond_delays(tried, late), key=lambda one: -log_odds(one.listed, one.evidence)):
            best.setdefault(one.listed.title, one)
        yield list(best.values())


def _evidence_of_late_brakes(trials: Sequence[Trial], least: float) -> float:
    """Return the evidence of late brakes, if it is more than `least`."""
    return max([least, *(one.evidence for one in trials if one.listed.name in OF_TIME and not on_a_sensor(one.listed))])


def _beyond_delays(trials: Sequence[Trial], less: float) -> list[Trial]:
    """Return trials; of a term that follows the course of the torque, only what no delay of brakes explains counts.

    Brakes that are late by less than a sample are normal, and are no finding.
    """
    return [
        dataclasses.replace(one, evidence=one.evidence - less, penalty=one.penalty + less)
        if _follows_torque(one.listed)
        else one
        for one in trials
    ]


def _follows_torque(variant: Variant) -> bool:
    """Whether a candidate is a term that follows the course of the torque."""
    return bool(variant.family) and any(
        name.startswith("feature") and value in OF_TORQUE for name, value in variant.fixed.items()
    )


class _BestFit(NamedTuple):
    """The best fit of a mechanism beside the accepted ones."""

    variant: Variant  # with the parameters that the refit moves as sizes
    fitted: Fitted
    null_model: Model  # model without it, fitted in the same way
    reduction: float  # decrease of the sum of squares


def _fit_on_replica(replica: Replica, start: Fitted, weights: Weights, one: Found) -> _BestFit:
    """Fit a mechanism, starting at those shares of its linear step, or at the step of the search, that fit best.

    The linear step may be wrong, and a refit of the location may improve it or lose it. The search knows the effect of its own
    step. A linear step many times as long leads far beyond a nonlinear effect.
    """
    listed = one.candidate.variant
    best, free, ends = start, listed, True
    shares = (*_SHARES, 1.0 / max(float(np.abs(one.amplitude).max()), 1e-9))
    values = listed.null() - np.multiply.outer(shares, one.amplitude * listed.moves())
    on_the_way = [switched(start.model, listed, each) for each in values]
    first, second = sorted(on_the_way, key=lambda model: cost(replica, model, weights))[:2]
    there, wide = near(listed), refined(near(listed))
    narrow = [(there, first)] if wide.sizes != there.sizes else []
    for tried, begin in ((wide, first), *narrow, (wide, second)):
        again = refit(replica, begin, (*start.variants, tried), weights)
        outside = at_bound(tried, again.model)  # the recordings require another form
        if best is start or (outside, again.cost) < (ends, best.cost):
            best, free, ends = again, tried, outside
        if not ends and best.cost < start.cost - 0.8 * one.reduction:
            break
    # The accepted mechanisms may fit better now for another reason; this is not due to the tried one.
    alone = refit(replica, without(best.model, free), start.variants, weights)
    null_fit = min(start, alone, key=lambda one: one.cost)
    return _BestFit(free, best, null_fit.model, null_fit.cost - best.cost)


def weights_of(replica: Replica, seen: Screen) -> Weights:
    """Return the weights of a screen, with mechanisms at sizes too small to matter.

    If other wheels slide on the replica than on the screen's, or its rows have other noise, the nuisances are computed again
    with the same sizes.
    """
    sizes = Sizes(np.append(seen.sizes.groups, 1.0), seen.sizes.noise)
    whitening, groups = seen.whitening, seen.groups
    if of_noise(replica.about) != of_noise(seen.about):
        whitening = dataclasses.replace(replica.whitening(replica.about), colour=slide_whitening(replica.rows, seen.colour))
        groups = nuisances(replica, replica.about, replica.raw(replica.about), whitening)
    return weigh(replica, whitening, [*groups, seen.small], sizes)


def freed(weights: Weights, seen: Screen, variants: Sequence[Variant]) -> Weights:
    """Return the weights to seek the sizes of mechanisms: small ones of the same names are left out (see `Weights.freed`)."""
    return weights.freed(seen.small_of(variants))


class ReplicaNoise:
    """Nuisance sizes and colour of the noise estimated on a replica, beside mechanisms at sizes too small to matter.

    Parameters
    ----------
    seen : the screen that knows the small mechanisms, and from whose sizes the estimate starts
    model : whose residuals they are; None: the one about which the replica was made
    like : noise about a similar model; its colour is taken, and its nuisances if there are any; None: both are estimated

    """

    def __init__(self, replica: Replica, seen: Screen, model: Model | None = None, like: Noise | None = None) -> None:
        model = model or replica.about
        base = replica.raw(model)
        if like is None:
            self.noise = noise_of(replica, model, base, start=seen.sizes)
        else:
            known = NoiseParameters(seen.sizes, like.colour)
            self.noise = noise_from_parameters(known, replica, model, base, like.groups)
        self._replica, self._groups = replica, [*self.noise.groups, seen.small]
        self._evidence = Evidence(replica, self.noise.whitening, self._groups, base)
        self._sizes = self._estimated()

    def _estimated(self) -> Sizes:
        before = self.noise.sizes
        return self._evidence.solve(Sizes(np.append(before.groups, 1.0), before.noise))

    def about(self, model: Model) -> "ReplicaNoise":
        """Return the same for the residuals of another model: with sizes of its own, the same nuisances and colour."""
        other = copy.copy(self)
        other._evidence = self._evidence.about(self._replica.raw(model))
        other._sizes = other._estimated()
        return other

    @property
    def parameters(self) -> NoiseParameters:
        """What it tells about the noise of similar residuals."""
        return NoiseParameters(Sizes(self._sizes.groups[:-1], self._sizes.noise), self.noise.colour)

    def weights(self) -> Weights:
        """Return the weights of the residuals."""
        return weights_from(self._replica, self.noise.whitening, self._groups, self._sizes, self._evidence)
