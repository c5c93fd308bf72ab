"""Diagnoses as plain data."""

from typing import Any

from pidtsm_studies.diagnosis.diagnose import Diagnosis


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json: SI units, causes by the names of `Cause`, without the plots."""
    return {
        "good": diagnosis.is_good,
        "found": [each.cause.value for each in diagnosis.found],
        "stopped": diagnosis.stopped,
        "duration": diagnosis.duration,
        "rate": diagnosis.rate,
        "joints": list(diagnosis.joints),
        "verdicts": [
            {
                "cause": each.cause.value,
                "state": each.state.value,
                "joints": list(each.joints),
                "value": each.value,
                "limit": each.limit,
                "unit": each.unit,
                "text": each.text,
                "cure": each.cure,
            }
            for each in diagnosis.verdicts
        ],
    }
