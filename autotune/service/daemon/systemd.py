"""Telling systemd that the service is ready, alive, reloading or stopping: sd_notify in ten lines."""

from __future__ import annotations

import os
import socket


def notify(message: str) -> bool:
    """Sends a state (`READY=1`, `WATCHDOG=1`, …) to the socket that systemd names; False without systemd."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    if address[0] == "@":
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
            channel.sendto(message.encode(), address)
    except OSError:
        return False
    return True
