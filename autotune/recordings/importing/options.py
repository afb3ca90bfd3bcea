"""What a person can say about foreign files."""

from __future__ import annotations

from dataclasses import dataclass, field

from autotune.recordings.recording import Controller


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the person said: motion unit, unit of the torque column, one count of the encoder, period.

    `speed_curve`: each row is a constant speed with its mean torque.
    """

    motion_unit: str | None = None
    torque_unit: str | None = None
    resolution: float | None = None
    period: float | None = None
    speed_curve: bool = False


@dataclass(frozen=True, slots=True)
class Options:
    """What a person can know about the files.

    Attributes:
        columns: `NAME=FIELD[*FACTOR]`, as written.
        experiment: name of all segments; by default the file's name.
        keep_signs: the signs were looked at and are right.
        keep_leaps: so were the leaps of the position.
        out: where the recording is to be written; "" where nobody has said.
    """

    format: str
    columns: tuple[str, ...] = ()
    wishes: Wishes = field(default_factory=Wishes)
    torque_limit: float | None = None
    controller: Controller | None = None
    experiment: str | None = None
    keep_signs: bool = False
    keep_leaps: bool = False
    out: str = ""
