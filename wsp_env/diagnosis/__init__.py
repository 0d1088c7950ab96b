"""Diagnosis: which physics a simulation lacks when it disagrees with recordings."""

from wsp_env.diagnosis.answer import Diagnosis, Estimate, Evidence, FitQuality, Location, Named
from wsp_env.diagnosis.diagnose import diagnose

__all__ = ["Diagnosis", "Estimate", "Evidence", "FitQuality", "Location", "Named", "diagnose"]
