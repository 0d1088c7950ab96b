"""Diagnosis of creep curves, the second kind of recording: physics missing in a law with Kalker's slope."""

from wsp_env.diagnosis.creep_curves.answer import CreepDiagnosis
from wsp_env.diagnosis.creep_curves.diagnose import diagnose_creep_curves

__all__ = ["CreepDiagnosis", "diagnose_creep_curves"]
