"""Kinds of recordings as evidence (repeated programmes, single recordings, speed curves), and which one some are."""

from __future__ import annotations

from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.evidence.repeated import RepeatedProgramme
from autotune.diagnosis.evidence.single import SingleRecording, SpeedCurve
from autotune.estimation.data import Prepared


def evidence_of(data: Prepared) -> Evidence:
    """Speeds that were held, a programme that was repeated, or any other recordings."""
    if data.steady:
        return SpeedCurve()
    return RepeatedProgramme() if data.repeated else SingleRecording()
