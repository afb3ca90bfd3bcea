"""autotune: tunes servo axes by experiment, model and proof.

    import autotune
    recording = autotune.read_recording("axis.parquet")
    fitted = autotune.fit(recording)
    print(autotune.diagnose(recording, fitted))

`docs/python.md` shows the whole. Importing this package loads nothing else and changes nothing in the process: each
name is loaded when it is used for the first time. Everything not named here may change from version to version.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from autotune.api.axes import simulate, tune
    from autotune.api.files import import_recording
    from autotune.api.models import add_effect, compare, diagnose, fit
    from autotune.api.results import AddedEffect, Comparison, DiagnosisResult
    from autotune.core.errors import AutotuneError
    from autotune.diagnosis.fit_result import FitResult
    from autotune.models.drive_model import DriveModel
    from autotune.models.model_file import read_model, write_model
    from autotune.recordings.files import read_recording, write_recording
    from autotune.recordings.recording import Controller, Metadata, Recording
    from autotune.tuning.outcome import RunResult

__version__ = "0.2.0"
__all__ = [
    "AddedEffect",
    "AutotuneError",
    "Comparison",
    "Controller",
    "DiagnosisResult",
    "DriveModel",
    "FitResult",
    "Metadata",
    "Recording",
    "RunResult",
    "add_effect",
    "compare",
    "diagnose",
    "fit",
    "import_recording",
    "read_model",
    "read_recording",
    "simulate",
    "tune",
    "write_model",
    "write_recording",
]
_HOMES = {
    "autotune.api.axes": ("simulate", "tune"),
    "autotune.api.files": ("import_recording",),
    "autotune.api.models": ("add_effect", "compare", "diagnose", "fit"),
    "autotune.api.results": ("AddedEffect", "Comparison", "DiagnosisResult"),
    "autotune.core.errors": ("AutotuneError",),
    "autotune.diagnosis.fit_result": ("FitResult",),
    "autotune.models.drive_model": ("DriveModel",),
    "autotune.models.model_file": ("read_model", "write_model"),
    "autotune.recordings.files": ("read_recording", "write_recording"),
    "autotune.recordings.recording": ("Controller", "Metadata", "Recording"),
    "autotune.tuning.outcome": ("RunResult",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Loads what is named in `__all__` (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'autotune' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
