"""Two sound stops as the diagnosis prepares them, for tests of replicas."""

from pathlib import Path

from synthetic_stops import stops, write_campaign

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.stops import prepare
from wsp_env.recordings import read_campaign

LAW = Model(2e-4, (0.06, 0.07))


def sound_balances(folder: Path) -> Balances:
    """Write two stops of `LAW` to a folder, and return their balances."""
    a, b = stops(LAW.tau, LAW.mu_cd, seeds=(1, 2), noise=1.0)
    write_campaign(folder, {"A1": a, "B1": b}, ["A1"], ["B1"])
    campaign = read_campaign(folder)
    return Balances(campaign, prepare(campaign)[0])
