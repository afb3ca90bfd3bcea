"""Names of the parameters by which a drive holds torque over velocity as a table.

| name | what |
|---|---|
| `feedforward.friction_table.velocity.K` | point K, above 0 and increasing [rad/s or m/s] |
| `feedforward.friction_table.torque.K` | torque there, and with the other sign at −velocity [N m or N] |
| `friction_table.largest_velocity`, `.largest_torque` | read only: what the drive can hold |
| `friction_table.velocity_step`, `.torque_step` | read only: its resolution, 0 where it has none |

From the origin to the first point and between points there are straight lines; beyond the last it is constant.
"""

from __future__ import annotations

from collections.abc import Iterable

SHORT = "friction_table"
PREFIX = f"feedforward.{SHORT}."
VELOCITY, TORQUE = PREFIX + "velocity", PREFIX + "torque"
LARGEST_VELOCITY, LARGEST_TORQUE = f"{SHORT}.largest_velocity", f"{SHORT}.largest_torque"
VELOCITY_STEP, TORQUE_STEP = f"{SHORT}.velocity_step", f"{SHORT}.torque_step"


def in_words(names: Iterable[str]) -> list[str]:
    """Names for people, with or without `feedforward.`: the points of a table are one."""
    found = (SHORT if name.removeprefix("feedforward.").startswith(f"{SHORT}.") else name for name in names)
    return sorted(set(found))
