"""Whether a campaign passes the seed paper's own validation: then whatever is missing in the law is concealed.

This is the one place of the bank that uses `wsp_env`: its reading and tuning decide which cases are kept, not what is in them.
"""

from pathlib import Path

from wsp_env.recordings import CampaignError, read_campaign, tune
from wsp_env.recordings.tuning import Tuning

#: Worst relative error of the adhesion coefficient in Table 4 of the seed paper [-].
WORST_ERROR = 0.051


def tuned(folder: Path) -> Tuning | None:
    """Return the law tuned to a campaign, and its scores; None where no stop to tune on slides."""
    campaign = read_campaign(folder)
    try:
        return tune(campaign)
    except CampaignError:
        return None


def worst_error(folder: Path) -> float | None:
    """Return the largest relative adhesion error over runs and axles after tuning [-]; None where no stop to tune on slides."""
    found = tuned(folder)
    scores = found.runs.values() if found else ()
    return max((error for score in scores for error in score.error if error is not None), default=None)


def passes(error: float | None) -> bool:
    """Whether the law passes; a campaign without sliding contradicts nothing."""
    return error is None or error <= WORST_ERROR
