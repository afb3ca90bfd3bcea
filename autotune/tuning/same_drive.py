"""Whether the drive that answers is the one that a backup or a journal is of."""

from __future__ import annotations

from collections.abc import Mapping

SAME_DRIVE = ("vendor", "product", "serial")
"""The revision is not among them: new firmware does not make another drive of it."""


def differences(meant: Mapping[str, int | str], found: Mapping[str, int | str]) -> list[str]:
    """In what the drive found is another one than the one meant, in words; empty where it is the same.

    A drive that tells no serial number is known by its kind alone.
    """
    return [
        f"{name} is {found[name]} instead of {meant[name]}"
        for name in SAME_DRIVE
        if name in meant and name in found and meant[name] != found[name]
    ]


def named(identity: Mapping[str, int | str]) -> str:
    """A drive in words."""
    told = [f"{name} {identity[name]}" for name in SAME_DRIVE if name in identity]
    return ", ".join(told) or "an unknown drive"
