"""`autotune serve`: starts everything in order, then one round after the other until a signal ends it.

SIGTERM and SIGINT let running jobs come to rest; SIGHUP reads the configuration again.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from types import FrameType

from sqlalchemy.exc import SQLAlchemyError

from autotune.core.errors import AutotuneError, ConfigurationError, LinkError
from autotune.service.daemon import housekeeping, systemd
from autotune.service.daemon.absorb import absorb
from autotune.service.daemon.database import Opened, back_up, open_database, shown
from autotune.service.daemon.launcher import ProcessLauncher, place_for_kernels
from autotune.service.daemon.manager import Manager, plans_of
from autotune.service.daemon.notices import Webhook
from autotune.service.daemon.schedule import Schedule
from autotune.service.daemon.server import HttpServer, listen, token_file, token_of
from autotune.service.daemon.settings import Configuration, read_service, remember_checkable
from autotune.service.daemon.store import Store
from autotune.service.files import file_lock
from autotune.service.ownership import Key, Owner, Ownership

ROUND_SECONDS = 0.25
UPKEEP_SECONDS = 300.0
BACKUP_EVERY = timedelta(hours=20)
OWNING_EVERY = 2.0
ENDING_SECONDS = 40.0
log = logging.getLogger("autotune.service")
Say = Callable[[str], None]


class Owners:
    """The service's hold on its drives; what another program has is tried again."""

    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self._held: dict[str, tuple[str, Ownership]] = {}
        self._complained: set[str] = set()

    def holds(self, axis: str) -> bool:
        """The service may use this axis."""
        return axis in self._held

    def ensure(self, configuration: Configuration, busy: set[str]) -> None:
        """Takes what is free, lets go of what is not in the configuration any more and at rest."""
        wanted = {one.name: one for one in configuration.axes}
        for name, (key, held) in list(self._held.items()):
            if (name not in wanted or wanted[name].key != key) and name not in busy:
                held.release()
                del self._held[name]
        for name, one in wanted.items():
            if name in self._held:
                continue
            try:
                self._held[name] = (one.key, Ownership.take(Key(one.key, one.bus), name, self._owner))
                self._complained.discard(name)
            except ConfigurationError as error:
                if name not in self._complained:
                    self._complained.add(name)
                    log.warning("%s; its jobs wait", error)

    def release(self) -> None:
        """Lets go of all."""
        for _, held in self._held.values():
            held.release()
        self._held.clear()


class Upkeep:
    """What the folders hold taken up into the history, then disk budget and backups, now and then."""

    def __init__(self, opened: Opened, store: Store) -> None:
        self._opened, self._store, self._taken_up = opened, store, False

    def take_up(self, configuration: Configuration) -> str:
        """Takes up runs and checks that the history lacks, until that has succeeded once; a problem in words or ""."""
        if self._taken_up:
            return ""
        try:
            taken = absorb(self._store, configuration.runs)
        except (SQLAlchemyError, OSError) as error:
            return f"runs and checks cannot be taken up into the history: {str(error).splitlines()[0]}"
        self._taken_up = True
        if taken:
            log.info("%d runs and checks in %s taken up into the history", taken, configuration.runs)
        return ""

    def run(self, configuration: Configuration, now: datetime) -> list[str]:
        """Prunes and backs up; returns problems in words."""
        untaken = self.take_up(configuration)
        problems = [untaken] if untaken else []
        try:
            budget = configuration.service.recordings.budget_megabytes * housekeeping.MEGABYTE
            axes = [one.name for one in configuration.axes]
            for path in housekeeping.prune(configuration.runs, axes, budget):
                log.info("recordings of %s removed for room", path.name)
        except OSError as error:
            problems.append(f"recordings cannot be removed: {error}")
        if self._opened.file is None:
            return problems
        folder = configuration.state / "backups"
        backups = sorted(folder.glob("history-*.sqlite"))
        newest = backups[-1].stat().st_mtime if backups else 0.0
        if abs(now.timestamp() - newest) > BACKUP_EVERY.total_seconds():
            try:
                back_up(self._opened.file, folder, now, configuration.service.history.backups)
            except Exception as error:  # noqa: BLE001 - whatever it is, the service goes on and says so
                problems.append(f"the history cannot be backed up: {error}")
        return problems


class _Signals:
    """What signals have asked for."""

    def __init__(self) -> None:
        self.end = threading.Event()
        self.reload = threading.Event()

    def install(self) -> None:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        signal.signal(signal.SIGHUP, self._reload)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.end.set()

    def _reload(self, number: int, frame: FrameType | None) -> None:
        self.reload.set()


def serve(file: Path, announce: Say) -> None:
    """Serves until a signal ends it.

    Raises:
        ConfigurationError, LinkError: nothing was started.
    """
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    if systemd.to_journal():
        logging.getLogger().handlers[0].setFormatter(systemd.JournalFormatter("%(message)s"))
    for chatty in ("alembic", "apscheduler", "uvicorn"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    configuration = read_service(file)
    signals = _Signals()
    with _alone(configuration.state):
        remember_checkable(configuration)
        place_for_kernels(configuration.state)
        listening = listen(configuration.service.http)
        try:
            now = datetime.now().astimezone()
            backups = configuration.state / "backups"
            opened = open_database(
                configuration.history_url, backups, now, configuration.service.history.backups
            )
        except BaseException:
            listening.close()
            raise
        signals.install()
        try:
            _serve(configuration, opened, listening, signals, announce)
        except SQLAlchemyError as error:
            reason = str(getattr(error, "orig", None) or error).splitlines()[0]
            raise LinkError(
                f"the history {shown(configuration.history_url)} cannot be used: {reason}"
            ) from error


def _serve(
    configuration: Configuration, opened: Opened, listening: socket.socket, signals: _Signals, announce: Say
) -> None:
    store = Store(opened.engine)
    webhook = Webhook(configuration.service.notices)
    schedule = Schedule(opened.engine, plans_of(configuration), datetime.now().astimezone())
    manager = Manager(
        configuration, store, schedule, ProcessLauncher(), webhook.tell,
        lambda: datetime.now().astimezone(), time.monotonic,
    )  # fmt: skip
    server = HttpServer(manager, configuration.service.http, token_of(configuration.state), listening)
    place = token_file(configuration.state)
    owners = Owners(Owner(os.getpid(), "autotune serve", server.address, str(place)))
    manager.owns = owners.holds
    try:
        owners.ensure(configuration, set())
        if opened.restored:
            manager.say_restored(opened.restored)
        upkeep = Upkeep(opened, store)
        manager.set_problem("upkeep", upkeep.take_up(configuration))
        manager.tick()
        server.start()
        announce(server.address)
        log.info(
            "axes: %s; changes need the token in %s", ", ".join(a.name for a in configuration.axes), place
        )
        systemd.notify(f"READY=1\nSTATUS=serving at {server.address}")
        _rounds(manager, server, owners, upkeep, webhook, signals)
    finally:
        systemd.notify("STOPPING=1")
        _end(manager)
        server.close()
        owners.release()
        schedule.close()
        webhook.close()
        store.close()


def _rounds(
    manager: Manager, server: HttpServer, owners: Owners, upkeep: Upkeep, webhook: Webhook, signals: _Signals
) -> None:
    next_upkeep = next_owning = time.monotonic()
    while not signals.end.wait(ROUND_SECONDS):
        if signals.reload.is_set():
            signals.reload.clear()
            _reload(manager)
            webhook.change(manager.configuration.service.notices)
            next_owning = 0.0
        manager.tick()
        manager.health.notices_lost = webhook.lost
        now = time.monotonic()
        if now >= next_owning:
            owners.ensure(manager.configuration, {one.axis.name for one in manager.running.values()})
            next_owning = now + OWNING_EVERY
        if now >= next_upkeep:
            problems = upkeep.run(manager.configuration, datetime.now().astimezone())
            manager.set_problem("upkeep", "; ".join(problems))
            manager.health.recordings_bytes = housekeeping.used(manager.configuration.runs)
            next_upkeep = now + UPKEEP_SECONDS
        if server.alive:
            systemd.notify("WATCHDOG=1")


def _reload(manager: Manager) -> None:
    """A file that is wrong changes nothing and is said loudly."""
    systemd.notify("RELOADING=1")
    try:
        fresh = read_service(manager.configuration.file)
        old = manager.configuration
        if (fresh.service.http, fresh.runs, fresh.history_url) != (
            old.service.http,
            old.runs,
            old.history_url,
        ):
            log.warning("changes of http, runs and history need a restart; the rest is taken over")
        remember_checkable(fresh)
        manager.reload(fresh)
        log.info("configuration read again: %s", ", ".join(one.name for one in fresh.axes))
    except AutotuneError as error:
        log.error("configuration not taken over, the old one stays in force: %s", error)
    systemd.notify("READY=1")


def _end(manager: Manager) -> None:
    """Running jobs come to rest; what does not end in time is left to its own lifeline."""
    manager.shut_down()
    deadline = time.monotonic() + ENDING_SECONDS
    while not manager.idle and time.monotonic() < deadline:
        time.sleep(0.05)


@contextmanager
def _alone(state: Path) -> Iterator[None]:
    """One service a runs folder.

    Raises:
        ConfigurationError: another one is there, or the folder cannot be used.
    """
    taken = f"a service with the folder {state.parent} is running already (process {{owner}})"
    with file_lock(state / "lock", unusable="set 'runs' in the service file to one that can", taken=taken):
        yield
