"""What is said of units in words."""

from __future__ import annotations


def torque_symbol(motion_unit: str, torque_unit: str = "") -> str:
    """N m on axes that turn, N on axes that slide, unless the torque is in another unit."""
    return torque_unit or ("N" if motion_unit == "m" else "N m")


def damping_symbol(motion_unit: str) -> str:
    """Torque over velocity: N m s/rad on axes that turn, N s/m on axes that slide."""
    return f"{torque_symbol(motion_unit)} s/{motion_unit}"
