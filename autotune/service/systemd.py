"""Telling systemd that the service is ready, alive, reloading or stopping (sd_notify in ten lines), and its
journal how grave a line is (sd-daemon(3): a syslog level in angle brackets at its beginning).
"""

from __future__ import annotations

import logging
import os
import socket

from autotune.core.text import clean

_GRAVITY = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


class CleanFormatter(logging.Formatter):
    """What drives and clients say reaches the log without what would move the terminal that it is read on."""

    def format(self, record: logging.LogRecord) -> str:
        return clean(super().format(record))


class JournalFormatter(CleanFormatter):
    """One line a record with its level for the journal; a traceback follows on lines of the same level."""

    def format(self, record: logging.LogRecord) -> str:
        level = next((number for least, number in _GRAVITY if record.levelno >= least), 7)
        return "\n".join(f"<{level}>{line}" for line in super().format(record).splitlines())


def to_journal() -> bool:
    """What is written to standard error goes to the journal."""
    return bool(os.environ.get("JOURNAL_STREAM"))


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
