"""Which model a sidecar plays on an axis: that of the newest run which left one for the host, and its drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, IdentityMismatch
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.tuning.files import read_json
from autotune.tuning.findings import HOST_FILE
from autotune.tuning.results import run_folders
from autotune.tuning.same_drive import differences, named


@dataclass(frozen=True, slots=True)
class HostModel:
    """A proved model that a host has to play, the run that left it, and the drive that it was proved on."""

    model: DriveModel
    directory: Path
    identity: Mapping[str, int | str]


def host_model(runs: Path, axis: Axis) -> HostModel:
    """What the newest run with a `feedforward.toml` has proved.

    Raises:
        ConfigurationError: there is none, it is of the axis as it was described before, or its journal is missing.
    """
    folder = next((one for one in run_folders(runs, axis.name) if (one / HOST_FILE).is_file()), None)
    if folder is None:
        raise ConfigurationError(
            f"no run of axis {axis.name} below {runs} has left a {HOST_FILE}: either it was not tuned yet ('autotune "
            "run'), or its drive holds all that was proved and nothing is left to be played"
        )
    model = read_model(folder / HOST_FILE)
    if model.fingerprint != axis.fingerprint or model.motion_unit != axis.motion_unit:
        raise ConfigurationError(
            f"{folder / HOST_FILE} is of axis {model.axis!r} with fingerprint {model.fingerprint!r}, the axis file has "
            f"{axis.fingerprint!r}: its name, unit, profile or mechanics have changed since. Tune again"
        )
    if model.torque_unit:
        raise ConfigurationError(
            f"{folder / HOST_FILE} has torques in {model.torque_unit}, which no drive can be sent"
        )
    identity = read_json(folder / "journal.json", "journal").get("identity")
    if not isinstance(identity, dict) or not identity:
        raise ConfigurationError(f"{folder / 'journal.json'} does not say which drive was tuned. Tune again")
    return HostModel(model, folder, identity)


def must_be_tuned_drive(tuned: HostModel, found: Mapping[str, int | str]) -> None:
    """Raises IdentityMismatch where another drive answers than the one that was tuned."""
    wrong = differences(tuned.identity, found)
    if wrong:
        raise IdentityMismatch(
            f"the drive that answers is not the one that run {tuned.directory.name} tuned ({named(tuned.identity)}): "
            f"{'; '.join(wrong)}. Nothing was written. Tune this drive first ('autotune run')"
        )
