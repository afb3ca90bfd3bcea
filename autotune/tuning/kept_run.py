"""The record of a run that had kept its parameters and could not write it: what the journal knows of it.

Without `run.json` nobody would know what the drive should be running with (see `committed`).
"""

from __future__ import annotations

from pathlib import Path

from autotune.tuning.files import write_json
from autotune.tuning.journal import JournalState
from autotune.tuning.outcome import SCHEMA_VERSION, Outcome
from autotune.tuning.stage_prove import ENABLED

SENTENCE = "Kept: the drive holds the proved parameters; the run was cut off before its report was written."


def complete(directory: Path, state: JournalState) -> None:
    """Writes `run.json` where it is missing. Raises OSError."""
    path = directory / "run.json"
    if path.is_file() or not any(name.startswith("feedforward.") for name in state.written):
        return  # gains that were kept are the journal's alone
    content = {
        "schema": SCHEMA_VERSION, "outcome": Outcome.KEPT.value, "verdict": SENTENCE, "axis": state.axis,
        "fingerprint": state.fingerprint, "started": state.started, "machine_seconds": 0.0,
        "run_directory": str(directory), "before": None, "after": None, "committed": None, "parameters": {},
        "feedforward": {name: value for name, value in state.written.items() if name != ENABLED},
    }  # fmt: skip
    write_json(path, content)
