"""From findings and what they leave to a verdict."""

from collections.abc import Mapping, Sequence

from wsp_env.diagnosis.accepted import Accepted
from wsp_env.diagnosis.answer import Discovered, Named, Verdict
from wsp_env.diagnosis.discovered import one_thing
from wsp_env.diagnosis.quality import Quality
from wsp_env.diagnosis.structure import Structure

#: Share of the removable held-out residual from which on a finding stands although the remaining residual is correlated.
_MOST_REMOVED = 0.5
#: Ratio of mean squares, extended model over baseline, from which on the extension fits worse; allows for rounding.
_WORSE = 1.01


def improves_nothing(missing: Sequence[Accepted], found: Quality) -> bool:
    """Whether findings fit worse than the baseline, or remove nothing of the held-out residual."""
    worse = max(found.fit.extended[group] / found.fit.baseline[group] for group in found.fit.baseline) > _WORSE
    removed = found.fit.removed_validate
    return bool(missing) and (worse or (removed is not None and removed <= 0.0))


def describes_a_part(missing: Sequence[Accepted], left: Structure, removed_of: Mapping[str, float | None]) -> bool:
    """Whether only terms were found, and they leave most of the residual in the most correlated balance.

    A name is known physics with a trace of its own; something else may be missing beside it. A term is constructed from the
    residual. If it leaves most of the correlated residual, it describes only a part of something that no term can express.
    """
    only_terms = bool(missing) and all(one.trial.listed.family for one in missing)
    return only_terms and left.unexplained and (removed_of[left.balance] or 0.0) < _MOST_REMOVED


def leaves_something(missing: Sequence[Accepted], failed: bool, left: Structure, found: Quality) -> bool:
    """Whether the recordings show physics that no model here describes.

    Either the residual has structure, and no finding removes most of what can be removed: what is too small to matter, or
    normal, is no finding. Or a candidate with evidence and sufficient size `failed` a check, and the held-out runs misfit.
    """
    removes_most = bool(missing) and (found.fit.removed_validate or 0.0) >= _MOST_REMOVED
    return (left.unexplained and not removes_most) or (failed and not missing and found.misfits)


def has_another_form(name: Accepted, missing: Sequence[Accepted]) -> bool:
    """Whether terms act beside a name on the same thing: two faults of one brake are rarer than one in another form."""
    mine = one_thing(name.trial.variant)
    return mine is not None and any(one.trial.listed.family and one_thing(one.trial.variant) == mine for one in missing)


def verdict_of(named: tuple[Named, ...], terms: tuple[Discovered, ...], seen: bool, slides: bool) -> Verdict:
    """Return the verdict on findings with and without a name; without any, whether something is `seen`, and a wheel slides."""
    if named:
        return "ambiguous" if any(len(one.alternatives) > 2 for one in named) else "named"
    if terms:
        return "discovered"
    if seen:
        return "unknown"
    return "adequate" if slides else "insufficient"
