"""Creep curves, the second kind of recording: which physics Kalker's slope and constant friction lack."""

from wsp_env.diagnosis.creep_curves.answer import CreepDiagnosis
from wsp_env.diagnosis.creep_curves.diagnose import diagnose_creep_curves

__all__ = ["CreepDiagnosis", "diagnose_creep_curves"]
