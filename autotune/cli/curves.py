"""What `autotune model curves` reads: a model, or a recording that a model is fitted to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from autotune.cli.output import say
from autotune.core.errors import ConfigurationError, NotEnoughExcitation

if TYPE_CHECKING:
    from autotune.control.steady_curves import Characteristic
    from autotune.models.drive_model import DriveModel

MOST = 12


def curves_of(files: list[Path]) -> tuple[list[Characteristic], str, str]:
    """The curves, the motion unit and the unit of torque.

    Raises:
        ConfigurationError: no file, too many to tell apart, or axes with different units.
        NotEnoughExcitation: a recording that does not tell friction.
    """
    from autotune.control.steady_curves import characteristic, fastest_shown

    if not 1 <= len(files) <= MOST:
        raise ConfigurationError(
            f"{len(files)} files were named; 1 to {MOST} curves can be told apart in one figure"
        )
    models = [_model(path) for path in files]
    units = {(model.motion_unit, model.torque_symbol) for model in models}
    if len(units) > 1:
        pairs = zip(files, models, strict=True)
        told = "; ".join(f"{path.name} in {one.motion_unit} and {one.torque_symbol}" for path, one in pairs)
        raise ConfigurationError(f"these files cannot be compared, their units differ: {told}")
    fastest = fastest_shown(models)
    names = [path.stem if [one.stem for one in files].count(path.stem) == 1 else str(path) for path in files]
    found = [characteristic(name, model, fastest) for name, model in zip(names, models, strict=True)]
    return found, *units.pop()


def _model(path: Path) -> DriveModel:
    if path.suffix == ".toml":
        from autotune.models.model_file import read_model

        return read_model(path)
    import autotune
    from autotune.models.stribeck import STRIBECK
    from autotune.recordings.files import read_recording

    recording = read_recording(path)
    for remark in recording.metadata.remarks:
        say(remark)
    fitted = autotune.fit([recording], effects=[STRIBECK.name])
    if fitted.model is None or not fitted.valid:
        raise NotEnoughExcitation(
            f"{path} does not tell friction over speed: {fitted.reason}. Record constant speeds from slow to fast "
            "('autotune record AXIS.toml steady_state')"
        )
    return fitted.model
