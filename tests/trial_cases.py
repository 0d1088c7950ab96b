"""Variants, and what a search and a refit said of them."""

from types import SimpleNamespace

import numpy as np

from wsp_env.diagnosis.candidates import Candidate, Variant
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.search import Found
from wsp_env.diagnosis.trials import Trial

GRADIENT = Variant("track_gradient", ("rise",), {})
GAIN = Variant("brake_gain_imbalance", ("gain",), {"axle": 2.0})
INERTIA = Variant("wheelset_inertia", ("share",), {})
MEMORY = Variant("contaminant_memory", ("distance_m",), {})
TERM = Variant("discovered", ("coefficient_1",), {"slot_1": 0.0}, (100.0,), "brake torque by braking")
#: Weights whose deviance is the cost alone; the same beside further nuisances.
BENT = SimpleNamespace(deviance=lambda cost: cost, freed=lambda columns: BENT)
PLAIN = SimpleNamespace(deviance=lambda cost: cost, beside=lambda columns: BENT, freed=lambda columns: PLAIN)


def unfreed(weights, seen, variants):
    """Return weights as they are, in place of `trials.freed`: no small mechanism is among these nuisances."""
    return weights


def candidate(variant: Variant = GRADIENT, k: int = 1) -> Candidate:
    return Candidate(variant, np.zeros((0, k)), np.ones(k))


def found(variant: Variant, evidence: float) -> Found:
    return Found(candidate(variant), evidence, np.ones(1), np.ones(1), np.ones(1), 2.0 * evidence)


def trial(variant: Variant, evidence: float, multiple: float = 2.0) -> Trial:
    size = StopChange(0.01 * multiple, 0.0)
    null_model = Model(2e-4, (0.06,))
    return Trial(found(variant, evidence), variant, variant, None, evidence, null_model, 2.0 * evidence, size, 0.0)
