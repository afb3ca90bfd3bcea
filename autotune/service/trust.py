"""Files of others: whose they may be, and how one is opened that anybody could have put there.

A file is trusted where nobody but root, this user and whoever owns the program can change it or put another
one in its place: owner and mode of the file and of every folder above it are looked at, as sshd does with its
`StrictModes`. A folder that everybody may write to counts where it is sticky, since names in it stay with
their owners.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from contextlib import suppress
from pathlib import Path

import autotune
from autotune.core.errors import ConfigurationError

SERVICE_USER = "autotune"
"""The account that the systemd unit runs the service as."""
MOST_BYTES = 4096


def trusted_users() -> frozenset[int]:
    """User ids whose files are believed: root, this user, the service's account, the program's owner."""
    users = {0, os.geteuid(), os.stat(autotune.__file__).st_uid}
    with suppress(KeyError):
        users.add(pwd.getpwnam(SERVICE_USER).pw_uid)
    return frozenset(users)


def user_name(user: int) -> str:
    """A user's name, or its number where it has none."""
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)


def distrust(path: Path) -> str:
    """Why a file may say what others want it to say; "" where it is trusted.

    Links are followed first: what counts is the file that is read.
    """
    place = Path(os.path.realpath(path))
    for one in (place, *place.parents):
        if problem := _changeable(one, os.lstat(one)):
            return problem
    return ""


def _changeable(path: Path, found: os.stat_result) -> str:
    if found.st_uid not in trusted_users():
        return f"{path} belongs to {user_name(found.st_uid)}"
    sticky = stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX
    if found.st_mode & stat.S_IWOTH and not sticky:
        return f"everybody can write to {path}"
    if found.st_mode & stat.S_IWGRP and not sticky and not _private(found.st_gid, found.st_uid):
        return f"a group of users can write to {path}"
    return ""


def _private(group: int, owner: int) -> bool:
    """The group holds its owner alone, as many systems make one for every user; or it is root's."""
    if group == 0:
        return True
    try:
        entry = grp.getgrgid(group)
        return entry.gr_name == pwd.getpwuid(owner).pw_name and not set(entry.gr_mem) - {entry.gr_name}
    except KeyError:
        return False


def open_plain(path: Path, flags: int = os.O_RDONLY) -> int:
    """Opens a plain file by its own name: no link is followed, and nothing that would block is waited for.

    Raises:
        OSError: it is not there, may not be opened, or is a link.
        ConfigurationError: it is a folder, pipe, socket or device, or has a second name.
    """
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    found = os.fstat(descriptor)
    if stat.S_ISREG(found.st_mode) and found.st_nlink <= 1:
        return descriptor
    os.close(descriptor)
    raise ConfigurationError(f"{path} is not a plain file of its own; remove it")


def read_plain(path: Path) -> str:
    """The text of a short plain file.

    Raises:
        OSError, ConfigurationError: as `open_plain`; or it is not text.
    """
    descriptor = open_plain(path)
    try:
        return os.read(descriptor, MOST_BYTES).decode()
    except UnicodeDecodeError:
        raise ConfigurationError(f"{path} is not text; remove it") from None
    finally:
        os.close(descriptor)
