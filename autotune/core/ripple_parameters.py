"""Names of the parameters by which a drive holds torque over position, as harmonics or as a table.

| name | what |
|---|---|
| `feedforward.ripple.gain` | 0: the drive adds nothing. Harmonics: a factor, 1 in operation; table: N m of one step |
| `feedforward.ripple.source` | which memory the drive takes them from, as the vendor numbers it |
| `feedforward.ripple.order.K`, `.phase.K`, `.torque.K` | harmonic K: cycles a turn, rad, N m (≥ 0) |
| `feedforward.ripple.table.K` | point K of the turn of the commutation encoder, in whole steps |
| `alignment.NAME` | read only: a setting that moves the zero from which the drive counts the turn |
| `ripple.highest_order`, `ripple.largest_step` | read only: what the drive can hold |

Orders, phases and points are the drive's own: of its commutation encoder, in its direction and with its sign.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

PREFIX = "feedforward.ripple."
GAIN = PREFIX + "gain"
SOURCE = PREFIX + "source"
ORDER, PHASE, TORQUE = (PREFIX + name for name in ("order", "phase", "torque"))
TABLE = PREFIX + "table"
ALIGNMENT = "alignment."
HIGHEST_ORDER = "ripple.highest_order"
LARGEST_STEP = "ripple.largest_step"


def is_ripple(name: str) -> bool:
    """True for what is written to a drive to hold ripple."""
    return name.startswith(PREFIX)


def numbered(stem: str, names: Collection[str]) -> int:
    """How many of `stem.0`, `stem.1`, … there are in a row."""
    count = 0
    while f"{stem}.{count}" in names:
        count += 1
    return count


def alignment_of(values: Mapping[str, float]) -> dict[str, float]:
    """The settings that move the zero of what the drive holds."""
    return {name: value for name, value in values.items() if name.startswith(ALIGNMENT)}


def moved(then: Mapping[str, float], now: Mapping[str, float]) -> list[str]:
    """Settings that are others than they were, in words; [] where the zero is where it was."""
    return [
        f"{name.removeprefix(ALIGNMENT)} was {value:.9g} and is "
        + (f"{now[name]:.9g}" if name in now else "not there any more")
        for name, value in then.items()
        if abs(now.get(name, float("nan")) - value) > 1e-6 * max(abs(value), 1.0) or name not in now
    ]


def without_table(values: Mapping[str, float]) -> dict[str, float]:
    """The same for people: the points of a table left out."""
    return {name: value for name, value in values.items() if not name.startswith(TABLE + ".")}
