"""Locks that programs of several users share: who takes one has it, and nobody can make it say otherwise.

The lock is the kernel's (flock, which needs no right to write): it goes with the process, however that ends.
Who holds it is asked of the kernel too (/proc/locks); the note in the file only names the command, and is
believed only where its owner is. In a folder that everybody may write to, a file of somebody else is not a lock:
its owner could remove it under its holder, and a second program would hold "the" lock as well.
"""

from __future__ import annotations

import fcntl
import grp
import json
import os
import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from autotune.core.errors import ConfigurationError
from autotune.core.text import clean_line
from autotune.service.trust import SERVICE_USER, open_plain, trusted_users, user_name

OWN_FOLDER = Path("/run/autotune")
SHARED = Path("/run/lock")
ATTEMPTS = 20
"""How often a lock that others remove in this moment is tried."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Who holds a lock. `process` is 0 and `user` empty where the kernel does not tell; `what` may be empty."""

    process: int
    user: str = ""
    what: str = ""

    def __str__(self) -> str:
        who = f"process {self.process or 'unknown'}" + (f", user {self.user}" if self.user else "")
        return f"{self.what or 'another program'} ({who})"


class Held(ConfigurationError):
    """Somebody else has the lock."""

    def __init__(self, holder: Holder) -> None:
        super().__init__(f"held by {holder}")
        self.holder = holder


def lock_folder() -> Path:
    """Where the lock files are. The answer is the same for every user of the machine.

    It is `/run/autotune` where the service's unit has made it, which only its group can enter.
    """
    if chosen := os.environ.get("AUTOTUNE_LOCKS"):
        return Path(chosen)
    if OWN_FOLDER.is_dir():
        return OWN_FOLDER
    mode = SHARED.stat().st_mode if SHARED.is_dir() else 0
    return SHARED if mode & stat.S_ISVTX and mode & stat.S_IWOTH else Path(tempfile.gettempdir())


class Lock:
    """A lock that is held. `release` lets go; the end of the process does it as well."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor

    @classmethod
    def take(cls, path: Path, what: str) -> Lock:
        """Takes a lock; `what` is noted for whoever finds it held.

        Raises:
            Held: another program has it.
            ConfigurationError: what is at `path` cannot serve as a lock; says what to do.
        """
        _prepare(path.parent)
        _look_elsewhere(path)
        for _ in range(ATTEMPTS):
            descriptor = _open(path)
            if descriptor is None:
                continue
            if _lock(descriptor, path) and _still_there(descriptor, path):
                _note(path, descriptor, {"process": os.getpid(), "what": what})
                return cls(path, descriptor)
            os.close(descriptor)
        raise ConfigurationError(
            f"the lock file {path} changes all the time; look who writes to {path.parent}"
        )

    def release(self) -> None:
        """Lets go, and leaves no file that only this user could use. Idempotent."""
        if self._descriptor < 0:
            return
        with suppress(OSError):
            if _still_there(self._descriptor, self._path):
                self._path.unlink()
        os.close(self._descriptor)
        self._descriptor = -1


def holder_of(path: Path) -> Holder | None:
    """Who holds the lock at `path`; None where nobody does, or it is not a lock."""
    try:
        descriptor = open_plain(path)
    except (OSError, ConfigurationError):
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder(descriptor)
    else:
        return None
    finally:
        os.close(descriptor)


def _prepare(folder: Path) -> None:
    """The folder is there, and only its owner's friends can exchange a file in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        found = os.stat(folder)
    except OSError as error:
        raise _unusable(folder, error) from error
    if found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX:
        raise ConfigurationError(
            f"everybody can exchange files in the lock folder {folder}; make it sticky (chmod +t {folder})"
        )
    if found.st_uid not in trusted_users():
        raise ConfigurationError(
            f"the lock folder {folder} belongs to {user_name(found.st_uid)}; set AUTOTUNE_LOCKS to another one"
        )


def _look_elsewhere(path: Path) -> None:
    """A program that began before the locks had their own folder may hold the same one in the shared folder.

    Raises:
        Held: it does, and it is of somebody who could hold one here.
    """
    holder = holder_of(SHARED / path.name) if path.parent == OWN_FOLDER else None
    if holder is None:
        return
    members = {user_name(user) for user in trusted_users()}
    with suppress(KeyError):
        members |= set(grp.getgrnam(SERVICE_USER).gr_mem)
    if holder.user in members or not holder.user:
        raise Held(holder)


def _open(path: Path) -> int | None:
    """The file, made where it is missing; None where it is to be tried again."""
    try:
        descriptor = open_plain(path)
    except FileNotFoundError:
        return _create(path)
    except (OSError, ConfigurationError) as error:
        _replace(path, str(getattr(error, "strerror", "") or error), error)
        return None
    owner = os.fstat(descriptor).st_uid
    everybodys = os.stat(path.parent).st_mode & stat.S_IWOTH
    if not everybodys or owner in trusted_users():
        return descriptor
    try:
        _lock(descriptor, path)
        _replace(
            path, f"it belongs to {user_name(owner)}, who could take the lock away from under its holder"
        )
    finally:
        os.close(descriptor)
    return None


def _create(path: Path) -> int | None:
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except FileExistsError:
        return None
    except OSError as error:
        raise _unusable(path.parent, error) from error
    os.fchmod(descriptor, 0o644)  # whatever the umask: who cannot read it could not see that it is held
    return descriptor


def _replace(path: Path, problem: str, cause: Exception | None = None) -> None:
    """What is no lock is removed where this user may; a name is removed, never what a link points to.

    Raises:
        ConfigurationError: it may not.
    """
    try:
        if os.geteuid() != 0 and os.lstat(path).st_uid != os.geteuid():
            raise PermissionError
        path.unlink(missing_ok=True)
    except OSError:
        raise ConfigurationError(
            f"the lock file {path} cannot be used: {problem}. Remove it as root (rm {path}), or give the locks a "
            f"folder of their own (install -d -o root -g {SERVICE_USER} -m 0770 {OWN_FOLDER})"
        ) from cause


def _lock(descriptor: int, path: Path) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = _holder(descriptor)
        raise Held(holder) from None
    return True


def _still_there(descriptor: int, path: Path) -> bool:
    """The file that is locked is the one that the next program will find."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except OSError:
        return False


def _note(path: Path, descriptor: int, content: dict[str, object]) -> None:
    """Writes who it is, for people, where the file is this user's; a lock without a note is a lock."""
    if os.geteuid() not in (0, os.fstat(descriptor).st_uid):
        return
    with suppress(OSError, ConfigurationError):
        writing = open_plain(path, os.O_WRONLY)
        try:
            if os.path.samestat(os.fstat(descriptor), os.fstat(writing)):
                os.fchmod(writing, 0o644)
                os.ftruncate(writing, 0)
                os.pwrite(writing, json.dumps(content).encode(), 0)
        finally:
            os.close(writing)


def _holder(descriptor: int) -> Holder:
    process = _process_in_kernel(os.fstat(descriptor))
    noted, what = _noted(descriptor)
    if process and noted != process:
        what = ""
    return Holder(process or noted, _user_of(process or noted), what)


def _process_in_kernel(found: os.stat_result) -> int:
    """The process that holds a flock on a file, by /proc/locks (proc(5)); 0 where it does not tell."""
    place = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
    with suppress(OSError, ValueError), open("/proc/locks", encoding="ascii") as table:
        for line in table:
            words = line.split()
            if len(words) == 8 and words[1] == "FLOCK" and words[5] == place:
                return max(int(words[4]), 0)
    return 0


def _noted(descriptor: int) -> tuple[int, str]:
    """What the note says, where it is by somebody whose word counts."""
    found = os.fstat(descriptor)
    if found.st_uid not in trusted_users() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return 0, ""
    try:
        content = json.loads(os.pread(descriptor, 4096, 0).decode() or "{}")
        return int(content.get("process", 0)), clean_line(str(content.get("what", "")), 60)
    except (ValueError, TypeError, AttributeError, RecursionError):
        return 0, ""


def _user_of(process: int) -> str:
    try:
        return user_name(os.stat(f"/proc/{process}").st_uid) if process else ""
    except OSError:
        return ""


def _unusable(folder: Path, error: OSError) -> ConfigurationError:
    member = f"; who belongs to the group {SERVICE_USER} may" if folder == OWN_FOLDER else ""
    return ConfigurationError(
        f"the lock folder {folder} cannot be used ({error.strerror}){member}; check the rights on it"
    )
