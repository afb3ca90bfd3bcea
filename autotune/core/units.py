"""What is said of units in words."""

from __future__ import annotations


def torque_symbol(motion_unit: str, torque_unit: str = "") -> str:
    """N m on axes that turn, N on axes that slide, unless the torque is in another unit."""
    return torque_unit or ("N" if motion_unit == "m" else "N m")


def percent(share: float) -> str:
    """A share in percent, two digits of it or all before the point: 0.012, 5.3, 28, 166; never an exponent of ten."""
    return f"{100.0 * share:.2g}" if abs(share) < 0.995 else f"{100.0 * share:.0f}"


def damping_symbol(motion_unit: str) -> str:
    """Torque over velocity: N m s/rad on axes that turn, N s/m on axes that slide."""
    return f"{torque_symbol(motion_unit)} s/{motion_unit}"
