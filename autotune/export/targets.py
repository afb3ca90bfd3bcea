"""The targets that a model can be exported to, and the one way to export."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

from autotune.core.errors import ConfigurationError
from autotune.export.c_file import export_c
from autotune.export.csv_tables import export_csv
from autotune.export.fmu import export_fmu
from autotune.export.linuxcnc import export_linuxcnc
from autotune.export.request import NAME, Exported, Request
from autotune.export.structured_text import export_st
from autotune.export.twincat_table import export_twincat_table

TARGETS: Mapping[str, Callable[[Request], Exported]] = MappingProxyType(
    {
        "c": export_c,
        "linuxcnc": export_linuxcnc,
        "fmu": export_fmu,
        "st": export_st,
        "twincat-table": export_twincat_table,
        "csv": export_csv,
    }
)


def export(request: Request, target: str) -> Exported:
    """A model as a file for the target.

    Raises:
        ConfigurationError: an unknown target, or one that cannot hold the model.
    """
    if target not in TARGETS:
        raise ConfigurationError(f"there is no target {target!r}; known are {', '.join(TARGETS)}")
    made = TARGETS[target](request)
    made = replace(made, notes=(*request.warnings, *made.notes))
    if request.name == NAME or target == "fmu":  # what is in an FMU is nobody else's name
        return made
    files = {_renamed(name, request.name): content for name, content in made.files.items()}
    texts = {name: _renamed(content.decode("ascii"), request.name) for name, content in files.items()}
    return replace(made, files={name: text.encode("ascii") for name, text in texts.items()})


def _renamed(text: str, name: str) -> str:
    """The text with its functions, macros, pins and files called by another name."""
    text = text.replace(NAME.upper(), name.upper()).replace(NAME, name)
    return text.replace(NAME.replace("_", "-"), name.replace("_", "-"))
