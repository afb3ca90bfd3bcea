"""How much of a CAN bus one cycle takes, from what the profile puts into it.

A data frame with n bytes has 47 + 8n bits with its interframe space, and at most (34 + 8n − 1)/4 stuff bits
more (ISO 11898-1). Heartbeats and SDOs come on top.
"""

from __future__ import annotations

from autotune_drivers.canopen.pdo import pack
from autotune_drivers.profile import Profile


def frame_bits(size: int) -> int:
    """Bits of a data frame with `size` bytes, at worst."""
    return 47 + 8 * size + (33 + 8 * size) // 4


def cycle_frames(profile: Profile) -> list[int]:
    """Bytes of each frame of one cycle in position mode, SYNC first."""
    commands, signals = profile.commands, profile.signals
    sent = pack([commands.control.ref, commands.position.ref, commands.torque_feedforward.ref])
    head = [signals.status, signals.position, signals.sync_counter]
    rest = [signals.torque_demand, signals.torque, signals.velocity, signals.torque_feedback]
    received = pack([signal.ref for signal in (*head, *rest) if signal is not None])
    return [0, *(sum(ref.size for ref in group) for group in (*sent, *received))]


def bus_load(profile: Profile, period: float, bitrate: float) -> float:
    """Share of the bus that cycles of `period` seconds take, 0…1 and beyond."""
    return sum(map(frame_bits, cycle_frames(profile))) / (period * bitrate)
